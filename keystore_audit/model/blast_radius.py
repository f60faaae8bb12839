"""What somebody can do who holds the key of an enclave or of an authority: its blast radius (docs/model.md).

Rights and keys come from `model.formal.attacker`, hops and flows from `model.formal.flow` and `model.formal.influence`.
Nothing is decided here again. Names are those that the documents tell apart, each with a channel of its own in every
governed domain.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from functools import cached_property
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import ANY_TOPIC, MAX_CELLS, Channels
from keystore_audit.model.formal.asked import Attacker, Place, Search
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import bits, members, union
from keystore_audit.model.formal.flow import Flows, Lane
from keystore_audit.model.formal.influence import Influence
from keystore_audit.model.formal.system import System
from keystore_audit.model.inventory import documents_of, system_documents
from keystore_audit.model.names import AMBIENT
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.model.tables.access_table import Named, names_of
from keystore_audit.profiles import VARIANTS, Profile

MAX_RANKED: Final = 2_000
"""Enclaves beyond which none is ranked: five seconds and more."""

MAX_TEXTS: Final = 5_000
MAX_TEXTS_PER_ENCLAVE: Final = 200
"""Distinct expressions of a keystore, and more for each enclave, beyond which none is ranked.

`ros2 security` writes 60 for a node, a hostile document has 20,000."""

MAX_NAMES: Final = 20_000
"""Names in partitions, those in the default partition apart, beyond which no enclave is ranked: a fifth of a second.

200 topics each in 20 partitions have 4,000."""

MAX_VIEWS: Final = 20_000
"""Pairs of an enclave and a trust domain that judges it: hundreds, each with CAs or a governance of its own."""

ANY_NAME: Final = Named(topic=ANY_TOPIC, partition="", ros=True, several=True, expressions=())
"""All topics of a domain that no governance covers."""


class BlastRadius(Struct, frozen=True, kw_only=True):
    """What the holder of keys can do. Sets of channels are bit sets; enclaves go by their paths.

    `written`: topics that peers take its samples on by right. `forged`: others, on which it passes for a writer.
    `read`: topics whose payload it reads. In these two is what anybody on the network can. `passes_for`: enclaves that
    peers cannot tell it from, and unmanaged identities, by their labels. `reached_alone`: enclaves that its data can
    get to as long as everybody else stays honest; `reached`: if all on the way are compromised too. `learns`: it reads
    what somebody else may write.
    """

    written: int = 0
    forged: int = 0
    read: int = 0
    passes_for: frozenset[str] = frozenset()
    reached_alone: frozenset[str] = frozenset()
    reached: frozenset[str] = frozenset()
    learns: bool = False

    @property
    def beyond_itself(self) -> bool:
        """Whether its keys give it anything of somebody else's."""
        return bool(self.passes_for or self.reached or self.learns)


NOTHING: Final = BlastRadius()


class Radii:
    """The blast radii of one system now. `left_out`: channels (bit set) that no flow takes."""

    def __init__(self, system: System, left_out: int) -> None:
        self._system = system
        self._trust_domains = trust_domain_views(system)
        self._flows = Flows(system, self._trust_domains)
        self._kept = ~left_out
        self._everybody = range(len(system.enclaves))
        self._enclaves = bits(number for number, enclave in enumerate(system.enclaves) if not enclave.unmanaged)

    def authenticated(self, enclave: int) -> bool:
        """Whether some enclave takes it for one of its own."""
        return any(view.authenticated(enclave) for view in self._trust_domains)

    def of(self, enclave: int) -> BlastRadius:
        """The blast radius of the enclave's key, and so of all enclaves with the same key."""
        acting = frozenset(self._flows.acting(enclave))
        written, forged, read = self.abilities(acting)
        mine = bits(acting)
        others = union(  # by right, or though honest peers refuse it
            view.abilities(number).writes_at_all
            for number in self._everybody
            if number not in acting
            for view in self._trust_domains
        )
        return BlastRadius(
            written=written,
            forged=forged,
            read=read,
            passes_for=self._paths(mine & ~(1 << enclave)),
            reached_alone=self._paths(self.reached_alone(enclave) & ~mine),
            reached=self._paths(self.reached(enclave) & ~mine),
            learns=bool(read & others),
        )

    def abilities(self, acting: Iterable[int]) -> tuple[int, int, int]:
        """Channels that the enclaves write by right, forge as well, and read, if only as anybody on the network can."""
        written = 0
        forged, read = self._flows.injectable, self._flows.readable
        for number in acting:
            for view in self._trust_domains:
                able = view.abilities(number)
                written |= able.may_write
                forged |= able.forges
                read |= able.knows
        return written, forged & ~written, read

    def acting(self, enclave: int) -> Iterable[int]:
        """The enclaves whose key it has, or may have."""
        return self._flows.acting(enclave)

    def reached(self, enclave: int) -> int:
        """The enclaves that its data can get to if all on the way are compromised."""
        return self._attacked[enclave] & self._enclaves

    def reached_alone(self, enclave: int) -> int:
        """The enclaves that its data can get to if nobody else is."""
        by_right = self._by_right
        forged_to = members(self._forged_to[enclave] & ~by_right[enclave])
        return (by_right[enclave] | union(by_right[node] for node in forged_to)) & self._enclaves

    @cached_property
    def _attacked(self) -> list[int]:
        return self._influence(Attacker.RELAYS).flows

    @cached_property
    def _by_right(self) -> list[int]:
        return self._influence(Attacker.HONEST).flows

    @cached_property
    def _forged_to(self) -> list[int]:
        """By participant, who accepts what it makes with its keys."""
        return self._influence(Attacker.SOURCE).hops

    def _influence(self, attacker: Attacker) -> Influence:
        everybody = Place(enclaves=frozenset(self._everybody))
        lanes = self._flows.lanes(Search(attacker=attacker, source=everybody))
        kept = self._kept
        masked = [
            Lane(puts=[one & kept for one in lane.puts], gets=[one & kept for one in lane.gets]) for lane in lanes
        ]
        return Influence(masked, len(self._system.enclaves) + 1)

    def _paths(self, enclaves: int) -> frozenset[str]:
        return frozenset(self._system.enclaves[number].label for number in members(enclaves))


class Topic(NamedTuple):
    """A name, or all names of a class, in domains (in words)."""

    name: Named
    domains: tuple[str, ...]


class Ground:
    """A keystore's systems over names. `left_out`: ambient topics, as a bit set of channels."""

    def __init__(
        self, names: tuple[Named, ...], channels: Channels, systems: tuple[System, ...], left_out: int
    ) -> None:
        self.names = names
        self.channels = channels
        self.systems = systems
        self.left_out = left_out

    def topics(self, channels: int) -> tuple[Topic, ...]:
        """The names among the channels, each once."""
        found: dict[Named, list[str]] = {}
        for number in members(channels):
            atom = self.channels.channels[number]
            found.setdefault(self._name(number, atom.domain), []).append(self.channels.domains[atom.domain].label)
        return tuple(Topic(name, tuple(domains)) for name, domains in found.items())

    def _name(self, channel: int, domain: int) -> Named:
        here = self.channels.in_domain[domain]  # one for each name, or one for all
        return self.names[channel - here.start] if len(here) == len(self.names) else ANY_NAME

    @cached_property
    def endless(self) -> int:
        """The channels (bit set) that stand for classes of names without end."""
        several = bits(number for number, name in enumerate(self.names) if name.several)
        return union((several if len(here) == len(self.names) else 1) << here.start for here in self.channels.in_domain)

    def count(self, channels: int) -> int:
        """How many names are among the channels, each class of names as one; as many as `topics`."""
        folded, any_name = 0, False
        for here in self.channels.in_domain:
            held = channels >> here.start & (1 << len(here)) - 1
            if len(here) == len(self.names):
                folded |= held
            else:
                any_name = any_name or held != 0
        return folded.bit_count() + any_name


def ground(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    *,
    include_ambient: bool = False,
    most: int = MAX_CELLS,
) -> Ground:
    """The systems of a keystore at `at` (aware UTC), name by name.

    `most`: names as in `named.names_of`. Raises errors.BudgetExceeded where they are of too many classes.
    """
    files = (document.file for document in system_documents(keystore))
    names, _rest = names_of(accesses.by_row(profiles, files), most)
    points = [(name.topic, name.partition) for name in names]
    builder = SystemBuilder(keystore, profiles, at, accesses, points, literal=False)
    systems = builder.systems()
    ambient = [n for n, name in enumerate(names) if name.topic in AMBIENT and not name.several]
    whole = [here.start for here in builder.channels.in_domain if len(here) == len(names)]
    return Ground(
        names=names,
        channels=builder.channels,
        systems=systems,
        left_out=0 if include_ambient else bits(start + name for start in whole for name in ambient),
    )


class Ranked(Struct, frozen=True, kw_only=True):
    """The blast radius of the enclave `path` in numbers.

    Topics are DDS topic names that documents tell apart. `endless`: those that it writes, forges or reads include an
    infinite class of names. Enclaves reached: if all on the way are compromised, and if nobody else is.
    """

    path: str
    topics_written: int
    topics_forged: int
    topics_read: int
    endless: bool
    passes_for: int
    enclaves_reached: int
    enclaves_reached_alone: int

    @property
    def size(self) -> tuple[int, ...]:
        """What ranks it: what it can write first."""
        topics = self.topics_written + self.topics_forged
        return (topics, self.enclaves_reached, self.enclaves_reached_alone, self.passes_for, self.topics_read)


class Ranking(Struct, frozen=True, kw_only=True):
    """Every enclave that has a path, the largest blast radius first, equal ones by path, under these profiles.

    What could not be read counts as able to do anything.
    """

    profiles: tuple[str, ...]
    enclaves: tuple[Ranked, ...]


def ranked_enclaves(
    keystore: Keystore, profiles: Sequence[Profile], at: datetime, accesses: AccessViews
) -> tuple[Ranking, ...]:
    """The rankings of a keystore at `at` (aware UTC), without ambient topics; none where that is too much work."""
    enclaves = len(keystore.enclaves)
    if enclaves > MAX_RANKED or _has_more_texts(keystore, MAX_TEXTS + MAX_TEXTS_PER_ENCLAVE * enclaves):
        return ()
    try:
        known = ground(keystore, profiles, at, accesses, most=MAX_NAMES)
    except BudgetExceeded:
        return ()
    if any(len(system.trust_domains) * len(system.enclaves) > MAX_VIEWS for system in known.systems):
        return ()
    return rankings(known)


def _has_more_texts(keystore: Keystore, most: int) -> bool:
    """Whether the keystore's permissions have more than `most` distinct expressions."""
    found: set[str] = set()
    for document in documents_of(keystore):
        for grant in document.file.grants if isinstance(document.file, PermissionsFile) else ():
            for rule in grant.rules:
                found.update(text.text for criterion in rule.criteria for text in criterion.topics)
            if len(found) > most:
                return True
    return False


def rankings(known: Ground) -> tuple[Ranking, ...]:
    """One for each way in which profiles see the keystore, that of the most profiles first."""
    found: dict[tuple[Ranked, ...], list[str]] = {}
    for system in known.systems:
        if system.may:
            ranked = sorted(_ranked(known, system), key=lambda one: ([-number for number in one.size], one.path))
            found.setdefault(tuple(ranked), []).extend(system.profiles)
    order = {name: place for place, name in enumerate(VARIANTS)}
    every = (
        Ranking(profiles=tuple(sorted(profiles, key=lambda name: order.get(name, len(order)))), enclaves=ranked)
        for ranked, profiles in found.items()
    )
    return tuple(sorted(every, key=lambda ranking: -len(ranking.profiles)))


def _ranked(known: Ground, system: System) -> Iterator[Ranked]:
    radii, endless = Radii(system, known.left_out), known.endless
    for number, enclave in enumerate(system.enclaves):
        if enclave.unmanaged or not enclave.label.startswith("/"):  # whatever is behind a link that leads away
            continue
        acting = bits(radii.acting(number))
        written, forged, read = radii.abilities(members(acting))
        yield Ranked(
            path=enclave.label,
            topics_written=known.count(written),
            topics_forged=known.count(forged),
            topics_read=known.count(read),
            endless=bool((written | forged | read) & endless),
            passes_for=acting.bit_count() - 1,
            enclaves_reached=(radii.reached(number) & ~acting).bit_count(),
            enclaves_reached_alone=(radii.reached_alone(number) & ~acting).bit_count(),
        )
