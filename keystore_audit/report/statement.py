"""The report as an unsigned in-toto Statement v1, for a signer (docs/ci.md) to make an attestation of.

Subjects are the files with the SHA-256 of the bytes that were read. Two predicates (in-toto attestation
framework, spec/predicates): `test-result/v0.1`, which can tell of a failure, and `svr/v0.2`, whose properties are those
that hold. An incomplete audit never passes in either. It is WARNED at best if the gate
was weakened, if files were not hashed or not read, or if authorities were not declared. A later change of such files
would go unseen; who could write in the folder chose such authorities. With a narrower scope than what supported
distributions ship, it attests the pass in that scope alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, Final

from keystore_audit.assumptions import CONDITIONS, Assumption
from keystore_audit.findings import Result
from keystore_audit.properties.result import PropertyResult
from keystore_audit.report.content import Report, Verdict
from keystore_audit.report.json import authorities, encoded, picked
from keystore_audit.text import instant

STATEMENT: Final = "https://in-toto.io/Statement/v1"
TEST_RESULT: Final = "https://in-toto.io/attestation/test-result/v0.1"
SVR: Final = "https://in-toto.io/attestation/svr/v0.2"
VERIFIER: Final = "pkg:pypi/keystore-audit"
"""A package URL, without its version."""
PREFIX: Final = "KEYSTORE_AUDIT_"
_OTHER: Final = re.compile(r"[^a-z0-9]+")


def render_test_result(reports: Sequence[Report]) -> str:
    """Return one statement for each report, a line each: JSON Lines, and with one keystore a JSON document."""
    return "".join(encoded(_statement(report, TEST_RESULT, _test_result(report))) + "\n" for report in reports)


def render_svr(reports: Sequence[Report]) -> str:
    """Return one statement for each report, a line each; its properties are empty unless the audit passed."""
    return "".join(encoded(_statement(report, SVR, _svr(report))) + "\n" for report in reports)


def _statement(report: Report, kind: str, predicate: dict[str, Any]) -> dict[str, Any]:
    subjects = [{"name": path, "digest": {"sha256": digest}} for path, digest in report.files]
    return {"_type": STATEMENT, "subject": subjects, "predicateType": kind, "predicate": predicate}


def _test_result(report: Report) -> dict[str, Any]:
    every = dict.fromkeys(row.rule for row in report.outcomes.rows if row.subjects)
    deciding = {finding.code for finding in report.failing}
    opened, failing, passing = (report.outcomes.some(result) for result in (Result.OPEN, Result.FAIL, Result.PASS))
    failed = [rule for rule in every if rule in opened or rule in deciding]
    warned = [rule for rule in every if rule not in failed and rule in failing]
    # What nothing was asked of, for want of a policy or an environment, did not pass.
    # Of properties (KA7) it is told below what each needs.
    apart = {*failed, *warned}
    passed = [rule for rule in every if rule in passing and rule not in apart and not rule.startswith("KA7")]
    tests = [*passed, *(_if(result.prop.id, result.needs) for result in _holding(report))]
    if report.scope:
        tests = [_passed(report)] if _sound(report) else []
    return {
        "result": _result(report, warned=bool(warned)),
        "configuration": _configuration(report),
        "passedTests": tests,
        "warnedTests": warned,
        "failedTests": failed,
        "keystoreAudit": _details(report),
    }


def _result(report: Report, *, warned: bool) -> str:
    """PASSED only for a sound audit without any finding; incomplete counts as failed."""
    if report.verdict is not Verdict.PASS:
        return "FAILED"
    return "PASSED" if _sound(report) and not warned and not report.scope else "WARNED"


def _sound(report: Report) -> bool:
    """Whether it passed at full strength, of files that were all read or accepted, with authorities declared."""
    open_to_doubt = report.weakened or report.uncovered or report.unread_foreign or not report.authorities_declared
    return report.verdict is Verdict.PASS and not open_to_doubt


def _svr(report: Report) -> dict[str, Any]:
    return {
        "verifier": {
            "id": f"{VERIFIER}@{report.version}",
            "policies": _configuration(report),
            "keystoreAudit": _details(report),
        },
        "timeCreated": instant(report.at),
        "properties": [*_properties(report)] if _sound(report) else [],
    }


def _properties(report: Report) -> Iterable[str]:
    """The pass and what holds, never without their conditions; of a narrower scope the pass in it alone."""
    yield _attested(_passed(report), ())
    for result in _holding(report) if not report.scope else ():
        yield _attested(result.prop.id, result.needs)


def _passed(report: Report) -> str:
    """The name of the pass, with its scope and conditions."""
    scope = f"-{_OTHER.sub('-', report.scope.lower())}" if report.scope else ""
    return _if(f"pass{scope}", (each.assumption for each in report.assumptions if each.needed_by))


def _holding(report: Report) -> Iterable[PropertyResult]:
    """What holds under every profile that was asked about, of something."""
    return (each for each in report.holding if not each.vacuous)


def _attested(name: str, needs: Iterable[Assumption]) -> str:
    """The name of what is attested, with what it needs."""
    return PREFIX + _if(name, needs).upper().replace("-", "_")


def _if(name: str, needs: Iterable[Assumption]) -> str:
    """The name, never without the conditions under which alone it is true."""
    conditions = "-and-".join(sorted(each.value for each in needs if each in CONDITIONS))
    return f"{name}-if-{conditions}" if conditions else name


def _configuration(report: Report) -> list[dict[str, Any]]:
    """What the gate was set by, as resource descriptors."""
    return [{"name": file.path, "digest": {"sha256": file.sha256}} for _what, file in report.given_files]


def _details(report: Report) -> dict[str, Any]:
    """What the verdict holds for: extension fields (in-toto attestation framework, parsing rules)."""
    return {
        "version": report.version,
        "at": instant(report.at),
        "verdict": report.verdict,
        "safeUntil": report.safe_until and instant(report.safe_until),
        "keystoreDigest": report.digest,
        **picked(report, "uncovered", "roots"),
        "unread": report.unread_foreign,
        "profiles": sorted(report.judged_profiles),
        **picked(report, "deployed", "domain"),
        "engines": {run.name: run.version or report.version for run in report.answered},
        "scope": report.scope or None,
        "weakened": report.weakened,
        "holdsIf": report.holds_if or None,
        "assumptions": [each.described for each in report.assumptions],
        "stated": report.stated,
        "authorities": authorities(report),
    }
