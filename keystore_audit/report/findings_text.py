"""The findings of the report for people: by enclave, worst first, each defect's remedy in full where it comes first.

What is the same in several enclaves, but for their names, is told of one and has the places of the others with it. What
does not fail the gate and stands in many enclaves is shown of a few of them and counted of the rest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from keystore_audit.findings import Finding, Severity
from keystore_audit.grouped import grouped
from keystore_audit.report.consequences import Consequences, within
from keystore_audit.report.content import Report
from keystore_audit.report.page import Page, Piece
from keystore_audit.report.remedy import Remedies
from keystore_audit.text import counted, some

MAX_PLACES: Final = 6
"""Places shown of one finding: a defect of 1,000 files is understood from a few; JSON has them all."""

MAX_ALIKE: Final = 200
"""Findings of one code below one heading, the worst first: a hostile document has thousands; JSON has them all."""

MAX_EXAMPLES: Final = 20
"""Enclaves in which a code is shown that neither fails the gate nor is high: a fleet has it in 1,000; JSON has all."""

MAX_NAMES: Final = 10
"""Enclaves named of those in which a code is not shown."""

_SEVERITY_STYLE: Final = {
    Severity.CRITICAL: "bold white on red",
    Severity.HIGH: "bold red",
    Severity.MEDIUM: "bold yellow",
    Severity.LOW: "cyan",
    Severity.INFO: "dim",
}


def put_findings(page: Page, report: Report, shown: Sequence[Finding]) -> None:
    """Put each enclave's findings, the enclave with the worst one first; the whole keystore is a group too."""
    consequences = Consequences(shown, report.properties)
    profiles = frozenset(report.judged_profiles)
    groups = grouped(consequences.told, lambda finding: finding.enclave)
    ordered = sorted(groups.items(), key=lambda group: (consequences.rank(group[1][0]), group[0] or ""))
    also = consequences.alike(finding for _, found in ordered for finding in found)
    enough: Counter[str] = Counter()
    elsewhere: dict[tuple[str, str, Severity], list[str]] = {}
    remedies = Remedies()
    for enclave, found in ordered:
        findings = []
        for finding in found:
            minor = not (finding.fails(report.fail_on) or finding.severity.at_least(Severity.HIGH) or finding.undecided)
            if finding.fingerprint not in also:
                continue
            if enclave and minor and enough[finding.code] >= MAX_EXAMPLES and not consequences.of(finding):
                enclaves = [enclave, *(other.enclave or "" for other in also[finding.fingerprint])]
                elsewhere.setdefault((finding.code, finding.name, finding.severity), []).extend(enclaves)
            else:
                findings.append(finding)
        enough.update({finding.code for finding in findings})
        if findings:
            _group(page, enclave, findings, profiles, consequences, remedies, also)
    _elsewhere(page, elsewhere)
    _suppressed(page, [finding for finding in shown if finding.suppressed is not None])


def _group(
    page: Page,
    enclave: str | None,
    findings: Sequence[Finding],
    profiles: frozenset[str],
    consequences: Consequences,
    remedies: Remedies,
    also: Mapping[str, Sequence[Finding]],
) -> None:
    """The findings about one enclave, or about the whole keystore."""
    page.blank()
    page.put((enclave or "The keystore as a whole", "bold underline"))
    told: Counter[str] = Counter()
    untold: Counter[str] = Counter()
    for finding in findings:
        told[finding.code] += 1
        if told[finding.code] > MAX_ALIKE:
            untold[finding.code] += 1 + len(also[finding.fingerprint])
            continue
        page.blank()
        _finding(page, finding, profiles, example=consequences.is_example(finding))
        others = also[finding.fingerprint]
        _of_others(page, others)
        _what_to_do(page, finding, remedies, more=bool(others))
        _consequences(page, consequences.so(finding))
    for code, more in untold.items():
        page.blank()
        page.put(f"and {more} more of {code} (all are in the JSON report)", indent=2)


def _finding(page: Page, finding: Finding, profiles: frozenset[str], *, example: bool) -> None:
    """What was found, where, and for which implementations; `example`: there may be more of it."""
    severity = finding.severity
    page.put((severity.value.upper(), _SEVERITY_STYLE[severity]), f"  {finding.code} {finding.name}", indent=2)
    page.put(f"E.g. {within(finding.message)}" if example else finding.message, indent=4)
    for number, place in enumerate(finding.locations[:MAX_PLACES]):
        note = f"  ({place.message})" if place.message else ""
        where: tuple[Piece, ...] = ((str(place), "bold"), (note, ""))
        page.labelled("where" if number == 0 else "", *where, indent=4, column=12)
    if len(finding.locations) > MAX_PLACES:
        more = counted(len(finding.locations) - MAX_PLACES, "more place")
        page.put(f"and {more} (all are in the JSON report)", indent=12)
    if finding.profiles and not profiles <= frozenset(finding.profiles):
        page.labelled("under", ", ".join(finding.profiles), indent=4, column=12)


def _of_others(page: Page, findings: Sequence[Finding]) -> None:
    """The enclaves of which the same is to be said, each with its first place."""
    for number, finding in enumerate(findings[:MAX_PLACES]):
        place = f"  ({finding.locations[0]})" if finding.locations else ""
        page.labelled("also" if number == 0 else "", (finding.enclave or "", "bold"), (place, ""), indent=4, column=12)
    if len(findings) > MAX_PLACES:
        page.put(f"and {len(findings) - MAX_PLACES} more (all are in the JSON report)", indent=12)


def _what_to_do(page: Page, finding: Finding, remedies: Remedies, *, more: bool) -> None:
    """Clause and remedy, in full where they come first: a keystore repeats a defect in many enclaves."""
    if not remedies.told(finding):
        page.labelled("clause", finding.clause, indent=4, column=12)
    remedy = remedies.give(finding)
    likewise = f"{'' if remedy.endswith('.') else '.'} Likewise for the others." if more else ""
    page.labelled("remedy", f"{remedy}{likewise}", indent=4, column=12)


def _consequences(page: Page, consequences: Iterable[tuple[Severity, str]]) -> None:
    for severity, sentence in consequences:
        worth = severity.value.upper(), _SEVERITY_STYLE[severity]
        page.labelled("so", worth, f" {sentence}", indent=4, column=12)


def _elsewhere(page: Page, elsewhere: Mapping[tuple[str, str, Severity], Sequence[str]]) -> None:
    """Of what many enclaves have, in how many more it is than were shown."""
    if not elsewhere:
        return
    page.blank()
    page.put(("The same in more enclaves (each is in the JSON report)", "bold underline"))
    for (code, name, severity), enclaves in elsewhere.items():
        page.blank()
        page.put((severity.value.upper(), _SEVERITY_STYLE[severity]), f"  {code} {name}", indent=2)
        distinct = list(dict.fromkeys(enclaves))
        findings = f"{len(enclaves)} more of it" if len(enclaves) > 1 else "One more of it"
        page.put(f"{findings}, about {some(distinct, MAX_NAMES)}.", indent=4)


def _suppressed(page: Page, findings: Sequence[Finding]) -> None:
    """What somebody accepts, with who, why and until when."""
    if not findings:
        return
    page.blank()
    page.put((f"Accepted findings, not counted: {len(findings)}", "bold underline"))
    for finding in findings:
        if (accepted := finding.suppressed) is not None:
            severity = finding.severity
            page.put((severity.value.upper(), _SEVERITY_STYLE[severity]), f"  {finding.code} {finding.name}", indent=2)
            page.put(finding.message, indent=4)
            until = f"until {accepted.until} by {accepted.owner} ({accepted.source})"
            page.labelled("accepted", until, indent=4, column=14)
            page.labelled("reason", accepted.reason, indent=4, column=14)
