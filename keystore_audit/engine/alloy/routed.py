"""Whether anything may get through in a network of sessions and routers, as Alloy (alloy/routed.als).

The Analyzer is told the tables alone: processes, their rules, whom these name, who may be linked to whom, which
expressions meet which classes of keys, and who attacks. What a process lets through, what crosses a link, who passes on
and where something gets to it decides by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Final, NamedTuple

from keystore_audit.engine.alloy.answers import Command
from keystore_audit.engine.alloy.atoms import Atom, Relations, Sort, declare, function
from keystore_audit.engine.alloy.facts import CONSISTENCY, module_texts
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.solvers import run
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.matching.key_expressions import EVERYTHING, VERBATIM, includes, intersects
from keystore_audit.profiles import Release
from keystore_audit.zenoh.access_control import Flow, Kind
from keystore_audit.zenoh.configuration import SECURED, Mode
from keystore_audit.zenoh.flow import Walk
from keystore_audit.zenoh.links import Tie
from keystore_audit.zenoh.participants import OUTSIDER, PUBLISH, SENT, NetworkFlows, Question, apart_from

MODULES: Final = ("routing.als", "routed.als")
"""The hand-written modules: the words, and what is decided."""

NETWORK: Final = "network.als"
"""The generated module of facts."""

MAIN: Final = "asked.als"
"""The generated main file."""

COMMANDS: Final = (Command(kind="run", name=CONSISTENCY), Command(kind="check", name="NothingGetsThrough"))

MOST_ATOMS: Final = 1_200
"""Atoms of all sorts together up to which it is asked: the Analyzer has no room for relations of three with more."""

MOST_CROSSINGS: Final = 60_000
"""Links by what is sent: 20,000 (10 peers who all attack, 11 classes) take 5 s, 31,000 (8 peers, 25 classes) 8 s."""

_MODES: Final = {mode: mode.name for mode in Mode}
_FLOWS: Final = {flow: flow.name for flow in Flow}
_KINDS: Final = {
    each: each.name for each in (Kind.PUT, Kind.DELETE, Kind.SUBSCRIBE, Kind.QUERY, Kind.REPLY, Kind.SERVE)
}
_DEEDS: Final = {"publish": "PUBLISHED", "request": "REQUESTED", "reply": "REPLIED"}
_DELETED: Final = "DELETED"
_CONSTANTS: Final = {
    "Mode": _MODES.values(),
    "Kind": _KINDS.values(),
    "Flow": _FLOWS.values(),
    "Deed": (*_DEEDS.values(), _DELETED),
    "Way": ("AWAY", "BACK"),
}


def may_get_through(flows: NetworkFlows, asked: Question, release: Release, analyzer: Analyzer) -> bool:
    """Whether anything may. Raises EngineOutOfScale for too many atoms, EngineError where nothing was answered."""
    flows.check_size()
    told = Facts(flows, asked, release)
    if told.crossings > MOST_CROSSINGS:
        raise EngineOutOfScale(f"There are more than {MOST_CROSSINGS} links by what may be sent over them.")
    text, atoms = told.text()
    if atoms > MOST_ATOMS:
        raise EngineOutOfScale(f"The network has {atoms} atoms; the Analyzer is asked about {MOST_ATOMS} at most.")
    question = f"""module asked
open routed

run {CONSISTENCY} {{}} for 0
assert NothingGetsThrough {{ not gets_through }}
check NothingGetsThrough for 0
"""

    def read(_job: int, told: Mapping[str, bool], _solutions: object) -> bool:
        if not told[CONSISTENCY]:
            raise EngineFailed("The model contradicts itself, so that nothing would get through in it.")
        return told["NothingGetsThrough"]

    files = {**module_texts(MODULES), NETWORK: text, MAIN: question}
    return run([Job(files=files, main=MAIN, commands=COMMANDS, atoms=atoms)], analyzer, read)[0]


_HEADER: Final = """/**
 * The processes of a network and their rules, and a question about them, written by keystore-audit. Do not edit.
 */
module network
open routing"""


class _Sending(NamedTuple):
    """What is sent in which part of a flow, of which class, and whether the sender and the receiver attack."""

    part: str
    class_: tuple[str, tuple[str, ...], str]
    deed: str
    wide: bool
    heard: bool


class Facts:
    """The atoms of each sort, by what they stand for, and what is written of them."""

    def __init__(self, flows: NetworkFlows, asked: Question, release: Release) -> None:
        walk = Walk(flows, asked, release, certain=False)
        network, links = flows.network, flows.rights.links
        self._asked, self._release, self._walk = asked, release, walk
        self._processes = network.started
        self._participants = flows.participants
        self._links = [*dict.fromkeys(tie for each in network.started for tie in links.of(each) if tie.sure.may)]
        attackers = [each for each in flows.participants if each in walk.attacking or each in walk.listening]
        reaches = ((each, tie) for each in attackers for tie in flows.attacks(each) if tie.sure.may)
        self._reaches = [*dict.fromkeys(reaches)]
        self._views = [*dict.fromkeys(v for tie in self._ties() for v in (tie.seen, tie.sees))]
        self._subjects = [
            (process, subject, rules)
            for process in network.started
            for subject, (_line, rules) in (process.says.access.subjects if process.says.access else {}).items()
        ]
        self._rules = [*dict.fromkeys(rule for _process, _subject, rules in self._subjects for rule in rules)]
        self._expressions = [*dict.fromkeys(text for rule in self._rules for text, _line in rule.keys)]
        self._sendings = [
            _Sending(part, (does, topics, text), deed, wide, heard)
            for part, topics in (("middle", ()), ("first", asked.source.topics), ("last", asked.target.topics))
            for does in (SENT if part == "middle" else (PUBLISH,) if topics else ())
            for text in flows.classes(does, topics, asked.ambient)
            for deed in (_DEEDS[does], *([_DELETED] if does == PUBLISH else []))
            for wide, heard in product((False, True), repeat=2)
            if (wide or deed != _DELETED) and (walk.attacking or not wide)
        ]
        self._classes = [*dict.fromkeys(each.class_ for each in self._sendings)]
        self._relations = Relations()
        self._sorts: dict[str, Sort] = {
            sig: Sort(sig=sig, atoms=tuple(Atom(name=each, label="", place="") for each in names))
            for sig, names in _CONSTANTS.items()
        }

    @property
    def crossings(self) -> int:
        """How many questions there are whether something crosses a link."""
        return len(self._sendings) * (len(self._links) + len(self._reaches))

    def _ties(self) -> Iterable[Tie]:
        return (*self._links, *(tie for _who, tie in self._reaches))

    def text(self) -> tuple[str, int]:
        """The module `network`, and how many atoms it has. What users wrote stands in comments only."""
        names = {each.name for _process, each, _rules in self._subjects} | {view.name for view in self._views}
        protocols = {each.protocol for _process, each, _rules in self._subjects} | {v.protocol for v in self._views}
        labels: dict[str, Sequence[tuple[object, str]]] = {
            "Process": [(each, each.path) for each in self._processes],
            "Participant": [(each, each.label) for each in self._participants],
            "Link": [(each, f"{each.near.path if each.near else ''} to {each.far.path}") for each in self._links],
            "Reach": [(each, f"{each[0].label} to {each[1].far.path}") for each in self._reaches],
            "View": [(each, f"{each.name} by {each.protocol}") for each in self._views],
            "Subject": [(each, each[0].path) for each in self._subjects],
            "Rule": [(each, each.name) for each in self._rules],
            "Expression": [(each, each) for each in self._expressions],
            "Class": [(each, each[2]) for each in self._classes],
            "Sending": [(each, f"{each.deed} {each.class_[2]}") for each in self._sendings],
            "Name": [(each, each) for each in sorted(filter(None, names))],
            "Protocol": [(each, each) for each in sorted(filter(None, protocols))],
        }
        sections = [_HEADER]
        for sig, entries in labels.items():
            atoms = tuple(Atom(name=f"{sig}{n}", label=said, place="") for n, (_each, said) in enumerate(entries))
            self._sorts[sig] = Sort(sig=sig, atoms=atoms)
            sections.append(declare(self._sorts[sig]))
        self._places = {sig: {each: n for n, (each, _said) in enumerate(entries)} for sig, entries in labels.items()}
        for sig, known in _CONSTANTS.items():
            self._places[sig] = {each: n for n, each in enumerate(known)}
        functions = [*self._of_processes(), *self._of_links(), *self._of_classes(), *self._of_the_question()]
        sections += [*self._relations.take_private(), *functions]
        return "\n\n".join(filter(None, sections)) + "\n", sum(map(len, labels.values()))

    def _map(self, name: str, left: str, right: str, rows: Iterable[Iterable[object]]) -> str:
        """A relation: by atom of `left`, in their order, what of `right`."""
        places = [[self._places[right][each] for each in row] for row in rows]
        found = self._relations.rows(self._sorts[left], self._sorts[right], places)
        return self._relations.relation(name, f"{left} -> {right}", found)

    def _set(self, name: str, sig: str, flags: Iterable[object]) -> str:
        """The atoms of which something is so."""
        return self._relations.subset(name, self._sorts[sig], (number for number, flag in enumerate(flags) if flag))

    def _of_processes(self) -> Iterator[str]:
        says = [each.says for each in self._processes]
        asked = {*self._release.asked}
        doubtful = [each.undecided or any(asked & {*refusal.releases} for refusal in each.refusals) for each in says]
        yield self._map("mode", "Process", "Mode", ([each.mode.name] for each in says))
        yield self._set("brokering", "Process", (each.brokering for each in says))
        yield self._set(
            "unrestricted", "Process", (d or each.access is None for d, each in zip(doubtful, says, strict=True))
        )
        yield self._set("default_allow", "Process", (each.access is not None and each.access.allows for each in says))
        subjects = [subject for _process, subject, _rules in self._subjects]
        own = ([each for each in self._subjects if each[0] is process] for process in self._processes)
        yield self._map("subject", "Process", "Subject", own)
        yield self._map("rule", "Subject", "Rule", (rules for _process, _subject, rules in self._subjects))
        yield self._map("common_name", "Subject", "Name", (filter(None, [each.name]) for each in subjects))
        yield self._map("protocol", "Subject", "Protocol", (filter(None, [each.protocol]) for each in subjects))
        yield self._set("unproven", "Subject", (each.interface or each.user for each in subjects))
        yield self._set("by_id", "Subject", (each.zid for each in subjects))
        yield self._set("allow_rule", "Rule", (each.allow for each in self._rules))
        kinds = ([name for kind, name in _KINDS.items() if kind.value in rule.kinds] for rule in self._rules)
        yield self._map("message", "Rule", "Kind", kinds)
        ways = ([name for flow, name in _FLOWS.items() if flow.value in rule.flows] for rule in self._rules)
        yield self._map("flow", "Rule", "Flow", ways)
        yield self._map("expression", "Rule", "Expression", ({text for text, _l in rule.keys} for rule in self._rules))
        yield function("judged_as_put", "set Kind", "DELETE" if self._release.deletes_as_puts else "none")

    def _of_links(self) -> Iterator[str]:
        yield self._map("near", "Link", "Process", ([tie.near] for tie in self._links))
        yield self._map("far", "Link", "Process", ([tie.far] for tie in self._links))
        yield self._map("sees", "Link", "View", ([tie.sees] for tie in self._links))
        yield self._map("seen", "Link", "View", ([tie.seen] for tie in self._links))
        yield self._set("plain", "Link", (tie.seen.protocol not in SECURED for tie in self._links))
        yield self._map("holder", "Reach", "Participant", ([who] for who, _tie in self._reaches))
        yield self._map("at", "Reach", "Process", ([tie.far] for _who, tie in self._reaches))
        yield self._map("acts_as", "Reach", "Mode", ([tie.mode.name] for _who, tie in self._reaches))
        yield self._map("known", "Reach", "View", ([tie.seen] for _who, tie in self._reaches))
        yield self._map("known_name", "View", "Name", (filter(None, [each.name]) for each in self._views))
        yield self._map("speaks", "View", "Protocol", ([each.protocol] for each in self._views))
        yield self._set("uncontrolled", "View", (each.free for each in self._views))
        yield self._set("chosen", "View", (each.chosen for each in self._views))

    def _of_classes(self) -> Iterator[str]:
        texts = [text for _does, _topics, text in self._classes]
        apart = [apart_from(does, topics, ambient=self._asked.ambient) for does, topics, _text in self._classes]

        def rows(holds: Callable[[str, str, Sequence[str]], bool]) -> Iterable[Iterable[object]]:
            known = [*zip(self._classes, texts, apart, strict=True)]
            return ([each for each, text, besides in known if holds(said, text, besides)] for said in self._expressions)

        yield self._map("includes", "Expression", "Class", rows(lambda said, text, _besides: includes(said, text)))
        yield self._map("meets", "Expression", "Class", rows(lambda said, text, _besides: intersects(said, text)))
        within = rows(lambda said, text, besides: any(includes(each, said) for each in (text, *besides)))
        yield self._map("within", "Expression", "Class", within)
        yield self._set("everything", "Expression", (includes(each, EVERYTHING) for each in self._expressions))
        yield self._set("verbatim", "Class", (VERBATIM in each for each in texts))
        yield self._map("class", "Sending", "Class", ([each.class_] for each in self._sendings))
        yield self._map("deed", "Sending", "Deed", ([each.deed] for each in self._sendings))
        yield self._set("wide", "Sending", (each.wide for each in self._sendings))
        yield self._set("heard", "Sending", (each.heard for each in self._sendings))
        for part in ("middle", "first", "last"):
            yield self._set(part, "Sending", (each.part == part for each in self._sendings))

    def _of_the_question(self) -> Iterator[str]:
        everybody, asked = self._participants, self._asked
        yield self._map("session", "Participant", "Process", (each.sessions for each in everybody))
        for name, members in (
            ("outsider", (OUTSIDER,)),
            ("unseen", tuple(each for each in everybody if each.unseen)),
            ("attacking", self._walk.attacking),
            ("listening", self._walk.listening),
            ("source", asked.source.participants),
            ("target", asked.target.participants),
            ("through", asked.through),
        ):
            yield self._set(name, "Participant", (each in members for each in everybody))
