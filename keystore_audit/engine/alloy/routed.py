"""Whether anything may get through in a network of sessions and routers, as Alloy (alloy/routed.als).

The Analyzer gets tables alone. They hold processes, their rules, whom these name, possible links, which expressions
meet which classes of keys, and who attacks. It decides by itself what a process lets through, what crosses a link, who
passes on, and where data gets to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import Any, Final, NamedTuple

from keystore_audit.engine.alloy.answers import Command
from keystore_audit.engine.alloy.atoms import Atom, Relations, Sort, declare, function
from keystore_audit.engine.alloy.facts import CONSISTENCY, module_texts
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.solvers import run
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.matching.key_expressions import EVERYTHING, VERBATIM, includes, intersects
from keystore_audit.profiles import Release
from keystore_audit.text import alloy_comment
from keystore_audit.zenoh.access_control import Flow, Kind, Rule
from keystore_audit.zenoh.configuration import SECURED, Mode
from keystore_audit.zenoh.flow import walks
from keystore_audit.zenoh.network import Process
from keystore_audit.zenoh.participants import OUTSIDER, PUBLISH, SENT, End, NetworkFlows, Question, apart_from

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

_KINDS: Final = (Kind.PUT, Kind.DELETE, Kind.SUBSCRIBE, Kind.QUERY, Kind.REPLY, Kind.SERVE)
_DEEDS: Final = {"publish": "PUBLISHED", "request": "REQUESTED", "reply": "REPLIED"}
_DELETED: Final = "DELETED"
_CONSTANTS: Final = {
    "Mode": [each.name for each in Mode],
    "Kind": [each.name for each in _KINDS],
    "Flow": [each.name for each in Flow],
    "Deed": [*_DEEDS.values(), _DELETED],
}
_RELATIONS: Final = {
    "Participant": {"session": "Process"},
    "Process": {"mode": "Mode", "subject": "Subject"},
    "Subject": {"rule": "Rule", "common_name": "Name", "protocol": "Protocol"},
    "Rule": {"message": "Kind", "flow": "Flow", "expression": "Expression"},
    "Link": {"near": "Process", "far": "Process", "sees": "View", "seen": "View"},
    "Reach": {"holder": "Participant", "at": "Process", "acts_as": "Mode", "known": "View"},
    "View": {"known_name": "Name", "speaks": "Protocol"},
    "Expression": {"includes": "Class", "meets": "Class", "within": "Class"},
    "Sending": {"class": "Class", "deed": "Deed"},
}
"""By sort its relations, and to which sort."""
_FLAGS: Final = {
    "Participant": ("outsider", "unseen", "attacking", "listening", "source", "target", "through"),
    "Process": ("brokering", "unrestricted", "default_allow"),
    "Subject": ("unproven", "by_id"),
    "Rule": ("allow_rule",),
    "Link": ("plain",),
    "View": ("uncontrolled", "chosen"),
    "Expression": ("everything",),
    "Class": ("verbatim",),
    "Sending": ("wide", "heard", "middle", "first", "last"),
}
"""By sort its sets."""
_HEADER: Final = """/**
 * The processes of a network and their rules, and a question about them, written by keystore-audit. Do not edit.
 */
module network
open routing"""


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


_WINDOW: Final = f"""/**
 * For your own checks about a network: `routing` says what the words mean, comments in `network` who is who. With
 * `for 0` each check is a proof about these files, since nothing is left out that may be. These say that nothing of
 * Participant0 comes to Participant1:
 *
 *   check {{ Participant1 not in Participant0.^tells }} for 0              if nobody attacks
 *   check {{ Participant1 not in Participant0.(tells + forges).*tells }} for 0    if Participant0 attacks
 *   check {{ Participant1 not in Participant0.^(middle.told) }} for 0      if everybody attacks
 *
 * They leave out topics that nearly every node uses.
 */
module asked
open routing
open network
open routed

/** To whom something comes that keeps to its file, or is an outsider who listens. */
fun tells: Participant -> Participant {{
	(middle - wide - heard).told + ((middle & heard) - wide).told :> outsider
}}

/** The same of whoever goes without a file. */
fun forges: Participant -> Participant {{
	((middle & wide) - heard).told + (middle & wide & heard).told :> outsider
}}

run {CONSISTENCY} {{}} for 0
"""


def network_model(flows: NetworkFlows, release: Release) -> dict[str, str]:
    """The files of a model for the Analyzer's window, by name. What could not be read stands in a comment of MAIN.

    Raises BudgetExceeded as `may_get_through`.
    """
    flows.check_size()
    asked = Question(source=End(), target=End(), attacking=flows.participants)
    unread = (f"-- Not in this model: {alloy_comment(f'{place}: {why}')}\n" for place, why in flows.rights.doubts)
    files = {NETWORK: Facts(flows, asked, release).text()[0], MAIN: _WINDOW + "".join(unread)}
    return {**module_texts(MODULES), **files}


class _Sending(NamedTuple):
    """What is sent in which part of a flow, of which class, and whether the sender and the receiver attack."""

    part: str
    said: tuple[str, tuple[str, ...], str]
    deed: str
    wide: bool
    heard: bool


_Said = dict[Any, tuple[str, Mapping[str, Any]]]
"""By atom its name in comments; by name of a relation its values, by name of a set whether the atom is in it."""


class Facts:
    """What is written of each sort, by what its atoms stand for."""

    def __init__(self, flows: NetworkFlows, asked: Question, release: Release) -> None:
        self._flows, self._asked, self._release = flows, asked, release
        self._walk = walk = walks(flows, asked, release, certain=False)
        self._links = [*dict.fromkeys(t for p in flows.network.started for t in flows.rights.links.of(p) if t.sure.may)]
        reaches = (
            (each, tie) for each in walk.listening for tie in flows.rights.links.attacks(each.who) if tie.sure.may
        )
        self._reaches = [*dict.fromkeys(reaches)]
        self._sendings = [
            _Sending(part, (does, topics, text), deed, wide, heard)
            for part, topics in (("middle", ()), ("first", asked.source.topics), ("last", asked.target.topics))
            for does in (SENT if part == "middle" else (PUBLISH,) if topics else ())
            for text in flows.classes(does, topics, asked.ambient)
            for deed in (_DEEDS[does], *([_DELETED] if does == PUBLISH else []))
            for wide, heard in product((False, True), repeat=2)
            if (wide or deed != _DELETED) and (walk.attacking or not wide)
        ]

    @property
    def crossings(self) -> int:
        """How many questions there are whether something crosses a link."""
        return len(self._sendings) * (len(self._links) + len(self._reaches))

    def text(self) -> tuple[str, int]:
        """The module `network`, and how many atoms it has. What users wrote stands in comments only."""
        told = dict(self._told())
        names, protocols = (
            sorted({each for sig, name in where for _l, said in told[sig].values() for each in said[name]})
            for where in (
                (("Subject", "common_name"), ("View", "known_name")),
                (("Subject", "protocol"), ("View", "speaks")),
            )
        )
        told |= {"Name": {each: (each, {}) for each in names}, "Protocol": {each: (each, {}) for each in protocols}}
        sorts = {
            sig: Sort(
                sig=sig, atoms=tuple(_atom(f"{sig}{n}", label) for n, (label, _said) in enumerate(known.values()))
            )
            for sig, known in told.items()
        }
        everything = sorts | {
            sig: Sort(sig=sig, atoms=tuple(_atom(n, "") for n in _CONSTANTS[sig])) for sig in _CONSTANTS
        }
        places = {sig: {each: n for n, each in enumerate(known)} for sig, known in (told | _CONSTANTS).items()}
        write, functions = Relations(), []
        for sig, known in told.items():
            for name, to in _RELATIONS.get(sig, {}).items():
                rows = [[places[to][each] for each in said[name]] for _l, said in known.values()]
                rows_of = write.rows(sorts[sig], everything[to], rows)
                functions.append(write.relation(name, f"{sig} -> {to}", rows_of))
            for name in _FLAGS.get(sig, ()):
                those = (number for number, (_label, said) in enumerate(known.values()) if said[name])
                functions.append(write.subset(name, sorts[sig], those))
        functions.append(function("judged_as_put", "set Kind", "DELETE" if self._release.deletes_as_puts else "none"))
        sections = [_HEADER, *map(declare, sorts.values()), *write.take_private(), *functions]
        return "\n\n".join(filter(None, sections)) + "\n", sum(map(len, told.values()))

    def _told(self) -> Iterator[tuple[str, _Said]]:
        """By sort its atoms, each with its label and what is said of it."""
        asked, walk, processes = self._asked, self._walk, self._flows.network.started
        yield (
            "Participant",
            {
                each: (
                    each.label,
                    {
                        "session": each.sessions,
                        "outsider": each is OUTSIDER,
                        "unseen": each.unseen,
                        "attacking": each in walk.attacking,
                        "listening": each in walk.listening,
                        "source": each in asked.source.participants,
                        "target": each in asked.target.participants,
                        "through": each in asked.through,
                    },
                )
                for each in self._flows.participants
            },
        )
        subjects: _Said = {
            (process, subject): (
                process.path,
                {
                    "rule": rules,
                    "common_name": [subject.name] if subject.name is not None else [],
                    "protocol": [subject.protocol] if subject.protocol is not None else [],
                    "unproven": subject.interface is not None or subject.user is not None,
                    "by_id": subject.zid is not None,
                },
            )
            for process in processes
            for subject, (_line, rules) in (process.says.access.subjects if process.says.access else {}).items()
        }
        yield "Process", {each: (each.path, self._of_process(each, subjects)) for each in processes}
        yield "Subject", subjects
        rules = dict.fromkeys(rule for _label, said in subjects.values() for rule in said["rule"])
        yield "Rule", {each: (each.name, _of_rule(each)) for each in rules}
        yield from self._told_of_links()
        yield from self._told_of_classes({text: None for rule in rules for text, _line in rule.keys})

    def _of_process(self, process: Process, subjects: Iterable[tuple[Process, object]]) -> Mapping[str, Any]:
        says, asked = process.says, {*self._release.asked}
        doubtful = says.undecided or any(asked & {*each.releases} for each in says.refusals)
        return {
            "mode": [says.mode.name],
            "subject": [each for each in subjects if each[0] is process],
            "brokering": says.brokering,
            "unrestricted": doubtful or says.access is None,
            "default_allow": says.access is not None and says.access.allows,
        }

    def _told_of_links(self) -> Iterator[tuple[str, _Said]]:
        links: _Said = {
            tie: (
                f"{tie.near.path if tie.near else ''} to {tie.far.path}",
                {
                    "near": [tie.near],
                    "far": [tie.far],
                    "sees": [tie.sees],
                    "seen": [tie.seen],
                    "plain": tie.seen.protocol not in SECURED,
                },
            )
            for tie in self._links
        }
        yield "Link", links
        yield (
            "Reach",
            {
                (who, tie): (
                    f"{who.label} to {tie.far.path}",
                    {"holder": [who], "at": [tie.far], "acts_as": [tie.mode.name], "known": [tie.seen]},
                )
                for who, tie in self._reaches
            },
        )
        views = dict.fromkeys(
            v for tie in (*self._links, *(t for _w, t in self._reaches)) for v in (tie.seen, tie.sees)
        )
        yield (
            "View",
            {
                each: (
                    f"{each.name} by {each.protocol}",
                    {
                        "known_name": [each.name] if each.name is not None else [],
                        "speaks": [each.protocol],
                        "uncontrolled": each.free,
                        "chosen": each.chosen,
                    },
                )
                for each in views
            },
        )

    def _told_of_classes(self, expressions: Iterable[str]) -> Iterator[tuple[str, _Said]]:
        classes = {
            each.said: apart_from(each.said[0], each.said[1], ambient=self._asked.ambient) for each in self._sendings
        }
        yield "Class", {each: (each[2], {"verbatim": VERBATIM in each[2]}) for each in classes}
        yield (
            "Expression",
            {
                said: (
                    said,
                    {
                        "includes": [each for each in classes if includes(said, each[2])],
                        "meets": [each for each in classes if intersects(said, each[2])],
                        "within": [c for c, apart in classes.items() if any(includes(o, said) for o in (c[2], *apart))],
                        "everything": includes(said, EVERYTHING),
                    },
                )
                for said in expressions
            },
        )
        yield (
            "Sending",
            {
                each: (
                    f"{each.deed} {each.said[2]}",
                    {
                        "class": [each.said],
                        "deed": [each.deed],
                        "wide": each.wide,
                        "heard": each.heard,
                        **{part: each.part == part for part in ("middle", "first", "last")},
                    },
                )
                for each in self._sendings
            },
        )


def _of_rule(rule: Rule) -> Mapping[str, Any]:
    return {
        "message": [each.name for each in _KINDS if each.value in rule.kinds],
        "flow": [each.name for each in Flow if each.value in rule.flows],
        "expression": dict.fromkeys(text for text, _line in rule.keys),
        "allow_rule": rule.allow,
    }


def _atom(name: str, label: str) -> Atom:
    return Atom(name=name, label=label, place="")
