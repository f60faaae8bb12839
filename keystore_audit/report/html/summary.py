"""The head of a report: the verdict, and everything that it rests on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from keystore_audit.findings import Severity
from keystore_audit.properties.property import Status
from keystore_audit.report.authorities_text import HOW, settings
from keystore_audit.report.content import Report, Verdict
from keystore_audit.report.engine_words import engine, until, warnings
from keystore_audit.report.html.element import NOTHING, Html, digest, element, items, joined, lines, name
from keystore_audit.report.html.sheet import Sheet, severity
from keystore_audit.text import counted, instant, shorten

_VERDICTS: Final = {
    Verdict.PASS: ("✓", "Pass"),
    Verdict.FAIL: ("✗", "Fail"),
    Verdict.INCOMPLETE: ("?", "Incomplete"),
}
MAX_TITLE: Final = 120
"""Characters of the keystore's path in the heading."""


def head(sheet: Sheet) -> Html:
    """Return the verdict with its counts, the facts, and what the verdict rests on."""
    report = sheet.report
    stamp = element("p", verdict(report.verdict))
    return element(
        "header",
        element("div", element("h1", element("code", shorten(report.keystore, MAX_TITLE))), class_="title"),
        element("div", stamp, element("div", *_sentences(report), class_="said"), class_="stamp"),
        _counts(report),
        _warnings(report),
        element("div", _facts(sheet), _rests(report), class_="rests"),
        class_=f"head {report.verdict.value}",
        id=sheet.anchor("top"),
    )


def verdict(value: Verdict) -> Html:
    """Return a verdict: shape, word and colour."""
    mark, word = _VERDICTS[value]
    return element(
        "span", element("span", mark, class_="mark", aria_hidden="true"), word, class_=f"verdict {value.value}"
    )


def _sentences(report: Report) -> Iterator[Html]:
    """What the verdict means, and until when."""
    gate = (
        "Nothing fails this gate." if report.fail_on is None else f"The gate fails at {report.fail_on.value} or worse."
    )
    if report.verdict is Verdict.INCOMPLETE:
        words = "Something could not be decided, and what cannot be decided is no pass. "
    elif report.verdict is Verdict.FAIL:
        words = "Somebody can do what this keystore seems to forbid, or a robot cannot start. "
    else:
        words = "Nothing was found that fails this gate. " if report.fail_on is not None else ""
    yield element("p", words + gate)
    if report.holds_if:
        yield element("p", report.holds_if)
    if report.safe_until is None:
        dates = "No date in the keystore changes this answer."
    elif report.safe_until <= report.at:
        dates = f"Nothing can be said of the future: {report.safe_until_why}."
    else:
        dates = f"This answer holds until {instant(report.safe_until)}: {until(report)}"
    yield element("p", dates, class_="soft")


def _counts(report: Report) -> Html:
    """The findings by severity; none is said too."""
    summary = report.summary
    return element(
        "ul",
        lines(
            element(
                "li",
                element("span", str(summary[each]), class_="number"),
                severity(each),
                class_="some" if summary[each] else "none",
            )
            for each in Severity
        ),
        class_="counts",
        aria_label="Findings by severity",
    )


def _warnings(report: Report) -> Html:
    """Everything that makes the verdict reach less far than it seems to."""
    told = list(warnings(report, versions=True))
    return element("div", element("h2", "Read this first"), items(told), class_="warnings") if told else NOTHING


def _facts(sheet: Sheet) -> Html:
    report = sheet.report
    checked = report.checked
    holding = sum(result.status is Status.HOLDS for result in report.properties)
    rows: list[tuple[str, Html | str]] = [
        ("as of", instant(report.at)),
        ("layout", f"{report.layout}, {counted(len(report.enclaves), 'enclave')}"),
        *([("scope", report.scope)] if report.scope else []),
        ("judged as", ", ".join(sheet.profiles)),
        ("properties", f"{holding} of {len(report.properties)} hold"),
        ("engines", lines(element("div", engine(run, version=True)) for run in report.engines)),
        (
            "looked at",
            ", ".join(
                counted(number, noun)
                for number, noun in (
                    (checked.certificates, "certificate"),
                    (checked.documents, "signed document"),
                    (checked.channels, "topic channel"),
                    (checked.rules, "rule"),
                )
            ),
        ),
        *_authorities(report),
        ("SHA-256", digest(report.digest)),
        *_files(report),
    ]
    pairs = [element("div", element("dt", label), element("dd", value)) for label, value in rows]
    return element("dl", lines(pairs), class_="facts")


def _authorities(report: Report) -> Iterator[tuple[str, Html | str]]:
    told = "declared" if report.authorities_declared else "as found"
    for anchors in report.authorities:
        rows = [joined([name(each.subject), " ", element("code", f"sha256:{each.sha256}")]) for each in anchors.here]
        yield f"{anchors.role} CA, {told}", lines(rows) if rows else "none that can be told"


def _files(report: Report) -> Iterator[tuple[str, Html | str]]:
    for label, file in report.given_files:
        yield label, joined([element("div", name(file.path)), digest(file.sha256)])


def _rests(report: Report) -> Html:
    assumed = element(
        "div", element("h2", "Assumed"), items((*(each.sentence for each in report.assumptions), *report.stated))
    )
    unchecked = element("div", element("h2", "Not checked"), items(report.checked.not_checked))
    declared = lines(element("code", line) for line in settings(report))
    lines_to_paste = element("div", element("p", HOW), declared) if declared != NOTHING else NOTHING
    return element("div", assumed, lines_to_paste, unchecked, class_="assumed")
