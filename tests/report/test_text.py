"""The text report: its exact form, what it must never leave out, and that no name steers the terminal."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from rich.cells import cell_len

from keystore_audit.findings import Finding, Location, Outcome, Result, Severity, decision
from keystore_audit.model.question import Usability
from keystore_audit.properties import Status
from keystore_audit.properties.result import EngineStatus, ProfileResult, PropertyResult
from keystore_audit.report.causes_text import MAX_ABOUT, MAX_ALIKE, MAX_PLACES
from keystore_audit.report.content import PLAIN, Report, Verdict, View
from keystore_audit.report.text import render, render_several
from keystore_audit.truth import Truth
from tests.cli.keystores import answer
from tests.report.outcomes import outcomes_of
from tools.samples.store import copy_with_modes

MakeReport = Callable[..., Report]
Golden = Callable[[str, str], None]

COLOUR = re.compile(r"\x1b\[[0-9;]*m")
NAMES = st.text(st.characters(), min_size=1, max_size=60) | st.sampled_from(
    ["\x1b[2J", "\x9b31m", "\u202eevil", "[red]x[/red]", ":smile:", "a\nFAIL\rPASS", "車" * 50, "x" * 300, "\udcff"]
)


def full(report: Report, view: View = PLAIN) -> str:
    """The verbose report."""
    return render(report, replace(view, verbose=True))


def flat(text: str) -> str:
    """The text without its line breaks and indents."""
    return " ".join(text.split())


def engines(report: Report, **changes: object) -> Report:
    """The report of an audit in which this is so of Alloy's run."""
    return replace(report, engines=(replace(report.engines[0], **changes), report.engines[1]), engines_agree=None)


def contradicted(report: Report) -> Report:
    said = {"alloy": Status.HOLDS, "native": Status.VIOLATED}
    answer = ProfileResult(status=Status.UNKNOWN, engines=said, counterexample=None)
    prop = PropertyResult(prop=report.properties[0].prop, profiles={"spec": answer})
    return replace(report, properties=(prop,), engines_agree=False)


def circle(report: Report) -> Report:
    """Two findings that explain each other."""
    first, second = report.findings[:2]
    first = replace(first, explained_by=(second.fingerprint,))
    return replace(report, findings=(first, replace(second, explained_by=(first.fingerprint,))))


def ranked(report: Report, *severities: Severity) -> Report:
    """The signature, what follows from it and a certificate that expires, this severe."""
    found = (replace(each, severity=how) for each, how in zip(report.findings, severities, strict=False))
    return replace(report, findings=(*found, report.findings[4]))


def undecided(report: Report) -> Report:
    open_ = Outcome(rule="KA501", subject="enclaves/talker/permissions.p7s", outcome=Result.OPEN)
    left = {"findings": (), "outcomes": outcomes_of([open_])}
    return replace(report, verdict=Verdict.INCOMPLETE, exit_code=4, **left)


def starting(report: Report) -> Report:
    """Enclaves that start for some, for none, and for the same reason but for their names."""
    talker = report.enclaves[0]
    refused = Usability(usable=Truth.NO, reasons=("the key does not belong", "key.pem is not there."))
    unclear = Usability(usable=Truth.UNKNOWN, reasons=("two texts",))
    uses = {"spec": refused, "fastdds-2.6": unclear, "cyclonedds-0.10": Usability(usable=Truth.YES, reasons=())}
    unnamed = (
        replace(
            talker,
            path=f"/{name}",
            subject=f"CN=/{name}",
            profiles={"spec": Usability(usable=Truth.NO, reasons=(why,))},
        )
        for name, why in (("x", "no grant names CN=/x"), ("y", "no grant names CN=/y"))
    )
    some = (replace(talker, path="/a", profiles=uses), replace(talker, path="/c", profiles={"spec": refused}))
    return replace(report, enclaves=(*some, replace(talker, path="/b", profiles=uses), *unnamed))


def fixed_together(report: Report) -> Report:
    """One cause in two enclaves, what follows from each, and what has another cause, too."""
    cause = replace(report.findings[2], enclave="/a", message="The same.", severity=Severity.HIGH)
    again = replace(cause, enclave="/b", fingerprint="f" * 64)
    other = replace(cause, code="KA999", fingerprint="c" * 64)
    causes = ((cause,), (again,), (cause, other))
    follow = (
        replace(report.findings[0], explained_by=tuple(each.fingerprint for each in why), fingerprint=str(number) * 64)
        for number, why in enumerate(causes)
    )
    return replace(report, findings=(cause, again, other, *follow))


def itself(report: Report) -> Report:
    """What the audit says of itself, and what is the worst behind a lesser cause."""
    signed, _so, expires, *_rest = report.findings
    own = replace(signed, code="KA906", name="property-undecided", enclave=None)
    worst = replace(signed, code="KA703", fingerprint="e" * 64, explained_by=(expires.fingerprint,))
    high = replace(signed, severity=Severity.HIGH, code="KA222")
    return replace(report, findings=(own, replace(own, enclave="/talker"), worst, high, signed, expires))


def scattered(report: Report) -> Report:
    """More places than are shown, and an excerpt."""
    places = tuple(Location(path=f"enclaves/{number}") for number in range(MAX_PLACES + 2))
    found = (report.findings[0], replace(report.findings[2], locations=places))
    return replace(report, findings=found, excerpts={("enclaves/talker/permissions.p7s", 41): "<topic>rt/*</topic>"})


VERBOSE, QUIET = View(verbose=True), View(quiet=True)
CRITICAL, HIGH, MEDIUM, LOW = Severity.CRITICAL, Severity.HIGH, Severity.MEDIUM, Severity.LOW
Change = Callable[[Report], Report]
SHOWN: dict[str, tuple[Change, View]] = {
    "default": (lambda report: report, PLAIN),
    "verbose": (lambda report: report, VERBOSE),
    "quiet": (lambda report: report, QUIET),
    "quiet-but-open": (
        lambda report: replace(
            report, findings=tuple(replace(f, undecided=f.code == "KA205") for f in report.findings)
        ),
        QUIET,
    ),
    "no-findings": (
        lambda report: replace(report, findings=(), verdict=Verdict.PASS, exit_code=0, weakened=(), scope=""),
        VERBOSE,
    ),
    "no-date": (lambda report: replace(report, safe_until=None), VERBOSE),
    "cause-hidden": (lambda report: ranked(report, LOW, HIGH), View(min_severity=HIGH)),
    "cause-lesser-than-what-follows": (lambda report: ranked(report, LOW, CRITICAL, MEDIUM), VERBOSE),
    "explain-each-other": (circle, VERBOSE),
    "fixed-together": (fixed_together, VERBOSE),
    "fixed-together-briefly": (fixed_together, PLAIN),
    "the-audit-itself": (itself, VERBOSE),
    "places": (scattered, VERBOSE),
    "starting": (starting, VERBOSE),
    "incomplete": (undecided, PLAIN),
    "incomplete-quiet": (undecided, QUIET),
    "engine-missing": (lambda r: engines(r, status=EngineStatus.MISSING, reason="no Java was found"), VERBOSE),
    "engine-out-of-scale": (lambda r: engines(r, status=EngineStatus.OUT_OF_SCALE, reason="too large"), VERBOSE),
    "engine-too-slow": (lambda r: engines(r, status=EngineStatus.TIMEOUT, reason="120 s"), VERBOSE),
    "no-engine": (
        lambda r: replace(r, engines=tuple(replace(run, status=EngineStatus.FAILED) for run in r.engines)),
        VERBOSE,
    ),
    "engines-disagree": (contradicted, VERBOSE),
}
"""What of a report is otherwise, and how it is shown."""


@pytest.mark.parametrize("what", SHOWN)
def test_a_report_is_shown_as_it_was(what: str, make_report: MakeReport, golden: Golden) -> None:
    change, view = SHOWN[what]
    golden(f"report/{what}.txt", render(change(make_report()), view))


def test_who_starts_nowhere_is_not_said_to_start_somewhere(make_report: MakeReport) -> None:
    short = " ".join(render(starting(make_report())).split())
    assert "/c, /x, /y: its DDS participant starts nowhere" in short
    assert "/a, /b: its DDS participant does not start everywhere" in short
    assert "/a, /b: unknown whether its DDS participant starts" in short


def test_several_reports_are_shown_as_they_were(make_report: MakeReport, golden: Golden) -> None:
    passed = make_report("[red]b[/red]:smile:", verdict=Verdict.PASS, exit_code=0)
    golden("report/several.txt", render_several([make_report("a"), passed]))


@pytest.mark.parametrize(("sample", "most"), [("stock/talker_listener", 30), ("healthy/turtlesim", 20)])
def test_a_stock_keystore_fits_one_screen(
    sample: str,
    most: int,
    repository: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    golden: Golden,
) -> None:
    """Golden files, with the modes that git cannot hold as sros2 leaves them."""
    name = sample.rpartition("/")[2]
    copy_with_modes(repository / "sample_keystores" / sample, tmp_path / name, 0o644)
    monkeypatch.chdir(tmp_path)
    _exit_code, text = answer("audit", name, "--engine", "native", "--at", "2026-11-24T00:00:00Z")
    assert text.count("\n") <= most
    golden(f"report/{name}.txt", text)


@settings(max_examples=60, deadline=None)
@given(name=NAMES, width=st.sampled_from([20, 40, 80, 110]), verbose=st.booleans(), quiet=st.booleans())
def test_no_name_steers_the_terminal(
    name: str, width: int, verbose: bool, quiet: bool, make_report: MakeReport
) -> None:
    view = View(width=width, verbose=verbose, quiet=quiet)
    plain = render(make_report(name), view)
    assert COLOUR.sub("", render(make_report(name), replace(view, color=True))) == plain
    for line in plain.split("\n"):
        assert not {unicodedata.category(character) for character in line} & {"Cc", "Cs", "Zl", "Zp"}
        assert not set(line) & set("\u202e\u2066\u200b\u00ad\ufeff")
        assert cell_len(line) <= max(width, 40)
        assert line == line.rstrip()
    assert plain.encode()


def test_colour_is_never_the_only_sign(make_report: MakeReport) -> None:
    coloured, plain = (full(make_report(), View(color=color)) for color in (True, False))
    assert coloured != plain
    for word in ("CRITICAL", "MEDIUM", "INFO", "VIOLATED", "FAIL", "WARNING", "CANNOT START"):
        assert word in plain


def test_a_thousand_findings_keep_their_order(make_report: MakeReport) -> None:
    report = make_report()
    finding: Finding = report.findings[2]
    high = replace(finding, severity=Severity.HIGH)  # of lesser ones the first are shown
    many = tuple(
        replace(high, enclave=f"/e{n:04}", message=f"Number {n}.", fingerprint=f"{n:064x}") for n in range(1000)
    )
    text = full(replace(report, findings=many))
    places = [text.index(f"  Number {n}.\n") for n in range(MAX_ALIKE)]
    assert places == sorted(places)
    assert f"and {1000 - MAX_ALIKE} more of KA205, about /e{MAX_ALIKE:04}, " in text
    assert f"and {1000 - MAX_ALIKE - MAX_ABOUT} more (all are in the JSON report)" in flat(text)


@pytest.mark.parametrize("severity", [Severity.CRITICAL, Severity.LOW])
def test_what_is_the_same_but_for_the_enclave_is_said_once(severity: Severity, make_report: MakeReport) -> None:
    report = make_report()
    first = replace(report.findings[2], message="/e0 is the same.", enclave="/e0", severity=severity)
    others = tuple(
        replace(first, message=f"/e{n} is the same.", enclave=f"/e{n}", fingerprint=f"{n:064x}") for n in range(1, 9)
    )
    text = full(replace(report, findings=(first, *others)))
    places = "".join(f"          /e{n}  ({first.locations[0]})\n" for n in range(2, 7))
    also = f"  also    /e1  ({first.locations[0]})\n{places}          and 2 more (all are in the JSON report)\n"
    assert also in text
    assert (text.count(" is the same."), text.count("Likewise for the others.")) == (1, 1)
    for other in (
        replace(others[0], message="/e1 is another."),
        replace(others[0], message="ENCLAVE is the same."),
        replace(others[0], severity=Severity.MEDIUM),
        replace(others[0], fix=decision("Something else.")),
        replace(others[0], profiles=("spec",)),
        replace(others[0], enclave=None),
    ):
        both = full(replace(report, findings=(first, other)))
        assert "  also " not in both
        assert sum(both.count(message) for message in {first.message, other.message}) == 2


def test_what_decides_has_a_line_to_type_and_its_own_message_in_full(make_report: MakeReport) -> None:
    report = make_report()
    signed, _itself, expires, _accepted, _key = report.findings
    long = replace(signed, message="word " * 60 + "end.")
    text = render(replace(report, findings=(long, expires)))
    assert "\nkeystore-audit explain KA302\n" in text
    assert "explain KA205" not in text, "medium findings fail no gate here"
    assert flat(text).count("word") == 60
    assert "explain KA205" in render(replace(report, findings=(expires,), fail_on=Severity.MEDIUM))
