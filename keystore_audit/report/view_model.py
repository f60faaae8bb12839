"""What every format for people tells of a report, worked out once.

Causes with what follows from them, who starts, what the verdict rests on, and what limits it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.findings import OF_THE_AUDIT, Finding, Severity
from keystore_audit.grouped import grouped
from keystore_audit.profiles import facts, implementations
from keystore_audit.properties.result import EngineRun, EngineStatus, PropertyResult, Status
from keystore_audit.report.content import EnclaveEntry, Report

_COMMON_WORD: Final = re.compile("[A-Z][a-z]* (?!DDS)")
"""What a sentence begins with, unless it is a name such as Fast DDS or CN=/talker."""

_Words = tuple[str, Severity, tuple[str, ...], tuple[str, ...], tuple[str, ...]]
"""What is told of a finding but its places: of private keys of one mode and copies of one document the same."""


def within(sentence: str) -> str:
    """The sentence as a part of another: its first word begins small, unless it is a name."""
    return sentence[:1].lower() + sentence[1:] if _COMMON_WORD.match(sentence) else sentence


class Cause(Struct, frozen=True, kw_only=True):
    """What is fixed at once: `finding`, with `others` that say the same of other subjects.

    `follow`: findings that go with it. `stay`: findings that follow from it and from more, which must be fixed too.
    `severity`: of the worst of all these.
    """

    finding: Finding
    others: tuple[Finding, ...]
    follow: tuple[Finding, ...]
    stay: tuple[Finding, ...]
    severity: Severity

    @property
    def every(self) -> tuple[Finding, ...]:
        """All findings that are told here."""
        return (self.finding, *self.others, *self.follow, *self.stay)

    def decides(self, gate: Severity | None) -> bool:
        """Whether it, or what follows from it, fails the gate or leaves the audit open."""
        return any(each.fails(gate) or each.undecided for each in self.every)


class Consequences:
    """The findings that `explained_by` hangs under others, for every format that people read.

    Each hangs under the first of its causes that the format shows. It stands by itself, so that it never disappears,
    if all its causes are hidden (`--min-severity`), accepted or unknown.
    """

    def __init__(self, shown: Sequence[Finding], properties: Sequence[PropertyResult]) -> None:
        """Find the place of each finding among those `shown`, which come in the report's order, worst first."""
        self._results = {result.prop.id: result for result in properties}
        counting = [finding for finding in shown if finding.suppressed is None]
        roots = [finding for finding in counting if not finding.explained_by]  # two that explain each other are none
        first = {each.fingerprint: same[0] for same in grouped(roots, _words).values() for each in same}
        order = {mark: place for place, mark in enumerate(first)}
        self._under: dict[str, list[Finding]] = {}
        told = []
        for finding in counting:
            causes = [first[cause].fingerprint for cause in finding.explained_by if cause in first]
            if causes:
                self._under.setdefault(min(causes, key=order.__getitem__), []).append(finding)
            else:
                told.append(finding)
        self.told: Final = tuple(sorted(told, key=self.rank))
        """Those that are told by themselves, worst first, else in the report's order."""
        alike = grouped(self.told, _words)
        self.causes: Final = tuple(self._cause(same[0], same[1:]) for same in alike.values())
        """The same, those that say the same as one, worst first."""

    def _cause(self, finding: Finding, others: Sequence[Finding]) -> Cause:
        below = [each for same in (finding, *others) for each in self._under.get(same.fingerprint, ())]
        fixed = {finding.fingerprint, *(each.fingerprint for each in others)}
        follow = [each for each in below if fixed.issuperset(each.explained_by)]
        stay = [each for each in below if not fixed.issuperset(each.explained_by)]
        worst = min((finding, *below), key=lambda each: each.severity.rank).severity
        return Cause(finding=finding, others=tuple(others), follow=tuple(follow), stay=tuple(stay), severity=worst)

    def of(self, finding: Finding) -> tuple[tuple[Finding, str], ...]:
        """The findings that `finding` explains, each with an example in words."""
        below = self._under.get(finding.fingerprint, ())
        return tuple((consequence, self.example(consequence)) for consequence in below)

    def so(self, finding: Finding) -> tuple[tuple[Severity, str], ...]:
        """The same, each in one sentence behind its severity."""
        return tuple((each.severity, self.sentence(each)) for each, _example in self.of(finding))

    def sentence(self, consequence: Finding) -> str:
        """A finding that follows from another, with an example."""
        violated = f"{consequence.code}: property {consequence.name} is violated"
        return f"{violated}, e.g. {within(self.example(consequence))}"

    def rank(self, finding: Finding) -> tuple[int, bool]:
        """How early `finding` is shown: as the worst that hangs under it, and causes before what they leave open."""
        told = [finding, *self._under.get(finding.fingerprint, [])]
        return min(each.severity.rank for each in told), finding.code.startswith(OF_THE_AUDIT)

    def result(self, finding: Finding) -> PropertyResult | None:
        """The property that the finding is about, if it is about one."""
        return next((self._results[each] for each in properties_of(finding) if each in self._results), None)

    def is_example(self, finding: Finding) -> bool:
        """Whether `finding` tells one way in which a property is violated, of perhaps many."""
        result = self._results.get(finding.name)  # one that the user asserts is told with its way
        return result is not None and any(each.counterexample is not None for each in result.profiles.values())

    def example(self, finding: Finding) -> str:
        """The counterexample under a profile that the finding holds for, else the finding's own words."""
        result = self.result(finding)
        for name, answer in result.profiles.items() if result else ():
            wanted = not finding.profiles or name in finding.profiles
            if wanted and answer.status is Status.VIOLATED and answer.counterexample is not None:
                return answer.counterexample.text
        return finding.message


def only_on(names: Iterable[str], judged: Sequence[str]) -> str:
    """The implementations, of those judged, for which something is so, in words; empty for all."""
    names = tuple(names)
    found = [each for each in judged if each in names]
    if not names or len(found) == len(judged):
        return ""
    return implementations(found) if found else f"{implementations(names)}: not judged here"


def concerned(report: Report, finding: Finding) -> str:
    """The same of a finding, which may be about what one enclave of a mixed fleet runs."""
    return only_on(finding.profiles, (*report.judged_profiles, *report.others))


def properties_of(finding: Finding) -> tuple[str, ...]:
    """The ids of the properties that a finding is about, if it is about any."""
    return finding.properties or (finding.name,)


def _words(finding: Finding) -> _Words:
    """What is told of it around the name of its subject: a word in the name's place might be a name, too."""
    about = finding.enclave or next((place.path for place in finding.locations), None)
    around = tuple(finding.message.split(about)) if about else (finding.message, finding.fingerprint)
    said = tuple(step.text for step in finding.fix.steps if not step.paths)
    return finding.code, finding.severity, finding.profiles, around, (finding.fix.kind.value, *said)


ENGINE_WORDS: Final = {
    EngineStatus.OK: "answered",
    EngineStatus.MISSING: "is missing",
    EngineStatus.FAILED: "failed",
    EngineStatus.TIMEOUT: "ran out of time",
    EngineStatus.OUT_OF_SCALE: "was not started, the model being too large for it",
    EngineStatus.NOT_RUN: "was not asked",
}
"""What became of an engine, behind its name."""

_RUNNING_SESSIONS: Final = facts.RUNNING_SESSIONS
"""Said with "safe until", which is about new sessions (read; Cyclone DDS and OpenDDS have timers)."""


def sentence(text: str) -> str:
    """With a full stop, where there is none."""
    return text if text.endswith((".", "!", "?")) else f"{text}."


def until(report: Report) -> str:
    """Why its answer changes at `safe_until`, with what goes on then, or why it never does."""
    why = report.safe_until_why
    return why if report.safe_until is None else f"{sentence(why)} {_RUNNING_SESSIONS}"


def engine(run: EngineRun, *, version: bool) -> str:
    """What became of it, with its `version` or without."""
    name = f"{run.name} engine {run.version}" if version and run.version else f"{run.name} engine"
    return sentence(f"The {name} {ENGINE_WORDS[run.status]}{f': {run.reason}' if run.reason else ''}")


def warnings(report: Report, *, versions: bool = False) -> Iterator[str]:
    """What is to be read first."""
    answered = " and ".join(run.name for run in report.answered)
    rest = f" The properties rest on {answered} alone." if answered else ""
    yield from (engine(run, version=versions) + rest for run in report.silent)
    if not answered:
        yield "No engine has answered: no property was decided."
    if report.engines_agree is False:
        yield "The engines disagree: wherever they do, the answer is unknown."
    undeclared = [each.role for each in report.authorities if not each.declared]
    if len(undeclared) == 1:
        yield f"The {undeclared[0]} CA is not declared, but the other one is. Whichever stands in its file is trusted."
    for reason in report.weakened:
        yield sentence(f"Weakened gate: {reason}")


HOW: Final = (
    "If you trust these authorities, declare them: paste this into keystore-audit.toml, and give CI --settings "
    "keystore-audit.toml. The fingerprints are of the keys, which a renewed certificate keeps:"
)


def declaring(report: Report) -> Iterator[str]:
    """The lines that declare the authorities as found; none where both are declared or one cannot be told."""
    if report.authorities_declared or not all(anchors.here for anchors in report.authorities):
        return
    yield "[authorities]"
    for anchors in report.authorities:
        yield f"{anchors.role} = ["
        yield from (f'"sha256:{key}",' for key in dict.fromkeys(each.key for each in anchors.here))
        yield "]"


_KEEPING_NODES: Final = ("KA113", "KA418", "KA636")
"""Rules of what DDS lets pass and ROS 2 does not: names of enclaves, and topics that every node needs."""


def nodes_beside(findings: Iterable[Finding]) -> str:
    """A sentence that names the findings which keep nodes from being made where a participant starts, or nothing."""
    told = {finding.code for finding in findings if finding.severity.at_least(Severity.MEDIUM)}
    codes = [code for code in _KEEPING_NODES if code in told]
    if not codes:
        return ""
    return f"This is about DDS participants. ROS 2 may still make no node of one: see {', '.join(codes)}."


def assumed(report: Report) -> tuple[str, ...]:
    """What the verdict takes for granted, in full."""
    return (*(f"{each.sentence} ({each.assumption.value})" for each in report.assumptions), *report.stated)


def starting(report: Report) -> tuple[list[EnclaveEntry], list[EnclaveEntry]]:
    """The enclaves whose participant starts under all profiles, and the others."""
    starts = grouped(report.enclaves, lambda entry: all(each.usable.must for each in entry.profiles.values()))
    return starts.get(True, []), starts.get(False, [])
