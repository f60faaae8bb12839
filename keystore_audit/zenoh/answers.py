"""Whether an enclave may do something in a network: with its own file, and without it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cached_property, lru_cache
from itertools import islice
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.matching.key_expressions import EVERYTHING, intersects
from keystore_audit.model.names import ACTION_PART, ACTION_SERVICES, ACTION_TOPICS
from keystore_audit.model.question import WORDS
from keystore_audit.profiles import Release
from keystore_audit.truth import Truth, all_of, any_of
from keystore_audit.zenoh.access_control import Key, Kind, Meant
from keystore_audit.zenoh.links import OBSTACLES, Links, Message, Tie, Way, find_way
from keystore_audit.zenoh.names import MAX_RIGHTS, Named
from keystore_audit.zenoh.network import Network, Process, is_session

MAX_WIDE: Final = 20
"""Expressions of rules that an attacker is tried with. Whether one of the others passes is then uncertain."""

_PUT, _SUBSCRIBE, _QUERY, _REPLY, _SERVE = Kind.PUT, Kind.SUBSCRIBE, Kind.QUERY, Kind.REPLY, Kind.SERVE
Passing = tuple[tuple[Kind, bool], ...]
"""What has to pass: kinds of messages, away from the acting side or back to it."""
EFFECTIVE: Final[Mapping[str, Passing]] = {
    "publish": ((_PUT, True), (_SUBSCRIBE, False)),
    "subscribe": ((_SUBSCRIBE, True), (_PUT, False)),
    "request": ((_QUERY, True), (_SERVE, False)),
    "reply": ((_SERVE, True), (_QUERY, False), (_REPLY, True)),
}
"""By operation what has to pass. A query runs a service, even if nobody hears the reply."""
PASSING: Final = {**EFFECTIVE, "request": (*EFFECTIVE["request"], (_REPLY, False))}
"""The same where the acting side wants the reply."""
SENDING: Final = ("publish", "request")
"""The operations that put something into what others hear."""

_TYPE: Final = "/$*::$*/*"
_ROLES: Final = {"call": ("request", "subscribe"), "execute": ("reply", "publish")}


def channels(operation: str, name: str, domain: int) -> tuple[tuple[str, str], ...]:
    """What an operation on a name of ROS 2 takes: publish, subscribe, request or reply, and the key expression.

    The last two chunks of a key are the type, as `std_msgs::msg::dds_::String_`, and its hash, which the question
    leaves open (rmw_zenoh_cpp, liveliness_utils.cpp).
    """
    if operation not in _ROLES:
        return ((operation, f"{domain}{name}{_TYPE}"),)
    service, topic = _ROLES[operation]
    parts = [(service, each) for each in ACTION_SERVICES] + [(topic, each) for each in ACTION_TOPICS]
    return tuple((role, f"{domain}{name}{ACTION_PART}{each}{_TYPE}") for role, each in parts)


def plain(key: str) -> str:
    """The key as rules write it, for any type."""
    return key.replace(_TYPE, "/*/*")


class Reached(Struct, frozen=True):
    """Whether an operation reaches somebody, over which links if it does, else what stands in its way."""

    truth: Truth
    way: Way = ()
    location: Location | None = None
    reason: str = ""

    @property
    def last(self) -> Process:
        """Whom it reaches."""
        return self.way[-1].far


class RoutedAnswer(Struct, frozen=True):
    """What becomes of an operation with the enclave's own file, and without it; of an action, the worst of it."""

    works: Reached
    could: Reached

    @property
    def decided(self) -> str:
        """The answer with its own file, in a word, as `model.question` has it."""
        return WORDS[self.works.truth]

    @property
    def accepted(self) -> str:
        """The answer without it."""
        return WORDS[self.could.truth]


class RoutedAnswers(Struct, frozen=True, kw_only=True):
    """A question and its answers by release. `keys`: what it is about. `doubts`: why nothing is denied for certain."""

    enclave: str
    operation: str
    name: str
    domain: int
    at: datetime
    folder: str
    keys: tuple[str, ...]
    answers: Mapping[str, RoutedAnswer]
    doubts: tuple[tuple[Location, str], ...]


class RoutedRight(Struct, frozen=True, kw_only=True):
    """An operation of an enclave on a name of ROS 2, and what becomes of it, by release."""

    enclave: str
    operation: str
    name: str
    answers: Mapping[str, RoutedAnswer]

    @property
    def gained(self) -> Truth:
        """Whether the enclave can do it by dropping its own file, and not otherwise, under some release."""
        return any_of(all_of((each.could.truth, each.works.truth.negated)) for each in self.answers.values())


class RoutedTable(Struct, frozen=True, kw_only=True):
    """All rights of topics and services that permissions and rules name. `patterns`: what they write that names more
    than one. `doubts`: why nothing is denied for certain.
    """

    domain: int
    at: datetime
    folder: str
    releases: tuple[str, ...]
    rights: tuple[RoutedRight, ...]
    patterns: tuple[str, ...]
    doubts: tuple[tuple[Location, str], ...]

    @property
    def has_unknown(self) -> bool:
        """Whether something cannot be told."""
        answers = (each for right in self.rights for each in right.answers.values())
        return bool(self.doubts) or any(Truth.UNKNOWN in (each.works.truth, each.could.truth) for each in answers)


class RoutedChange(Struct, frozen=True, kw_only=True):
    """What an enclave can do by others' files in the one network and not in the other, or with its own file.

    `gained`: whether it can do more without its file, by some release; UNKNOWN where that cannot be told. `before` and
    `after`: by release what becomes of it; None where there is no such enclave.
    """

    enclave: str
    operation: str
    name: str
    gained: Truth
    before: Mapping[str, RoutedAnswer] | None
    after: Mapping[str, RoutedAnswer] | None


def changes(old: RoutedTable, new: RoutedTable) -> tuple[RoutedChange, ...]:
    """What differs between tables of the same rights, what is gained first."""
    sides = [{(each.enclave, each.operation, each.name): each.answers for each in table.rights} for table in (old, new)]
    found = []
    for right in dict.fromkeys((*sides[0], *sides[1])):
        before, after = (side.get(right) for side in sides)
        if _said(before) == _said(after):
            continue
        had = {release: each.could.truth for release, each in (before or {}).items()}
        more = ((each.could.truth, had.get(release, Truth.NO).negated) for release, each in (after or {}).items())
        gained = any_of(map(all_of, more))
        enclave, operation, name = right
        found.append(
            RoutedChange(enclave=enclave, operation=operation, name=name, gained=gained, before=before, after=after)
        )
    return tuple(sorted(found, key=lambda each: OBSTACLES.index(each.gained), reverse=True))


def _said(answers: Mapping[str, RoutedAnswer] | None) -> Mapping[str, tuple[str, str]] | None:
    return {name: (each.decided, each.accepted) for name, each in answers.items()} if answers is not None else None


def _least(found: Iterable[Reached]) -> Reached:
    return min(found, key=lambda each: OBSTACLES.index(each.truth))


class Rights:
    """Who may do what in a network."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self.links = Links(network)
        self._wide: dict[str, list[str]] = {}  # by key, since many ask about each

    @cached_property
    def doubts(self) -> tuple[tuple[Location, str], ...]:
        """Why more may be possible than is worked out."""
        unseen = (
            (process.at(end.line), "it connects to where no process of the folder listens")
            for process, end in self.links.unseen
        )
        return (*self._network.doubts, *unseen)

    def answer(self, enclave: Enclave, operation: str, name: str, domain: int, release: Release) -> RoutedAnswer:
        """Whether it works with its own file and another that accepts it, and whether it would without its own."""
        asked = channels(operation, name, domain)
        return RoutedAnswer(
            _least(self.works(enclave, role, key, release) for role, key in asked),
            _least(self.could(enclave, role, key, release) for role, key in asked),
        )

    def _processes(self, enclave: Enclave) -> tuple[Process, ...]:
        return tuple(each for each in self._network.processes if each.owner is enclave)

    def works(self, enclave: Enclave, operation: str, key: str, release: Release) -> Reached:
        """Whether one of its processes does it, files as they are."""
        own = self._processes(enclave)
        if not own:
            return Reached(Truth.UNKNOWN, reason="no file names its certificate: what it starts with is not known")
        started = [each for each in own if each.says.starts]
        if not started:
            refusal = own[0].says.refusals[0]
            return Reached(Truth.NO, (), own[0].at(refusal.line), f"it does not start: {refusal.reason}")
        found = [self._works(each, operation, key, release) for each in started]
        return max(found, key=lambda each: OBSTACLES.index(each.truth))

    def _works(self, process: Process, operation: str, key: str, release: Release) -> Reached:
        messages = to_pass(PASSING[operation], Key(key), Key(key))
        begins, ends = self.links.of(process), _other(process.owner)
        for certain in (True, False):
            way = find_way(self.links, begins, messages, ends, release, certain=certain)
            if way is not None:
                return _told(Truth.YES if certain else Truth.UNKNOWN, way, way[0], messages, release)
        if self.doubts:
            location, why = self.doubts[0]
            return Reached(Truth.UNKNOWN, (), location, why)
        if not begins:
            return Reached(Truth.NO, (), process.at(None), "it has a link to no other process")
        tie = _obstacle(begins, messages, release)
        told = _told(Truth.NO, (), tie, messages, release)
        if tie.crossed(messages, release) is Truth.YES:
            return replace(told, reason=f"{told.reason}, but it gets no further than {tie.far.name}")
        return told

    def could(self, enclave: Enclave | None, operation: str, key: str, release: Release) -> Reached:
        """Whether somebody with its key and without its file does it; None: with no key."""
        begins = self.links.attacks(enclave)
        for first in self._chosen(key):
            messages = to_pass(EFFECTIVE[operation], first, Key(key))
            certain = first.meant is not Meant.ANY
            way = find_way(self.links, begins, messages, _other(enclave), release, certain=certain)
            if way is not None:
                return _told(Truth.YES if certain else Truth.UNKNOWN, way, way[-1], messages, release)
        return Reached(Truth.UNKNOWN if self.doubts else Truth.NO)

    def _chosen(self, key: str) -> Iterator[Key]:
        """What an attacker's message may be about: the key, what rules name and meets it, and last whatever meets it.
        That the last passes is not certain; if it does not, no message does.
        """
        yield Key(key)
        if key not in self._wide:
            self._wide[key] = [*islice((text for text in self._allowed if intersects(text, key)), MAX_WIDE)]
        yield from (Key(text, Meant.ONE) for text in self._wide[key])
        yield Key(key, Meant.ANY)

    @cached_property
    def _allowed(self) -> tuple[str, ...]:
        """The expressions that rules allow, and that for everything, each once."""
        rules = (rule for process in self._network.started for rule in process.says.rules if rule.allow)
        return tuple(dict.fromkeys((EVERYTHING, *(text for rule in rules for text, _line in rule.keys))))


def routed_table(
    keystore: Keystore,
    network: Network,
    named: Named,
    domain: int,
    at: datetime,
    releases: Sequence[Release],
) -> RoutedTable:
    """What every enclave of the keystore may do of all that is named.

    Raises errors.BudgetExceeded for more than MAX_RIGHTS rights.
    """
    if len(named.rights) * len(keystore.enclaves) > MAX_RIGHTS:
        raise BudgetExceeded(f"More than {MAX_RIGHTS} rights are named; `can` answers about one.")
    rights = rights_in(network)
    found = tuple(
        RoutedRight(
            enclave=enclave.path,
            operation=operation,
            name=name,
            answers={each.name: rights.answer(enclave, operation, name, domain, each) for each in releases},
        )
        for enclave in keystore.enclaves
        for operation, name in named.rights
    )
    return RoutedTable(
        domain=domain,
        at=at,
        folder=network.path,
        releases=tuple(each.name for each in releases),
        rights=found,
        patterns=named.patterns,
        doubts=rights.doubts,
    )


@lru_cache(maxsize=1)
def rights_in(network: Network) -> Rights:
    """The rights in a network. All who ask in one audit share its links."""
    return Rights(network)


def _told(truth: Truth, way: Way, tie: Tie, messages: Sequence[Message], release: Release) -> Reached:
    """With the decision on that link: whose file, and which line."""
    process, decision = tie.decisive(messages, release)
    return Reached(truth, way, process.at(decision.line), decision.reason)


def _obstacle(begins: Iterable[Tie], messages: Sequence[Message], release: Release) -> Tie:
    """The link on which least stands in the way."""
    return max(begins, key=lambda tie: OBSTACLES.index(tie.crossed(messages, release)))


def to_pass(passing: Passing, first: Key, rest: Key, replied: Key | None = None) -> tuple[Message, ...]:
    """What has to pass. `first`: what is asked for or sent; `rest`: what comes of it. `replied`: what replies are
    about, where that differs (they have keys of their own: measured).
    """
    reply = replied or rest
    return tuple(Message(kind, away, reply if kind is _REPLY else first if away else rest) for kind, away in passing)


def _other(enclave: Enclave | None) -> Callable[[Process], bool]:
    """Whether nodes of others run in a process."""
    return lambda process: is_session(process) and (enclave is None or process.owner is not enclave)
