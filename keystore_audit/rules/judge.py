"""Runs every rule on every subject and makes findings of what they say.

Messages hold untrusted text as it is, bounded but not escaped: whoever renders them escapes it (`keystore_audit.text`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any, Final, NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import (
    MAX_PLACES,
    OF_PROPERTIES,
    OF_THE_AUDIT,
    WHOLE,
    Finding,
    Outcomes,
    Result,
    Row,
    Severity,
    fingerprint,
)
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.question import Doubt
from keystore_audit.profiles import VARIANTS, Profile, at_work
from keystore_audit.properties.result import PropertyResult
from keystore_audit.rules.meaning import Meanings
from keystore_audit.rules.registry import Context, Rule, Violation
from keystore_audit.rules.remedies import Filling
from keystore_audit.rules.subjects import (
    Crash,
    Refusal,
    certificate_uses,
    governance_uses,
    permissions_uses,
    revocation_uses,
    unmanaged_uses,
)
from keystore_audit.settings.suppressions import accepted, uses
from keystore_audit.text import shorten
from keystore_audit.truth import Truth

MAX_MESSAGE: Final = 2000
"""Characters of a message, the last guard: the rules bound what they quote, counterexamples come from the engines."""

_Found = tuple[Rule[Any], Violation]


class _Marked(NamedTuple):
    """What was found, which finding it is, and what it is about."""

    rule: Rule[Any]
    violation: Violation
    fingerprint: str
    meaning: str


class Judgement(Struct, frozen=True, kw_only=True):
    """Findings, worst first, and the outcome of every rule on every subject that it is about."""

    findings: tuple[Finding, ...]
    outcomes: Outcomes


def judge(
    context: Context,
    rules: Iterable[Rule[Any]],
    *,
    select: Collection[str] = (),
    ignore: Collection[str] = (),
) -> Judgement:
    """What the rules say, in their order. `select`, `ignore`: codes or families (`KA203`, `KA2`), never of KA9.

    Doubts, crashes and refusals are the subjects of the last rules: only then is known which of them another rule
    speaks for.
    """
    chosen = [rule for rule in rules if _chosen(rule, select, ignore)]
    run = _Run(context, chosen)
    run.over(chosen, _subjects(context))
    run.over(chosen, [*run.crashes(), *run.unspoken(), *run.refusals()])
    return Judgement(
        findings=_findings(run, chosen, context),
        outcomes=Outcomes(rows=tuple(chain.from_iterable(run.outcomes.values()))),
    )


def _chosen(rule: Rule[Any], select: Collection[str], ignore: Collection[str]) -> bool:
    names = {rule.code, rule.family}
    return rule.family == OF_THE_AUDIT or ((not select or bool(names & {*select})) and not names & {*ignore})


def _subjects(context: Context) -> Iterator[tuple[str, object]]:
    """Every subject with the name by which outcomes call it."""
    keystore = context.keystore
    yield WHOLE, keystore
    for enclave in keystore.enclaves:
        yield enclave.path, enclave
    for certificates in certificate_uses(keystore):
        yield certificates.certificates.file.place, certificates
    for revocations in revocation_uses(keystore):
        yield revocations.file.place, revocations
    for document in (*governance_uses(keystore), *permissions_uses(keystore), *unmanaged_uses(keystore)):
        yield document.signed.file.place, document
    if context.network is not None:
        yield context.network.path, context.network
        yield from ((process.path, process) for process in context.network.processes)
    for result in context.results:
        yield result.prop.id, result
    for run in context.engines:
        yield run.name, run


class _Run:
    """What the rules have said so far."""

    def __init__(self, context: Context, rules: Iterable[Rule[Any]]) -> None:
        """Nothing yet; `outcomes` will be by the codes of the rules, in their order."""
        self._context = context
        self._crashes: list[Crash] = []
        self.found: list[_Found] = []
        self.outcomes: dict[str, list[Row]] = {rule.code: [] for rule in rules}

    def over(self, rules: Iterable[Rule[Any]], subjects: Iterable[tuple[str, object]]) -> None:
        """Put every rule to every subject that it is about."""
        by_kind: dict[type, list[tuple[str, object]]] = {}
        for name, subject in subjects:
            by_kind.setdefault(type(subject), []).append((name, subject))
        for rule in rules:
            for kind, about in by_kind.items():
                if not issubclass(kind, rule.on):
                    continue
                # A rule of KA7 is about the property of its name; others, of any family, about all of their kind.
                one = rule.on is PropertyResult and rule.family == OF_PROPERTIES
                asked = [(name, subject) for name, subject in about if name == rule.name] if one else about
                self.outcomes[rule.code].append(Row(rule.code, [name for name, _ in asked], self._put(rule, asked)))

    def _put(self, rule: Rule[Any], subjects: Iterable[tuple[str, object]]) -> list[tuple[Result, int]]:
        """Put a rule to subjects; a loop of few steps, since there are 60 rules for each of thousands of enclaves."""
        context, code, check, applies, of = self._context, rule.code, rule.check, rule.applies, rule.of
        results: list[tuple[Result, int]] = []
        last, count = Result.PASS, 0
        for name, subject in subjects:
            outcome = Result.PASS
            try:
                about = subject if of is None else of(subject, context)
                if about is None or (applies is not None and not applies(subject, context)):
                    outcome = Result.NOT_APPLICABLE
                elif violations := [_placed(each, subject, context) for each in check(about, context)]:
                    self.found += [(rule, violation) for violation in violations]
                    outcome = Result.OPEN if any(each.undecided for each in violations) else Result.FAIL
            except Exception as error:  # noqa: BLE001 - whatever a rule raises, others still speak, and it is no pass
                self._crashes.append(Crash(rule=code, subject=name, exception=type(error).__name__))
                outcome = Result.OPEN
            if outcome is not last:
                results.append((last, count))
                last, count = outcome, 0
            count += 1
        results.append((last, count))
        return [(result, count) for result, count in results if count]

    def crashes(self) -> list[tuple[str, Crash]]:
        """The rules that raised since this was asked last, as subjects."""
        new, self._crashes = self._crashes, []
        return [(crash.subject, crash) for crash in new]

    def unspoken(self) -> Iterator[tuple[str, Doubt]]:
        """Doubts about places of which no violation says that they stay open, as subjects."""
        spoken = {
            location.path
            for rule, violation in self.found
            if violation.undecided and rule.family != OF_THE_AUDIT
            for location in violation.locations
        }
        doubts = self._context.meaning.doubts
        return ((doubt.location.path, doubt) for doubt in doubts if doubt.location.path not in spoken)

    def refusals(self) -> Iterator[tuple[str, Refusal]]:
        """Enclaves that do not start under some chosen profile, where no violation of high severity says why."""
        high = [v for rule, v in self.found if rule.stops and (v.severity or rule.severity).at_least(Severity.HIGH)]
        spoken = {violation.enclave for violation in high}
        places = {location.path for violation in high for location in violation.locations}
        for enclave in self._context.keystore.enclaves:
            reasons: dict[tuple[str, ...], tuple[str, ...]] = {}
            for profile in self._context.profiles:
                usability = self._context.meaning.usability.get((enclave.files.directory, profile.name))
                if usability is not None and usability.usable is Truth.NO:
                    reasons[usability.reasons] = (*reasons.get(usability.reasons, ()), profile.name)
            files = {file.place for file in enclave.files.files.values()}
            if reasons and enclave.path not in spoken and not files & places:
                yield enclave.path, Refusal(enclave=enclave, profiles=reasons)


def _placed(violation: Violation, subject: object, context: Context) -> Violation:
    """With each place once, and filed under the enclave that is the only one of the subject.

    Its profiles are named where it does not hold for all of the chosen ones, and for no other.
    """
    enclave = violation.enclave
    if enclave is None:
        concerned = [subject] if isinstance(subject, Enclave) else getattr(subject, "enclaves", [])
        enclave = concerned[0].path if len(concerned) == 1 and not isinstance(subject, Keystore) else None
    profiles = tuple(name for name in VARIANTS if name in violation.profiles)
    profiles = () if {*profiles} == {profile.name for profile in context.profiles} else profiles
    return replace(violation, enclave=enclave, locations=tuple(dict.fromkeys(violation.locations)), profiles=profiles)


def _findings(run: _Run, chosen: Sequence[Rule[Any]], context: Context) -> tuple[Finding, ...]:
    """The findings, those that somebody accepts marked, and what the rules say of how they are accepted."""
    meanings, filling = Meanings(context), Filling(context.keystore)
    marked = _marked(run.found, meanings)
    found = _made(marked, filling, context.fleets)
    if not context.suppressions:
        return found
    profiles = [profile.name for profile in context.profiles]
    codes = {rule.code for rule in chosen}
    files = uses(found, context.suppressions, context.at, profiles, codes, _outside(marked, context.keystore))
    before = len(run.found)
    run.over(chosen, [(file.path, file) for file in files])
    run.over(chosen, run.crashes())
    return accepted(_made([*marked, *_marked(run.found[before:], meanings)], filling, context.fleets), files)


def _outside(marked: Iterable[_Marked], keystore: Keystore) -> dict[str, set[str]]:
    """By fingerprint, the places of a finding in what no enclave carries; all of them, listed or not."""
    layout = keystore.layout
    carried = {file.place for file in (layout.governance, layout.unsigned_governance) if file is not None}
    for enclave in keystore.enclaves:
        carried.add(enclave.files.directory)
        for file in enclave.files.every:  # by their names there, and by those that links lead to
            carried |= {file.path, file.place}
    return {
        each.fingerprint: {place.path for place in each.violation.locations if not place.beside} - carried
        for each in marked
    }


def _marked(found: Iterable[_Found], meanings: Meanings) -> list[_Marked]:
    """What was found, each with a fingerprint of its own.

    Those that nothing tells apart are numbered, with how many there are. Otherwise, if one of them were fixed, another
    would take its place, and its suppression.
    """
    ordered = sorted(_once(found), key=lambda item: _order(*item))
    marks = [_fingerprint(*item) for item in ordered]
    alike, seen = Counter(marks), Counter[str]()
    marked: list[_Marked] = []
    for (rule, violation), mark in zip(ordered, marks, strict=True):
        seen[mark] += 1
        own = mark if alike[mark] == 1 else _fingerprint(rule, violation, f"\0{seen[mark]} of {alike[mark]}")
        marked.append(_Marked(rule, violation, own, meanings.of(rule, violation)))
    return marked


def _made(marked: Iterable[_Marked], filling: Filling, fleets: Sequence[Profile]) -> tuple[Finding, ...]:
    """The findings, the causes of violated properties named, worst first."""
    ordered = sorted(marked, key=lambda each: _order(each.rule, each.violation))
    return tuple(_finding(each, _causes(each, ordered, fleets), filling) for each in ordered)


def _once(found: Iterable[_Found]) -> Iterator[_Found]:
    """What is said of several subjects in the same words, one time."""
    told: set[tuple[str, Violation]] = set()
    for rule, violation in found:
        said = rule.code, violation
        if not violation.shared or said not in told:
            yield rule, violation
        if violation.shared:
            told.add(said)


def _fingerprint(rule: Rule[Any], violation: Violation, number: str = "") -> str:
    key = f"{violation.key}{number}"
    if rule.family == OF_PROPERTIES:  # the enclave and the place are those of an example
        return fingerprint(rule.code, None, None, key)
    first = violation.locations[0].path if violation.locations else None
    return fingerprint(rule.code, violation.enclave, first, key)


def _order(rule: Rule[Any], violation: Violation) -> tuple[object, ...]:
    """Worst first, then by enclave, place and code; the rest makes the order of equals the same in every run."""
    first = violation.locations[0] if violation.locations else None
    return (
        (violation.severity or rule.severity).rank,
        violation.enclave or "",
        first.path if first is not None else "",
        (first.line if first is not None else None) or 0,
        rule.code,
        violation.key,
        violation.message,
    )


def _causes(violated: _Marked, marked: Sequence[_Marked], fleets: Sequence[Profile]) -> tuple[str, ...]:
    """The findings that explain a violated property, under what some enclave runs in a fleet on one of its profiles.

    If it names no profiles, all findings that are about it.
    """
    rule, profiles = violated.rule, {each.name for each in at_work(fleets, violated.violation.profiles)}
    if rule.family != OF_PROPERTIES:
        return ()
    return tuple(
        each.fingerprint
        for each in marked
        if rule.name in (each.rule.explains if each.violation.explains is None else each.violation.explains)
        and (not each.violation.profiles or not profiles or not profiles.isdisjoint(each.violation.profiles))
    )


def _finding(found: _Marked, causes: tuple[str, ...], filling: Filling) -> Finding:
    rule, violation = found.rule, found.violation
    return Finding(
        code=rule.code,
        name=rule.name,
        severity=violation.severity or rule.severity,
        message=shorten(violation.message, MAX_MESSAGE),
        fix=filling(violation.remedy or rule.remedy, violation.enclave, violation.locations),
        clause=rule.clause,
        enclave=violation.enclave,
        locations=tuple(violation.locations[:MAX_PLACES]),
        profiles=violation.profiles,
        explained_by=causes,
        fingerprint=found.fingerprint,
        meaning=found.meaning,
        undecided=violation.undecided,
        properties=violation.properties,
        sent=violation.sent,
    )
