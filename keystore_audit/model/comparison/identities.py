"""Identities beside those of the enclaves: in files of no enclave, and further certificates of an enclave's key."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Final

from msgspec import Struct, field

from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.comparison.change import Aspect, Direction, Layer, direction_of
from keystore_audit.model.comparison.drafts import Draft, in_order
from keystore_audit.model.comparison.facts import Fact, Placed, place_of, told
from keystore_audit.model.comparison.sides import Sides
from keystore_audit.model.inventory import certified_again
from keystore_audit.model.participants.stray_identity import Takers, admitted
from keystore_audit.model.validity import SECOND
from keystore_audit.profiles import Profile
from keystore_audit.text import some

_Identity = tuple[str, str, str]
"""Subject and key; and which certificate, where they are too many to ask who takes each."""

_Period = tuple[datetime, datetime]

MAX_PAIRS: Final = 1_000_000
"""Certificates and enclaves that may take them; beyond it every other certificate is another one."""

MAX_PATHS: Final = 3
"""Enclaves that are told by their names; the rest are counted."""

MAX_PERIODS: Final = 3
"""Of those in which somebody is let in, that are told."""


class _Taken(Struct, kw_only=True):
    """Certificates that say the same of somebody. `place`: of the first. `periods`: by enclave that takes them."""

    place: Location | None
    periods: dict[str, set[_Period]] = field(default_factory=dict)

    def add(self, certificate: Certificate, paths: Iterable[str]) -> None:
        """One more, which these enclaves take."""
        period = certificate.not_before, certificate.not_after
        for path in paths:
            self.periods.setdefault(path, set()).add(period)

    def by(self, paths: Collection[str]) -> str:
        """Which of these enclaves take it, and from when to when."""
        known = sorted(self.periods.keys() & paths)
        if not known:
            return "by nobody"
        joined = _joined({period for path in known for period in self.periods[path]})
        words = [f"from {told(begin)} until {told(end)}" for begin, end in joined[:MAX_PERIODS]]
        times = f", and {len(joined) - MAX_PERIODS} times more" if len(joined) > MAX_PERIODS else ""
        return f"by {some(known, MAX_PATHS)}, {' and '.join(words)}{times}"

    def beyond(self, other: _Taken, paths: Collection[str], at: datetime) -> frozenset[str]:
        """Those of the enclaves that take it, `at` an instant or later, when they do not take the other."""
        return frozenset(
            path
            for path in self.periods.keys() & paths
            if not _within(
                ((max(begin, at), end) for begin, end in self.periods[path] if end >= at),
                _joined(other.periods.get(path, ())),
            )
        )


def _joined(periods: Iterable[_Period]) -> tuple[_Period, ...]:
    """Those that touch as one: the last second of a certificate is its own, and the next one may begin after it."""
    found: list[_Period] = []
    for begin, end in sorted(periods):
        if found and begin - found[-1][1] <= SECOND:
            found[-1] = found[-1][0], max(found[-1][1], end)
        else:
            found.append((begin, end))
    return tuple(found)


def _within(periods: Iterable[_Period], others: Sequence[_Period]) -> bool:
    """Whether each lies in one of the others, which are in order and do not touch."""
    starts = [begin for begin, _end in others]
    found = ((end, bisect_right(starts, begin)) for begin, end in periods)
    return all(number and end <= others[number - 1][1] for end, number in found)


def identities_let_in(sides: Sides) -> Iterator[Draft]:
    """Identities of no enclave that peers let in and whose private keys are there (KA668), in one keystore alone.

    A change of the keystore as a whole: what it may do is what grants give its subject.
    """
    old, new = (_admitted(keystore, sides) for keystore in sides.keystores)
    for here, there, direction, verb in (
        (new, old, Direction.GAINED, "peers let in"),
        (old, new, Direction.LOST, "peers no longer let in"),
    ):
        for identity, by_profile in here.items():
            profiles = by_profile.keys() - there.get(identity, {}).keys()
            if profiles:
                place = next(taken.place for profile, taken in by_profile.items() if profile in profiles)
                yield _at_large(
                    identity,
                    verb,
                    direction,
                    in_order(profiles, sides),
                    old=None if here is new else place,
                    new=place if here is new else None,
                )
    yield from _let_in_otherwise(old, new, sides)


_Admitted = Mapping[_Identity, Mapping[str, _Taken]]
"""By identity and profile."""


def _at_large(
    identity: _Identity,
    verb: str,
    direction: Direction,
    profiles: tuple[str, ...],
    aspects: tuple[Aspect, ...] = (),
    *,
    old: Location | None,
    new: Location | None,
) -> Draft:
    return Draft(
        layer=Layer.TRUST,
        kind="identity-at-large",
        direction=direction,
        what=f"{verb} {identity[0]}, an identity of no enclave whose private key lies in the keystore",
        enclaves=(),
        profiles=profiles,
        aspects=aspects,
        old=old,
        new=new,
    )


def _let_in_otherwise(old: _Admitted, new: _Admitted, sides: Sides) -> Iterator[Draft]:
    """Identities that peers let in in both keystores, but other peers, or from or until another time."""
    both = frozenset(sides.common)  # what others take is said with them
    for identity, by_profile in new.items():
        found: dict[tuple[Direction, Aspect], list[str]] = {}
        before = old.get(identity, {})
        for profile in (each for each in by_profile if each in before):  # in order: the first one's places are shown
            one, other = before[profile], by_profile[profile]
            more, fewer = other.beyond(one, both, sides.at), one.beyond(other, both, sides.at)
            if more or fewer:
                direction = direction_of(gains=bool(more), losses=bool(fewer))
                paths = more | fewer
                aspect = Aspect(what="let in", old=one.by(paths), new=other.by(paths), direction=direction)
                found.setdefault((direction, aspect), []).append(profile)
        for (direction, aspect), profiles in found.items():
            yield _at_large(
                identity,
                _VERBS[direction],
                direction,
                in_order(profiles, sides),
                (aspect,),
                old=before[profiles[0]].place,
                new=by_profile[profiles[0]].place,
            )


_VERBS: Final = {
    Direction.GAINED: "more peers, or peers for longer, let in",
    Direction.LOST: "fewer peers, or peers for shorter, let in",
    Direction.MIXED: "other peers, or peers at other times, let in",
}


def _admitted(keystore: Keystore, sides: Sides) -> _Admitted:
    """By identity and profile, who takes its certificates, and the place of the first."""
    found: dict[_Identity, dict[str, _Taken]] = {}
    strays = [len(each.identities.found) for each in sides.keystores]
    asked = _Asked(keystore, sides, max(strays))
    if keystore.identities.found:  # nearly never
        for profile in sides.profiles:
            for each in admitted(keystore, keystore.identities.found, (profile,), sides.at):
                certificate = each.certificate
                by_profile = found.setdefault((certificate.subject, certificate.key, asked.which(certificate)), {})
                taken = by_profile.setdefault(profile.name, _Taken(place=place_of(certificate)))
                taken.add(certificate, asked.takers(certificate, (profile,)))
    return found


class _Asked:
    """Who takes certificates of a keystore, where they are at most `count` of either; else nobody is asked."""

    def __init__(self, keystore: Keystore, sides: Sides, count: int) -> None:
        enclaves = max(len(each.enclaves) for each in sides.keystores)
        self._takers = Takers(keystore, sides.at) if 0 < count * enclaves <= MAX_PAIRS else None

    def which(self, certificate: Certificate) -> str:
        """What tells it from others of its name: nothing where it is known who takes it."""
        return certificate.sha256 if self._takers is None else ""

    def takers(self, certificate: Certificate, profiles: Sequence[Profile]) -> Iterable[str]:
        """The enclaves that take it."""
        return () if self._takers is None else self._takers.of(certificate, profiles)


def identities_certified_again(sides: Sides) -> Iterator[tuple[str, Placed]]:
    """The enclaves of either keystore whose identity key has other certificates there than before (KA228).

    Or whose further certificates other peers take than before, or from or until another time.
    """
    old, new = ({enclave.path: others for enclave, others in certified_again(each)} for each in sides.keystores)
    both = frozenset(sides.common)  # what others take is said with them
    count = max(sum(map(len, each.values())) for each in (old, new))
    asked = [_Asked(keystore, sides, count) for keystore in sides.keystores]
    for path in sorted({*old, *new}):
        one = _by_name(old.get(path, ()), asked[0], sides.profiles)
        other = _by_name(new.get(path, ()), asked[1], sides.profiles)
        gone, come = (_differing(*pair, both, sides.at) for pair in ((one, other), (other, one)))
        if not gone and not come:
            continue
        direction = direction_of(gains=bool(come), losses=bool(gone))
        names = {*gone, *come}
        texts = [_words(side, sorted(names & side.keys()), one.keys() & other.keys(), both) for side in (one, other)]
        aspect = Aspect(what="certified as", old=texts[0] or None, new=texts[1] or None, direction=direction)
        verb = {Direction.GAINED: "has further certificates", Direction.LOST: "has fewer further certificates"}
        what = f"its identity key {verb.get(direction, 'has other further certificates')}"
        # Whom grants name by these subjects, each implementation says in its own way.
        fact = Fact("identity-certified-again", direction, what, (aspect,), whole=True)
        places = [found[min(names & found.keys() or found)].place if found else None for found in (one, other)]
        yield path, (fact, places[0], places[1])


_Name = tuple[str, str, str, str]
"""Key, subject and issuer; and which certificate, as of `_Identity`."""

_ByName = Mapping[_Name, _Taken]


def _differing(one: _ByName, other: _ByName, paths: Collection[str], at: datetime) -> list[_Name]:
    """Names that are in `one` alone, or whose certificates there are taken when they are not in `other`."""
    return [name for name, taken in one.items() if name not in other or taken.beyond(other[name], paths, at)]


def _words(side: _ByName, names: Iterable[_Name], in_both: Collection[_Name], paths: Collection[str]) -> str:
    """Whom they name, and who issued them; where both keystores have such certificates, also who takes them."""
    texts = []
    for name in names:
        _key, subject, issuer, _which = name
        taken = f", let in {side[name].by(paths)}" if name in in_both else ""
        texts.append(f"{subject}, issued by {issuer}{taken}")
    return ", ".join(texts)


def _by_name(certificates: Iterable[Certificate], asked: _Asked, profiles: Sequence[Profile]) -> _ByName:
    """By name who takes the certificates, and the place of the first."""
    found: dict[_Name, _Taken] = {}
    for certificate in certificates:
        name = certificate.key, certificate.subject, certificate.issuer, asked.which(certificate)
        taken = found.setdefault(name, _Taken(place=place_of(certificate)))
        taken.add(certificate, asked.takers(certificate, profiles))
    return found
