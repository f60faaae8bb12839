"""Runs every rule on every subject and makes findings of what they say.

Messages hold untrusted text as it is: whoever renders them escapes it (`keystore_audit.text`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from keystore_audit.findings import Finding, Location, Outcome, Result, fingerprint
from keystore_audit.rules.audit import RULE_CRASHED
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Rule, Violation
from keystore_audit.rules.subjects import (
    certificate_uses,
    governance_uses,
    permissions_uses,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Findings, worst first, and the outcome of every rule on every subject."""

    findings: tuple[Finding, ...]
    outcomes: tuple[Outcome, ...]


def judge(
    context: Context,
    rules: Iterable[Rule[Any]],
    *,
    select: Collection[str] = (),
    ignore: Collection[str] = (),
) -> Judgement:
    """What the rules say. `select` and `ignore` hold codes or families (`KA2`); KA9 is never left out."""
    chosen = [rule for rule in rules if _wanted(rule, select, ignore)]
    subjects = list(_subjects(context))
    found: list[tuple[Rule[Any], Violation]] = []
    outcomes: list[Outcome] = []
    for rule in chosen:
        for name, subject in subjects:
            if not isinstance(subject, rule.on):
                continue
            violations, outcome = _apply(rule, subject, context)
            found += violations
            outcomes.append(Outcome(rule=rule.code, subject=name, outcome=outcome))
    return Judgement(findings=_findings(found), outcomes=tuple(outcomes))


def _wanted(rule: Rule[Any], select: Collection[str], ignore: Collection[str]) -> bool:
    if rule.family == "KA9":
        return True
    if select and not any(rule.code.startswith(code) for code in select):
        return False
    return not any(rule.code.startswith(code) for code in ignore)


def _subjects(context: Context) -> Iterator[tuple[str, object]]:
    """Every subject with the name by which outcomes call it."""
    yield "keystore", context.keystore
    for enclave in context.keystore.enclaves:
        yield enclave.path, enclave
    for use in certificate_uses(context.keystore):
        yield f"{use.certificates.file.place} as {use.role.value}", use
    for document in (*governance_uses(context.keystore), *permissions_uses(context.keystore)):
        yield document.signed.file.place, document
    for result in context.results:
        yield result.prop.id, result
    for run in context.engines:
        yield run.name, run


def _apply(rule: Rule[Any], subject: Any, context: Context) -> tuple[list[tuple[Rule[Any], Violation]], Result]:
    """What one rule says of one subject. A crash leaves the question open: it is a finding, and never a pass."""
    try:
        if not rule.applies(subject, context):
            return [], Result.NOT_APPLICABLE
        violations = list(rule.check(subject, context))
    except Exception as error:  # noqa: BLE001 - one bad rule must not hide the findings of the others
        crash = Violation(
            message=f"Rule {rule.code} {rule.name} crashed ({type(error).__name__}): what it checks is undecided.",
            locations=(),
            undecided=True,
            key=rule.code,
        )
        return [(RULE_CRASHED, crash)], Result.OPEN
    if not violations:
        return [], Result.PASS
    undecided = any(violation.undecided for violation in violations)
    return [(rule, violation) for violation in violations], Result.OPEN if undecided else Result.FAIL


def _findings(found: Iterable[tuple[Rule[Any], Violation]]) -> tuple[Finding, ...]:
    """Findings with fingerprints that differ, the causes of violated properties named, worst first."""
    seen: dict[str, int] = {}
    made: list[tuple[Rule[Any], Finding]] = []
    for rule, violation in found:
        path = violation.locations[0].path if violation.locations else None
        print_ = fingerprint(rule.code, violation.enclave, path, violation.key)
        count = seen[print_] = seen.get(print_, 0) + 1
        if count > 1:
            print_ = fingerprint(rule.code, violation.enclave, path, f"{violation.key}\0{count}")
        made.append((rule, _finding(rule, violation, print_)))
    explained = [_explained(rule, finding, made) for rule, finding in made]
    return tuple(sorted(explained, key=_order))


def _finding(rule: Rule[Any], violation: Violation, print_: str) -> Finding:
    return Finding(
        code=rule.code,
        name=rule.name,
        severity=violation.severity or rule.severity,
        message=violation.message,
        remedy=violation.remedy or rule.remedy,
        clause=rule.clause,
        enclave=violation.enclave,
        locations=violation.locations,
        profiles=violation.profiles,
        fingerprint=print_,
    )


def _explained(rule: Rule[Any], finding: Finding, made: list[tuple[Rule[Any], Finding]]) -> Finding:
    """A finding of KA7 with its causes: their rule explains the property, and they share a profile with it."""
    if rule.family != "KA7":
        return finding
    causes = tuple(
        cause.fingerprint
        for other, cause in made
        if rule.name in other.explains
        and (not cause.profiles or not finding.profiles or set(cause.profiles) & set(finding.profiles))
    )
    return replace(finding, explained_by=causes)


def _order(finding: Finding) -> tuple[object, ...]:
    place = finding.locations[0] if finding.locations else Location(path="")
    return (
        finding.severity.rank,
        finding.enclave or "",
        place.path,
        place.line or 0,
        finding.code,
        finding.fingerprint,
    )
