"""Who can have something in a network, and about which keys it may be asked.

A *class* is an expression that rules allow, and stands for those keys of it that no other one has more narrowly. Of all
expressions by which a message passes one is the narrowest, so that what passes does so in its class. Whether something
may pass is asked of each class; whether it does, of a key that nodes of ROS 2 have.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cache, cached_property
from itertools import count, product
from pathlib import Path
from typing import Final

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded, UsageError
from keystore_audit.grouped import gathered
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.claims.claims import check_places
from keystore_audit.model.claims.globs import all_matching
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.model.matching.key_expressions import EVERYTHING, VERBATIM, includes
from keystore_audit.model.names import AMBIENT, TOPIC_PREFIX
from keystore_audit.zenoh.access_control import Key, Kind, Meant
from keystore_audit.zenoh.answers import EFFECTIVE, rights_in
from keystore_audit.zenoh.names import rule_domains
from keystore_audit.zenoh.network import Network, Process, is_session, read_network

MAX_WORK: Final = 350_000
"""Processes times participants and expressions of rules. It takes 10 to 15 s (40 peers, 177 expressions)."""

PUBLISH: Final = "publish"
SENT: Final = {each: EFFECTIVE[each] for each in (PUBLISH, "request", "reply")}
"""For each way to put something out, what has to pass."""
DELETED: Final = ((Kind.DELETE, True), (Kind.SUBSCRIBE, False))
"""The same for an attacker: nodes of ROS 2 delete nothing."""
_CACHED: Final = "**/@adv/**"
"""Where earlier samples are asked for (rmw_zenoh_cpp)."""
_TOPIC: Final = f"{TOPIC_PREFIX}/"
_PART: Final = "$*"


class Participant(Struct, frozen=True, kw_only=True, eq=False):
    """An enclave, a process of none, or (`who` None) somebody without a key.

    `sessions`: where its nodes run. `unseen`: it has no file, so that nobody knows what it starts with.
    """

    label: str
    who: Enclave | Process | None
    sessions: tuple[Process, ...] = ()
    unseen: bool = False


OUTSIDER: Final = Participant(label="outsider", who=None)


class End(Struct, frozen=True, kw_only=True):
    """Where a flow begins or ends: participants, or topics as expressions of keys."""

    participants: tuple[Participant, ...] = ()
    topics: tuple[str, ...] = ()


class Question(Struct, frozen=True, kw_only=True):
    """Whether something gets from one end to another, over nobody of `through`, while these attack. `ambient`: on what
    all use, too.
    """

    source: End
    target: End
    attacking: tuple[Participant, ...] = ()
    through: tuple[Participant, ...] = ()
    ambient: bool = False


class NetworkFlows:
    """Flows in a network."""

    def __init__(self, keystore: Keystore, network: Network) -> None:
        self.network = network
        self.rights = rights_in(network)
        self.keystore = keystore
        self.classes = cache(self._classes)

    @cached_property
    def participants(self) -> tuple[Participant, ...]:
        """All to whom something can come."""
        found: list[Participant] = []
        for enclave in self.keystore.enclaves:
            own = [each for each in self.network.processes if each.owner is enclave]
            running = tuple(each for each in own if each.says.starts and is_session(each))
            found.append(Participant(label=enclave.path, who=enclave, sessions=running, unseen=not own))
        nobodys = (
            Participant(label=each.path, who=each, sessions=(each,) if is_session(each) else ())
            for each in self.network.started
            if each.owner is None
        )
        return (*found, *nobodys, OUTSIDER)

    def asked(self, claim: Claim) -> Question:
        """What a no-flow claim asks. Raises UsageError for a name that is not there, or is no key."""
        check_places(claim, [each.path for each in self.keystore.enclaves])
        ends = (
            End(
                participants=(OUTSIDER,) if globs.outsider else self.named(globs.enclaves),
                topics=tuple(key for each in globs.topics for key in self._keys(each)),
            )
            for globs in (claim.source, claim.target)
        )
        source, target = ends
        attacking = {Attacker.SOURCE: source.participants, Attacker.RELAYS: self.participants}
        return Question(
            source=source,
            target=target,
            attacking=attacking.get(claim.attacker, ()),
            through=self.named(claim.through),
            ambient=claim.include_ambient,
        )

    def named(self, globs: Iterable[str]) -> tuple[Participant, ...]:
        """The enclaves that globs name."""
        known = all_matching(globs, [enclave.path for enclave in self.keystore.enclaves])
        return tuple(each for each in self.participants if isinstance(each.who, Enclave) and each.label in known)

    def _keys(self, topic: str) -> Iterator[str]:
        """The keys of a glob on topics, in each domain that rules name and in any; its `*` stands for `/` too."""
        name = topic.removeprefix(_TOPIC)
        if name == topic or {*name}.intersection("?[]\\@#$"):
            raise UsageError(f"{topic!r} is no key of this middleware: expected topic:/NAME, with no pattern but *.")
        parts = name.split("*")
        for between in product((_PART, f"{_PART}/{EVERYTHING}/{_PART}"), repeat=len(parts) - 1):
            text = "".join(map("".join, zip(parts, (*between, ""), strict=True)))
            chunks = ["*" if chunk == _PART else chunk for chunk in text.split("/")]
            for domain in (*map(str, rule_domains(self.network)), "*"):
                yield "/".join((domain, *chunks, "*", "*"))

    def check_size(self) -> None:
        """Raise BudgetExceeded where it would take too long."""
        if (len(self.network.started) * len(self.participants) + len(self._written)) * len(self._written) > MAX_WORK:
            raise BudgetExceeded(f"{self.network.path} has too many processes and expressions of rules for flows.")

    @cached_property
    def _written(self) -> dict[tuple[str, bool], frozenset[str]]:
        """What rules are about, by expression and whether they allow it, and of which kinds of messages."""
        rules = [rule for each in self.network.started for rule in each.says.rules]
        found = gathered(((text, rule.allow), rule.kinds) for rule in rules for text, _line in rule.keys)
        return {said: frozenset[str]().union(*kinds) for said, kinds in found.items()}

    def _classes(self, does: str, topics: tuple[str, ...], ambient: bool) -> Mapping[str, str | None]:
        """By class of what is done, a key of it that nodes of ROS 2 may have; None: none is known.

        Of topics alone where these are given. Classes that all rules take for alike are one.
        """
        kinds = {kind.value for kind, _away in (*SENT[does], *(DELETED if does == PUBLISH else ()))}
        rules = [said for said, of_kinds in self._written.items() if kinds & of_kinds]
        written = [text for text, allow in rules if allow]
        unheard = f"{VERBATIM}{'_' * max((len(text) for text, _allow in rules), default=0)}/{EVERYTHING}"
        apart = apart_from(does, topics, ambient=ambient)
        found: dict[object, tuple[str, str | None]] = {}
        for text in dict.fromkeys((*written, *topics, EVERYTHING, _CACHED, unheard)):
            key, example = Key(text, Meant.EACH, apart), self._example(text)
            if any(includes(each, text) for each in apart):
                continue
            if topics:
                if not any(key.has(each, allow=True).may for each in topics):
                    continue
                example = example if any(includes(each, example or EVERYTHING) for each in topics) else None
            tried = [key] if example is None else [key, Key(example)]
            alike = tuple(each.has(rule, allow=allow) for rule, allow in rules for each in tried)
            found.setdefault(alike, (text, example))
        return dict(found.values())

    @cached_property
    def _other_domain(self) -> str:
        return next(f"{each}" for each in count() if each not in rule_domains(self.network))

    def _example(self, text: str) -> str | None:
        """A key of the expression that a node of ROS 2 may have: of a domain, a name, a type and its hash."""
        chunks = text.split("/")
        if EVERYTHING in chunks:
            at, missing = chunks.index(EVERYTHING), 4 - sum(each != EVERYTHING for each in chunks)
            chunks[at : at + 1] = ["*"] * missing
        first, *rest = [each for each in chunks if each != EVERYTHING]
        domain = self._other_domain if first == "*" else first.replace(_PART, "")
        key = "/".join((domain, *(each.replace(_PART, "any").replace("*", "any") for each in rest)))
        return key if domain.isdecimal() and len(rest) >= 3 and VERBATIM not in key else None


def flows_in(keystore: Keystore, folder: Path, at: datetime) -> NetworkFlows:
    """Flows by the files there, at an aware instant. Raises errors.NothingToAudit where there are none."""
    return NetworkFlows(keystore, read_network(folder, keystore, at))


def apart_from(does: str, topics: Sequence[str], *, ambient: bool) -> tuple[str, ...]:
    """The keys that are left out: of topics that nearly every node uses, where these are not asked about."""
    if does != PUBLISH or topics or ambient:
        return ()
    return tuple(f"*/{each.removeprefix(_TOPIC)}/*/*" for each in AMBIENT if each.startswith(_TOPIC))
