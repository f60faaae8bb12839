"""The findings: by severity, then by rule, with remedy and clause said once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from keystore_audit.findings import Finding, Location, Severity
from keystore_audit.grouped import grouped
from keystore_audit.report.consequences import Consequences
from keystore_audit.report.html.element import NOTHING, Html, element, folded, items, joined, lines, place
from keystore_audit.report.html.sheet import FULL, Sheet, severity
from keystore_audit.text import counted, shorten

MAX_OF_RULE: Final = 30
"""Findings of one rule that are shown; a defect of 1,000 files is understood from a few."""

MAX_SEEN: Final = 4
"""Findings of one rule that are seen without a click."""

MAX_PLACES: Final = 8
"""Places shown of one finding."""

MAX_MESSAGE: Final = 1500
"""Characters of one message."""

_OPEN: Final = frozenset({Severity.CRITICAL, Severity.HIGH, Severity.MEDIUM})
"""Severities whose findings are seen without a click."""


def findings(sheet: Sheet) -> Html:
    """Return all findings that are not hidden, and, at the end, those that somebody accepts."""
    consequences = Consequences(sheet.shown, sheet.report.properties)
    by_rule = grouped(consequences.told, lambda finding: (consequences.rank(finding)[0], finding.code))
    groups = [
        _rule(sheet, rank, found, consequences) for (rank, _code), found in sorted(by_rule.items(), key=lambda e: e[0])
    ]
    hidden = len(sheet.report.findings) - len(sheet.shown)
    parts: list[Html] = groups or [element("p", "Nothing was found.", class_="soft")]
    if hidden:
        parts.append(element("p", f"{counted(hidden, 'finding')} below --min-severity not shown.", class_="soft"))
    return joined([*parts, _accepted([finding for finding in sheet.shown if finding.suppressed is not None])])


def count(sheet: Sheet) -> int:
    """Return how many findings count."""
    return sum(finding.suppressed is None for finding in sheet.shown)


def _rule(sheet: Sheet, rank: int, found: Sequence[Finding], consequences: Consequences) -> Html:
    """All findings of one rule; the head says its worst severity."""
    worst = min((finding.severity for finding in found), key=lambda each: each.rank)
    code = element("span", found[0].code, class_="code")
    many = element("span", f"×{len(found)}", class_="many") if len(found) > 1 else NOTHING
    title = joined([severity(worst), code, element("strong", found[0].name), many])
    shown = found[:MAX_OF_RULE]
    told = [_finding(sheet, finding, worst, consequences) for finding in shown]
    left_out = len(found) - len(shown)
    rest = [element("p", f"{left_out} more not shown. {FULL}", class_="soft")] if left_out else []
    seen = len(told) if len(told) <= MAX_SEEN + 1 else MAX_SEEN
    body = told[:seen]
    if told[seen:]:
        body.append(folded(f"{len(found) - seen} more alike", lines([*told[seen:], *rest]), class_="more"))
    given = dict.fromkeys((each.clause, each.fix.text if len(found) == 1 else each.fix.general) for each in shown)
    advice = [_advice(clause, remedy) for clause, remedy in given]
    open_ = list(Severity)[rank] in _OPEN
    return folded(title, element("div", lines([*body, *advice]), class_="rule"), open_=open_, class_="findings")


def _finding(sheet: Sheet, finding: Finding, worst: Severity, consequences: Consequences) -> Html:
    parts: list[Html] = []
    own = element("span", severity(finding.severity), " ") if finding.severity is not worst else NOTHING
    named = finding.enclave is None or finding.message.startswith(finding.enclave)
    enclave = NOTHING if named or finding.enclave is None else element("code", finding.enclave, class_="enclave")
    parts.append(element("p", own, enclave, shorten(finding.message, MAX_MESSAGE)))
    parts.append(_places(finding.locations, finding.message))
    under = sheet.under(finding.profiles)
    if under:
        parts.append(element("p", under, class_="under"))
    parts += [_consequence(each, example) for each, example in consequences.of(finding)]
    return element("article", joined(parts))


def _places(locations: Sequence[Location], message: str) -> Html:
    """The places, each with what is said of it unless the message says the same."""
    shown = [_place(location, message.casefold()) for location in locations[:MAX_PLACES]]
    if len(locations) > MAX_PLACES:
        more = counted(len(locations) - MAX_PLACES, "more place")
        shown.append(element("span", f"{more}. {FULL}", class_="soft"))
    return items(shown, class_="places")


def _place(location: Location, message: str) -> Html:
    said = location.message.casefold() in message
    note = NOTHING if said else element("span", f" {location.message}", class_="soft")
    return joined([place(location.path, location.line), note])


def _advice(clause: str, remedy: str) -> Html:
    parts: list[Html] = []
    if remedy:
        parts.append(element("div", element("dt", "what to do"), element("dd", *_code_in(remedy))))
    if clause:
        parts.append(element("div", element("dt", "clause"), element("dd", clause)))
    return element("dl", lines(parts), class_="advice") if parts else NOTHING


def _code_in(text: str) -> Iterator[Html | str]:
    """The text with what stands between backquotes as code; our own remedies have commands in them."""
    for number, part in enumerate(text.split("`")):
        yield element("code", part) if number % 2 else part


def _consequence(finding: Finding, example: str) -> Html:
    head = joined(["so ", severity(finding.severity), " ", element("span", finding.code, class_="code"), " "])
    words = f"the property {finding.name} is violated, for example: {shorten(example, MAX_MESSAGE)}"
    return element("p", head, words, class_="so")


def _accepted(findings: Iterable[Finding]) -> Html:
    """What somebody accepts, with who, why and until when."""
    parts = []
    for finding in findings:
        if (accepted := finding.suppressed) is not None:
            head = joined([severity(finding.severity), element("span", finding.code, class_="code"), finding.message])
            until = f"accepted until {accepted.until} by {accepted.owner} ({accepted.source}): {accepted.reason}"
            parts.append(element("article", element("p", head), element("p", until, class_="soft")))
    if not parts:
        return NOTHING
    title = joined([element("strong", "Accepted, not counted"), element("span", f"×{len(parts)}", class_="many")])
    kept = parts[:MAX_OF_RULE]
    if len(parts) > len(kept):
        kept.append(element("p", f"{len(parts) - len(kept)} more not shown. {FULL}", class_="soft"))
    return folded(title, element("div", lines(kept), class_="rule"), class_="findings accepted")
