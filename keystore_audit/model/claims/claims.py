"""What users claim of a keystore, in their words, and what that means in one system (docs/model.md, Claims)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cached_property
from hashlib import sha256

from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.channels import Channels, ReadRegion
from keystore_audit.model.claims.ability import pairs, starts_alone, stopped, stopping, unusable, with_refusals
from keystore_audit.model.claims.globs import (
    IN_DEFAULT_PARTITION,
    Globs,
    all_matching,
    at,
    named_enclaves,
    named_paths,
    region_of,
    topic_regions,
    unmanaged,
    with_all_certificates,
)
from keystore_audit.model.claims.named import permitted, with_subjects_elsewhere
from keystore_audit.model.claims.stated import (
    RESTING_ON_STARTS,
    RESTING_ON_SUBJECTS,
    Claim,
    Labelling,
    check_granted,
    check_labels,
    granted_channels,
    label_regions,
    marked,
)
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.folding import apart, together
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import AMBIENT
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.question import Usability
from keystore_audit.model.validity import ANY_ZONE, LAST, SECOND
from keystore_audit.profiles import Profile


def lasting(
    claims: Iterable[Claim], local: Iterable[datetime], excluded: Collection[datetime] = ()
) -> tuple[Claim, ...]:
    """The claims, each with an end after everything that may happen before its own end, or at it.

    `local`: dates that some implementation reads in a zone that we do not know, 14 hours earlier at most. `excluded`:
    ends of grants that some implementation no longer counts at the end itself.
    """
    ends = sorted(local)

    def end(until: datetime) -> datetime:
        over = until + SECOND if until in excluded and until <= LAST else until
        return max([over, *(date + SECOND for date in ends if date - until <= ANY_ZONE and date <= LAST)])

    return tuple(claim if claim.until is None else replace(claim, until=end(claim.until)) for claim in claims)


def claim_regions(claims: Iterable[Claim]) -> tuple[ReadRegion, ...]:
    """The sets of names that the claims speak of: they take part in the classes, so that claims are exact."""
    regions: dict[ReadRegion, None] = {}
    for claim in claims:
        for globs in (claim.source, claim.target):
            if globs.topics:
                regions.update(dict.fromkeys(topic_regions(globs.topics)))
        if not claim.include_ambient:
            regions[region_of(AMBIENT)] = None
        if claim.kind is ClaimKind.ABLE:
            regions[IN_DEFAULT_PARTITION] = None
    for labelling in _labellings(claims):
        regions.update(dict.fromkeys(label_regions(labelling)))
    return tuple(regions)


def _labellings(claims: Iterable[Claim]) -> list[Labelling]:
    """What the settings say of labels, once."""
    return list({id(claim.labels.labelling): claim.labels.labelling for claim in claims if claim.labels}.values())


def with_claims(
    systems: Sequence[System],
    claims: Sequence[Claim],
    channels: Channels,
    keystore: Keystore,
    usability: Mapping[tuple[str, str], Usability],
    usabilities: Usabilities,
    profiles: Sequence[Profile],
    *,
    checked: bool = True,
) -> tuple[System, ...]:
    """The systems of these profiles with the claims as facts.

    `usability`: by directory and profile, as in `Meaning`, and `usabilities` at later instants. For claims that rest on
    who starts.

    Raises errors.UsageError for a claim of something that is not in the keystore: it would hold since that is missing.
    Not `checked` where it is known from another keystore.
    """
    if not claims or not systems:
        return tuple(systems)
    if checked:
        _check(claims, systems, channels, keystore)

    def resolved(system: System) -> System:
        theirs = [profile for profile in profiles if profile.name in system.profiles]
        return _Resolution(system, channels, keystore, usability, usabilities, theirs).resolved(claims)

    kinds = {claim.kind for claim in claims}
    if kinds.isdisjoint(RESTING_ON_STARTS | RESTING_ON_SUBJECTS):
        return tuple(map(resolved, systems))
    systems = apart(systems)
    if not kinds.isdisjoint(RESTING_ON_SUBJECTS):
        systems = with_subjects_elsewhere(systems)
    if kinds.isdisjoint(RESTING_ON_STARTS):
        return together(map(resolved, systems))
    return together(each for system in systems for each in _readings(resolved, system))


def _readings(resolved: Callable[[System], System], system: System) -> Iterator[System]:
    """The system with its claims; in two readings where all of it was read, but who starts is still not certain."""
    found = resolved(system)
    yield found
    if system.may and not system.has_doubt:
        certain = resolved(replace(system, may=False))
        if certain.claims != found.claims:
            yield certain


def _check(claims: Sequence[Claim], systems: Sequence[System], channels: Channels, keystore: Keystore) -> None:
    """Raises errors.UsageError for globs that find nothing, and for places that must differ and do not."""
    paths = [enclave.path for enclave in keystore.enclaves]
    used = granted_channels(systems)
    for labelling in _labellings(claims):
        check_labels(labelling, paths, channels, used)
    for claim in claims:
        check_places(claim, paths)
        for globs in (claim.source, claim.target):
            for glob in globs.topics:
                check_granted(glob, channels, used, marked(claim, glob))


def check_places(claim: Claim, paths: Sequence[str]) -> None:
    """Raises errors.UsageError for globs that name none of the enclaves, and for places that must differ and do not."""
    for glob in (*claim.source.enclaves, *claim.target.enclaves, *claim.through):
        named_paths(glob, paths, marked(claim, glob))
    if claim.kind is ClaimKind.SEPARATE_DOMAINS:
        both = all_matching(claim.source.enclaves, paths) & all_matching(claim.target.enclaves, paths)
        if both:
            raise UsageError(f"{at(claim.place)}{min(both)!r} is on both sides.")
    if claim.kind in (ClaimKind.NO_FLOW, ClaimKind.ABLE) and (one := _only_itself(claim, paths)):
        raise UsageError(f"{at(claim.place)}{one} alone is on both sides.")
    if claim.kind is ClaimKind.NO_FLOW and claim.source.outsider and claim.attacker is Attacker.HONEST:
        raise UsageError(
            f"{at(marked(claim, 'outsider'))}nothing can get from an outsider that does not attack: without a key, "
            "any sample it sends is an attack. Attacker honest excludes that, and so does --compromised, which is "
            "about enclaves. Expected attacker source or relays."
        )


def _only_itself(claim: Claim, paths: Sequence[str]) -> str:
    """What both sides of a flow are, where it is one enclave, the outsider or the same topics; else nothing."""
    if claim.labels is not None:
        return ""
    if claim.source.outsider and claim.target.outsider:
        return "the outsider"
    if claim.source.topics and set(claim.source.topics) == set(claim.target.topics):
        return repr(claim.source.topics[0])
    found = all_matching(claim.source.enclaves, paths)
    same = len(found) == 1 and found == all_matching(claim.target.enclaves, paths)
    return repr(min(found)) if same else ""


class _Resolution:
    """Claims in the atoms of one system."""

    def __init__(
        self,
        system: System,
        channels: Channels,
        keystore: Keystore,
        usability: Mapping[tuple[str, str], Usability],
        usabilities: Usabilities,
        profiles: Sequence[Profile],
    ) -> None:
        self._system = system
        self._profiles = profiles
        self._usabilities = usabilities
        self._channels = channels
        self._known = {enclave.path for enclave in keystore.enclaves}
        self._keystore = keystore
        self._usability = usability
        self._digests: dict[int, str] = {}

    @cached_property
    def _elsewhere(self) -> frozenset[int]:
        """Channels on which no claim of ability counts."""
        return unusable(self._system, self._channels, self._keystore, self._usabilities, self._profiles)

    def _away(self, until: datetime | None) -> tuple[frozenset[int], frozenset[int]]:
        """Enclaves without a part in what a claim of ability asks for; and who else at some instant until then."""
        profiles = self._profiles
        now = stopped(self._system, self._keystore, self._usability, profiles) | unmanaged(self._system)
        if until is None:
            return now, frozenset()
        return now, stopping(self._system, self._keystore, self._usabilities, until, profiles) - now

    def resolved(self, claims: Sequence[Claim]) -> System:
        """The system with the claims."""
        if any(claim.kind is ClaimKind.ABLE for claim in claims):
            self._system = with_refusals(self._system, self._keystore, self._profiles)
        return replace(self._system, claims=tuple(self._named(self._atom(claim)) for claim in claims))

    def _named(self, claim: ClaimAtom) -> ClaimAtom:
        """With what its channels stand for, where that is more than one name."""
        channels = claim.source.channels | claim.target.channels if claim.kind is not ClaimKind.ABLE else ()
        return replace(claim, names=tuple((each, self._names(each)) for each in sorted(channels) if self._names(each)))

    def _names(self, channel: int) -> str:
        """Several names as a digest, since they may be many; nothing for one."""
        if channel not in self._digests:
            topics = sorted({f"{cell.topic} {cell.infinite}" for cell in self._channels.cells(channel)})
            digest = sha256("\0".join(topics).encode("utf-8", "surrogatepass")).hexdigest()
            self._digests[channel] = digest if len(topics) > 1 else ""
        return self._digests[channel]

    def _atom(self, claim: Claim) -> ClaimAtom:
        able = claim.kind is ClaimKind.ABLE
        now, later = self._away(claim.until) if able else (frozenset[int](), frozenset[int]())
        away = now | later  # these are no places and no ways
        left_out = frozenset() if claim.include_ambient else self._channels.regions[region_of(AMBIENT)]
        return ClaimAtom(
            id=claim.id,
            kind=claim.kind,
            attacker=claim.attacker,
            source=self._source(claim, away),
            target=self._place(claim, claim.target, away),
            through=self._enclaves(claim.through, unread=False) | away,
            left_out=left_out | self._elsewhere if able else left_out,
            until=None if claim.until is None else self._until(claim.until),
            location=claim.location,
            starts=self._starts(claim) if claim.kind is ClaimKind.SEPARATE_DOMAINS else frozenset(),
            pairs=pairs(claim, self._system, self._channels, self._known, self._elsewhere) if able else (),
            stopping=later,
        )

    def _starts(self, claim: Claim) -> frozenset[tuple[int, int]]:
        """Where enclaves of a claim of separate domains start although peers do not let them in."""
        named = self._enclaves((*claim.source.enclaves, *claim.target.enclaves), unread=False)
        joining = sorted(with_all_certificates(self._system, named))
        about = self._keystore, self._channels, self._usabilities
        return starts_alone(self._system, *about, joining, claim.until, self._profiles)

    def _source(self, claim: Claim, away: frozenset[int]) -> Place:
        """The claim's source; else the one enclave that may publish, if any. Engines ask whether no other does."""
        if claim.kind is not ClaimKind.ONLY_PUBLISH:
            return self._place(claim, claim.source, away)
        asked = self._place(claim, claim.target, frozenset()).channels
        return permitted(self._system, claim.source.enclaves, self._known, asked)

    def _place(self, claim: Claim, globs: Globs, away: frozenset[int]) -> Place:
        channels = self._channels.regions[region_of(globs.topics)] if globs.topics else frozenset()
        enclaves = self._enclaves(globs.enclaves, unread=True) - away
        if claim.kind is ClaimKind.SEPARATE_DOMAINS:  # who may be together somewhere, by whatever certificate
            enclaves = with_all_certificates(self._system, enclaves)
        return Place(
            enclaves=enclaves,
            channels=channels - self._elsewhere if claim.kind is ClaimKind.ABLE else channels,
            outsider=globs.outsider,
        )

    def _enclaves(self, globs: tuple[str, ...], *, unread: bool) -> frozenset[int]:
        return named_enclaves(self._system, globs, self._known, unread=unread)

    def _until(self, until: datetime) -> int:
        """The last instant at which the claim must hold; one in the past is asked about now."""
        index = sum(1 for instant in self._system.instants if instant <= until) - 1
        return max(index, self._system.now)
