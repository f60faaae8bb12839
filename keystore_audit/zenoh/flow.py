"""Where data can go in a network, whatever nodes do: who puts something out, and to whom it comes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache, cached_property, lru_cache
from itertools import product
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.grouped import gathered
from keystore_audit.model.matching.key_expressions import EVERYTHING
from keystore_audit.profiles import Release
from keystore_audit.truth import Truth
from keystore_audit.zenoh.access_control import Flow, Key, Kind, Meant, Remote
from keystore_audit.zenoh.answers import Passing, to_pass
from keystore_audit.zenoh.configuration import SECURED, Configuration, Mode
from keystore_audit.zenoh.links import Tie, Way, decided, ways
from keystore_audit.zenoh.network import Process, is_session
from keystore_audit.zenoh.participants import (
    DELETED,
    OUTSIDER,
    PUBLISH,
    SENT,
    NetworkFlows,
    Participant,
    Question,
    apart_from,
)


class Hop(Struct, frozen=True, kw_only=True):
    """Something gets from one participant to another.

    `key`: what it is about. `way`: over which links, none where nothing is known of an end of them. `attack`, `heard`:
    whether the sender and the receiver go without their files. `location`: what lets it in.
    """

    sender: Participant
    receiver: Participant
    key: str
    way: Way = ()
    attack: bool = False
    heard: bool = False
    location: Location | None = None


class Keys(Struct, frozen=True, kw_only=True, eq=False):
    """What messages are about, by class."""

    every: tuple[Key, ...]


class Sent(Struct, frozen=True, kw_only=True, eq=False):
    """What is sent, of the classes `texts`: what the sender asks for or puts out, what comes of it, and what replies
    are about.
    """

    texts: tuple[str, ...]
    first: Keys
    rest: Keys
    replied: Keys


def _alike(process: Process, keys: Keys) -> tuple[tuple[Key, int], ...]:
    """The classes (bits) that all rules of a process take for alike, by what messages of one of them are about."""
    rules = {(text, rule.allow) for rule in process.says.rules for text, _line in rule.keys}
    found: dict[tuple[Truth, ...], tuple[Key, int]] = {}
    for number, key in enumerate(keys.every):
        told = tuple(key.has(text, allow=allow) for text, allow in rules)
        first, which = found.get(told, (key, 0))
        found[told] = first, which | 1 << number
    return tuple(found.values())


class Walks:
    """Searches over hops that are possible, or (`certain`) certain, while these attack. They listen, and so does the
    outsider.
    """

    def __init__(
        self,
        flows: NetworkFlows,
        attacking: frozenset[Participant],
        release: Release,
        *,
        ambient: bool,
        certain: bool,
    ) -> None:
        self._flows, self._release, self._ambient, self._certain = flows, release, ambient, certain
        self.attacking = attacking
        self.listening = tuple(each for each in flows.participants if each in attacking or each is OUTSIDER)
        self._nodes = {id(session): each for each in flows.participants for session in each.sessions}
        self._let = cache(self._let_by)
        self._sent = cache(self._sent_by)
        self._alike = cache(_alike)
        self.hops = cache(self._hops)

    def shortest(self, asked: Question) -> tuple[Hop, ...] | None:
        """The fewest hops by which something gets there; None: there are none."""
        source, target, through = asked.source, asked.target, asked.through
        came: dict[Participant, tuple[Hop, ...]] = dict.fromkeys(source.participants, ())
        senders = [each for each in self._flows.participants if source.topics and each not in through]
        for hop in (hop for each in senders for hop in self.hops(each, source.topics)):
            if hop.receiver in target.participants:
                return (hop,)
            if hop.receiver not in through:
                came.setdefault(hop.receiver, (hop,))
        for sender, before in (waiting := [*came.items()]):  # grows
            for hop in self.hops(sender, target.topics) if target.topics else ():
                if hop.receiver not in through:
                    return (*before, hop)
            further = target.participants or len({*came, *through}) < len(self._flows.participants)
            for hop in self.hops(sender, ()) if further else ():
                if hop.receiver in target.participants:
                    return (*before, hop)
                if hop.receiver not in came and hop.receiver not in through:
                    came[hop.receiver] = (*before, hop)
                    waiting.append((hop.receiver, came[hop.receiver]))
        return None

    def _hops(self, sender: Participant, topics: tuple[str, ...]) -> tuple[Hop, ...]:
        """To whom something comes that the sender puts out, on these topics alone where some are given: a hop each."""
        return tuple({(each.receiver, each.heard): each for each in reversed([*self._found(sender, topics)])}.values())

    def _found(self, sender: Participant, topics: tuple[str, ...]) -> Iterator[Hop]:
        if not self._certain and sender in self.attacking:
            for each in self.listening:
                if each is not sender and (sender.unseen or each.unseen):
                    yield Hop(sender=sender, receiver=each, key=EVERYTHING, heard=not each.unseen)
        for does, attack, heard in product((PUBLISH,) if topics else SENT, (False, True), (False, True)):
            begins = self._begins(sender, attack=attack, heard=heard)
            for passing in (SENT[does], DELETED) if attack and does == PUBLISH else (SENT[does],):
                for sent in self._sent(does, topics, attack, heard) if begins else ():
                    yield from self._reached(sender, begins, passing, sent, attack=attack, heard=heard)

    def _begins(self, sender: Participant, *, attack: bool, heard: bool) -> Sequence[Tie]:
        if attack:
            return self._flows.rights.links.attacks(sender.who) if sender in self.attacking else ()
        more, links = self._ears if heard else {}, self._flows.rights.links
        return [tie for each in sender.sessions for tie in (*links.of(each), *more.get(id(each), ()))]

    def _reached(
        self, sender: Participant, begins: Sequence[Tie], passing: Passing, sent: Sent, *, attack: bool, heard: bool
    ) -> Iterator[Hop]:
        ends, nodes = (self._ears, self._at_ears) if heard else ({}, self._nodes)

        def crossing(tie: Tie) -> int:
            there = tie.sure.must if self._certain else tie.sure.may
            found = (1 << len(sent.texts)) - 1 if there else 0
            for kind, away in passing:
                keys = sent.replied if kind is Kind.REPLY else sent.first if away else sent.rest
                for process, remote, flow in tie.judges(kind, away) if found else ():
                    found &= self._let(process, remote, kind, flow, keys)
            return found

        for way, which in ways(self._flows.rights.links, begins, crossing, ends, certain=self._certain):
            receiver = nodes.get(id(way[-1].far))
            if receiver is not None and receiver is not sender:
                number = (which & -which).bit_length() - 1
                keys = (each.every[number] for each in (sent.first, sent.rest, sent.replied))
                process, decision = way[-1].decisive(to_pass(passing, *keys), self._release)
                yield Hop(
                    sender=sender,
                    receiver=receiver,
                    key=sent.texts[number],
                    way=way,
                    attack=attack,
                    heard=heard,
                    location=process.at(decision.line),
                )

    def _let_by(self, process: Process, remote: Remote, kind: Kind, flow: Flow, keys: Keys) -> int:
        """The classes (bits) whose messages a process lets through."""
        found = 0
        for key, which in self._alike(process, keys):
            truth = decided(process, remote, kind, flow, key, self._release).truth
            found |= which if (truth.must if self._certain else truth.may) else 0
        return found

    def _sent_by(self, does: str, topics: tuple[str, ...], attack: bool, heard: bool) -> tuple[Sent, ...]:
        """What messages are about, as attackers choose it (`attack`: the sender, `heard`: the receiver)."""
        classes = self._flows.classes(does, topics, self._ambient)
        apart = apart_from(does, topics, ambient=self._ambient)
        if not self._certain:
            texts = tuple(classes)
            first, rest = (
                Keys(every=tuple(Key(text, Meant.ANY if each else Meant.EACH, apart) for text in texts))
                for each in (attack, heard)
            )
            free = Keys(every=(Key(EVERYTHING, Meant.FREE),) * len(texts))
            return (Sent(texts=texts, first=first, rest=rest, replied=free),)
        known = {text: each for text, each in classes.items() if each is not None}
        texts = tuple(known)
        own, *wider = (
            Keys(every=tuple(Key(text, Meant.ONE) for text in each))
            for each in (known.values(), texts, [EVERYTHING] * len(texts))
        )
        chosen = ((own, *wider) if each else (own,) for each in (attack, heard))
        return tuple(Sent(texts=texts, first=first, rest=rest, replied=rest) for first, rest in product(*chosen))

    @cached_property
    def _heard(self) -> list[tuple[Participant, Tie]]:
        """The links on which somebody listens without a file: its own, and perhaps on the wire any without TLS."""
        links, ends = self._flows.rights.links, {each: {m: _nobody(m) for m in Mode} for each in self.listening}
        found = [
            (
                each,
                Tie(
                    near=tie.far,
                    mode=tie.far.says.mode,
                    far=ends[each][tie.mode],
                    seen=tie.sees,
                    sees=tie.seen,
                    sure=tie.sure,
                ),
            )
            for each in self.listening
            for tie in links.attacks(each.who)
        ]
        plain = (
            replace(tie, far=ends[OUTSIDER][tie.far.says.mode], sure=Truth.UNKNOWN)
            for process in self._flows.network.started
            for tie in links.of(process)
            if tie.seen.protocol not in SECURED
        )
        return found if self._certain else [*found, *((OUTSIDER, tie) for tie in plain)]

    @cached_property
    def _ears(self) -> Mapping[int, Sequence[Tie]]:
        """The same by process: the attacker's links to it, as its own."""
        return gathered((id(tie.near), tie) for _who, tie in self._heard)

    @cached_property
    def _at_ears(self) -> Mapping[int, Participant]:
        return {id(tie.far): who for who, tie in self._heard}


def _nobody(mode: Mode) -> Process:
    """What is in the place of a process whose file does not count."""
    file = GivenFile(path="", sha256="")
    return Process(file=file, says=Configuration(mode=mode), owner=None, certificate=None, holds_key=False)


def walks(flows: NetworkFlows, asked: Question, release: Release, *, certain: bool) -> Walks:
    """The searches for a question; questions with the same attackers share what they compute."""
    unseen = () if certain else (each for each in flows.participants if each.unseen)
    return _walks(flows, frozenset((*asked.attacking, *unseen)), release, ambient=asked.ambient, certain=certain)


_walks: Final = lru_cache(maxsize=16)(Walks)


def found(flows: NetworkFlows, asked: Question, release: Release) -> tuple[Truth, tuple[Hop, ...]]:
    """Whether something gets there, and how it does, or may. With any doubt, the answer is never a certain no.

    Raises BudgetExceeded for too many processes or expressions of rules.
    """
    flows.check_size()
    doubtful = bool(flows.rights.doubts)
    possible = None if doubtful else walks(flows, asked, release, certain=False).shortest(asked)
    if possible is None and not doubtful:
        return Truth.NO, ()
    certain = walks(flows, asked, release, certain=True).shortest(asked)
    return (Truth.UNKNOWN, possible or ()) if certain is None else (Truth.YES, certain)


def published(flows: NetworkFlows, asked: Question, release: Release) -> tuple[Truth, tuple[Hop, ...]]:
    """Whether somebody outside the source has samples accepted on topics of the target, and who.

    Where the source is empty: whether more than one do. Who only passes samples on is not asked about, nor who accepts
    them and attacks. Raises as `found`.
    """
    flows.check_size()
    started = flows.network.started
    routing = {each for router in started if not is_session(router) for each in (router, router.owner)}
    others = [e for e in flows.participants if e.sessions or e.who is None or e.who not in routing]
    others = [each for each in others if each not in asked.source.participants]
    asked = replace(asked, attacking=flows.participants)
    for certain in (True, False):
        hops_of = walks(flows, asked, release, certain=certain).hops
        taken = (next((h for h in hops_of(each, asked.target.topics) if not h.heard), None) for each in others)
        hops = tuple(hop for hop in taken if hop is not None)
        if len(hops) > (0 if asked.source.participants else 1):
            return (Truth.YES if certain else Truth.UNKNOWN), hops[-1:]
    return (Truth.UNKNOWN if flows.rights.doubts else Truth.NO), ()


def told(hops: Sequence[Hop]) -> str:
    """A way in a line: by whom, about which keys, and who goes without a file."""
    words = [hops[0].sender.label]
    for hop in hops:
        words += [hop.key if hop.way else "anything", hop.receiver.label]
    without = [hop.sender for hop in hops if hop.attack] + [hop.receiver for hop in hops if hop.heard]
    names = [each.label for each in dict.fromkeys(without) if each is not OUTSIDER]
    how = [f"without the file of {', '.join(names)}"] if names else []
    how += ["with an outsider"] if OUTSIDER in without else []
    return f"{' -> '.join(words)} ({' and '.join(how) or 'no attack is needed'})."
