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
from keystore_audit.properties.result import EngineRun, EngineStatus, ProfileResult, PropertyResult
from keystore_audit.report import html as html_page
from keystore_audit.report import markdown
from keystore_audit.report.causes_text import MAX_ABOUT, MAX_ALIKE, MAX_PLACES
from keystore_audit.report.content import Report, Verdict
from keystore_audit.report.text import PLAIN, View, render, render_several
from keystore_audit.truth import Truth
from tests.cli.keystores import answer
from tests.report.outcomes import outcomes_of
from tools.samples.store import copy_with_modes

MakeReport = Callable[..., Report]

EXPECTED = Path(__file__).with_name("expected_text.txt")
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


def test_the_report_at_80_columns(make_report: MakeReport) -> None:
    assert render(make_report()) == EXPECTED.read_text()


@pytest.mark.parametrize(("sample", "most"), [("stock/talker_listener", 30), ("healthy/turtlesim", 20)])
def test_a_stock_keystore_fits_one_screen(
    sample: str, most: int, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Golden files, with the modes that git cannot hold as sros2 leaves them."""
    name = sample.rpartition("/")[2]
    copy_with_modes(repository / "sample_keystores" / sample, tmp_path / name, 0o644)
    monkeypatch.chdir(tmp_path)
    _exit_code, text = answer("audit", name, "--engine", "native", "--at", "2026-11-24T00:00:00Z")
    assert text.count("\n") <= most
    assert text == EXPECTED.with_name(f"expected_{name}.txt").read_text()


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


def test_markup_and_emoji_in_names_stay_as_they_are(make_report: MakeReport) -> None:
    text = full(make_report("[red]x[/red]:smile:"))
    assert "/[red]x[/red]:smile:" in text


def test_colour_is_never_the_only_sign(make_report: MakeReport) -> None:
    coloured, plain = (full(make_report(), View(color=color)) for color in (True, False))
    assert coloured != plain
    for word in ("CRITICAL", "MEDIUM", "INFO", "VIOLATED", "FAIL", "WARNING", "CANNOT START"):
        assert word in plain


def test_a_violated_property_is_told_once_under_its_cause(make_report: MakeReport) -> None:
    text = flat(full(make_report()))
    assert text.count("KA705") == 1
    assert "so HIGH KA705: property no-enclave-grants-itself-rights is violated, e.g. /talker can sign" in text


def test_a_violated_property_whose_cause_is_hidden_is_told_by_itself(make_report: MakeReport) -> None:
    report = make_report()
    signed, grants_itself, *rest = report.findings
    milder = replace(signed, severity=Severity.LOW)
    text = render(replace(report, findings=(grants_itself, *rest, milder)), View(min_severity=Severity.HIGH))
    assert "KA302" not in text
    assert "HIGH     KA705 no-enclave-grants-itself-rights" in text
    assert "4 below high not shown (--min-severity)." in text


def test_findings_that_explain_each_other_do_not_vanish(make_report: MakeReport) -> None:
    report = make_report()
    first, second = report.findings[:2]
    first = replace(first, explained_by=(second.fingerprint,))
    second = replace(second, explained_by=(first.fingerprint,))
    text = full(replace(report, findings=(first, second)))
    assert "KA302 signed-by-an-identity" in text
    assert "KA705 no-enclave-grants-itself-rights" in text


def test_the_worst_comes_first_and_a_cause_ranks_as_its_consequence(make_report: MakeReport) -> None:
    report = make_report()
    signed, grants_itself, expires, _accepted, ca_key = report.findings
    low = replace(signed, severity=Severity.LOW)
    high = replace(grants_itself, severity=Severity.CRITICAL)
    text = full(replace(report, findings=(high, expires, low, ca_key)))
    order = [text.index(word) for word in ("CRITICAL KA302", "MEDIUM   KA205", "INFO     KA109")]
    assert order == sorted(order)


@pytest.mark.parametrize("status", [EngineStatus.MISSING, EngineStatus.OUT_OF_SCALE, EngineStatus.TIMEOUT])
def test_an_engine_that_did_not_answer_is_said_before_any_finding(
    make_report: MakeReport, status: EngineStatus
) -> None:
    report = make_report()
    alloy = EngineRun(name="alloy", version=None, status=status, reason="no Java was found", required=False)
    text = flat(full(replace(report, engines=(alloy, report.engines[1]), engines_agree=None)))
    warning = text.index("no Java was found. The properties rest on native alone.")
    assert warning < text.index("KA302")


def test_no_engine_at_all_is_said(make_report: MakeReport) -> None:
    failed = tuple(replace(run, status=EngineStatus.FAILED) for run in make_report().engines)
    assert "No engine has answered: no property was decided." in flat(full(make_report(engines=failed)))


def test_engines_that_disagree_are_shown_with_what_each_says(make_report: MakeReport) -> None:
    report = make_report(engines_agree=False)
    answer = ProfileResult(
        status=Status.UNKNOWN, engines={"alloy": Status.HOLDS, "native": Status.VIOLATED}, counterexample=None
    )
    prop = PropertyResult(prop=report.properties[0].prop, profiles={"spec": answer})
    text = flat(full(replace(report, properties=(prop,))))
    assert "The engines disagree" in text
    assert "UNKNOWN documents-signed-by-the-permissions-ca alloy says holds, native says violated" in text


def test_incomplete_is_never_read_as_a_pass(make_report: MakeReport) -> None:
    open_question = Outcome(rule="KA501", subject="enclaves/talker/permissions.p7s", outcome=Result.OPEN)
    report = make_report(verdict=Verdict.INCOMPLETE, exit_code=4, findings=(), outcomes=outcomes_of([open_question]))
    for view in (View(), View(quiet=True)):
        text = render(report, view)
        assert "INCOMPLETE  No findings; exit code 4\n" in text
        assert "Something could not be decided (open: KA501): this is no pass" in flat(text)


def test_quiet_shows_what_decided_and_nothing_else(make_report: MakeReport) -> None:
    text = render(make_report(), View(quiet=True))
    assert flat(text) == (
        "FAIL 1 cause at critical, 1 medium, 1 note (1 that follow, 1 accepted); exit code 1 "
        "scope: DDS-Security 1.1, Fast DDS 2.6 (Humble), Cyclone DDS 0.10 (Humble, Jazzy, Kilted) "
        "fails on Cyclone DDS 0.10 (Humble, Jazzy, Kilted) only "
        "WARNING Weakened gate: --at 2025-06-01T00:00:00Z. "
        "HOLDS IF peers announce endpoints truthfully (Cyclone DDS does not check) "
        "CRITICAL KA302 signed-by-an-identity enclaves/talker/permissions.p7s:41"
    )


def test_quiet_shows_milder_findings_that_leave_a_question_open(make_report: MakeReport) -> None:
    report = make_report(verdict=Verdict.INCOMPLETE)
    open_ = tuple(replace(each, undecided=each.code == "KA205") for each in report.findings)
    assert "KA205" in render(replace(report, findings=open_), View(quiet=True))


def test_verbose_adds_outcomes(make_report: MakeReport) -> None:
    assert "  KA205  1 pass, 1 fail\n" in full(make_report(), View(verbose=True))


def test_no_findings_are_said(make_report: MakeReport) -> None:
    text = full(make_report(findings=(), verdict=Verdict.PASS, exit_code=0, weakened=(), scope=""))
    assert "\nPASS  No findings; exit code 0\n" in text
    assert "WARNING" not in text
    assert "Holds until 2025-06-20T00:00:00Z" in text


def test_no_date_is_said(make_report: MakeReport) -> None:
    assert "No date on these files changes this answer." in full(make_report(safe_until=None))


def test_safe_until_is_about_new_sessions_and_says_so(make_report: MakeReport) -> None:
    """Design, section 3: some implementations never end running sessions, which is said with it."""
    until, never = make_report(), make_report(safe_until=None)
    for form in (
        full,
        lambda report: markdown.render([report], Severity.INFO),
        lambda report: html_page.render([report]),
    ):
        assert "ends none when a grant ends" in flat(form(until))
        assert "ends none when a grant ends" not in flat(form(never))
        ended = make_report(safe_until_why="no grant in force names CN=/a,O=Robots Ltd.")
        assert "Ltd. Sessions" in flat(form(ended)).replace("\\", "")


def test_several_keystores_end_in_one_line(make_report: MakeReport) -> None:
    text = render_several([make_report("a"), make_report("b", verdict=Verdict.PASS, exit_code=0)])
    assert text.endswith("\n2 keystores: 1 pass, 1 fail, 0 incomplete\n")
    assert text.count("keystore-audit 0.1.0") == 2


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


def test_what_follows_follows_where_all_its_causes_are_fixed_together(make_report: MakeReport) -> None:
    report = make_report()
    cause = replace(report.findings[2], enclave="/a", message="The same.", severity=Severity.HIGH)
    again = replace(cause, enclave="/b", fingerprint="f" * 64)
    so = replace(report.findings[0], explained_by=(cause.fingerprint,), fingerprint="d" * 64)
    so_too = replace(so, explained_by=(again.fingerprint,), fingerprint="e" * 64)
    for consequences in (), (so,), (so, so_too):
        text = full(replace(report, findings=(cause, again, *consequences)))
        assert text.count("The same.") == 1, "they are fixed together"
        assert text.count("  so      ") == len(consequences)
        assert text.count(" KA302: property ") == len(consequences)
    other = replace(cause, code="KA999", fingerprint="c" * 64)
    both = replace(so, explained_by=(cause.fingerprint, other.fingerprint))
    text = render(replace(report, findings=(cause, other, both)))
    assert "KA302 too, which have other causes besides and stay" in text
    assert "more follow" not in text


@pytest.mark.parametrize(("more", "said"), [(1, "and 1 more place (all"), (2, "and 2 more places (all")])
def test_places_that_are_not_shown_are_counted(more: int, said: str, make_report: MakeReport) -> None:
    report = make_report()
    places = tuple(Location(path=f"enclaves/{number}") for number in range(MAX_PLACES + more))
    assert said in full(replace(report, findings=(replace(report.findings[2], locations=places),)))


def test_what_decides_has_a_line_to_type_and_its_own_message_in_full(make_report: MakeReport) -> None:
    report = make_report()
    signed, _itself, expires, _accepted, _key = report.findings
    long = replace(signed, message="word " * 60 + "end.")
    text = render(replace(report, findings=(long, expires)))
    assert "\nkeystore-audit explain KA302\n" in text
    assert "explain KA205" not in text, "medium findings fail no gate here"
    assert flat(text).count("word") == 60
    assert "explain KA205" in render(replace(report, findings=(expires,), fail_on=Severity.MEDIUM))


def test_an_excerpt_is_marked_below(make_report: MakeReport) -> None:
    report = make_report(excerpts={("enclaves/talker/permissions.p7s", 41): "<topic>rt/*</topic>"})
    assert "   41 | <topic>rt/*</topic>\n      | ^^^^^^^^^^^^^^^^^^^\n" in render(report)


@pytest.mark.parametrize(
    ("example", "told"),
    [
        ("The identity of /b could not be read.", "e.g. the identity of /b"),
        ("A participant joins.", "e.g. a participant joins."),
        ("Fast DDS takes it.", "e.g. Fast DDS takes it."),
        ("CN=/a can sign.", "e.g. CN=/a can sign."),
        ("/talker can sign.", "e.g. /talker can sign."),
    ],
)
def test_an_example_goes_on_in_the_sentence(make_report: MakeReport, example: str, told: str) -> None:
    report = make_report()
    signed, grants_itself, *_rest = report.findings
    consequence = replace(grants_itself, name="of-no-property", message=example)
    text = " ".join(full(replace(report, findings=(signed, consequence))).split())
    assert f"is violated, {told}" in text
    alone = replace(grants_itself, message=example, explained_by=())
    text = flat(full(replace(report, findings=(alone,))))
    assert f"{alone.name} E{told[1:]}" in text, "there may be more of it"
    assert f"{signed.name} {signed.message}" in flat(full(replace(report, findings=(signed,))))


def test_reasons_follow_a_colon_and_are_listed(make_report: MakeReport) -> None:
    report = make_report()
    talker = report.enclaves[0]
    refused = Usability(usable=Truth.NO, reasons=("the key does not belong", "key.pem is not there."))
    unclear = Usability(usable=Truth.UNKNOWN, reasons=("two texts",))
    uses = {"spec": refused, "fastdds-2.6": unclear, "cyclonedds-0.10": Usability(usable=Truth.YES, reasons=())}
    text = full(replace(report, enclaves=(replace(talker, profiles=uses),)))
    flat = " ".join(text.split())
    assert "CANNOT START under spec: the key does not belong; key.pem is not there. UNKNOWN whether" in flat
    assert (
        "UNKNOWN whether it can start, under fastdds-2.6: two texts. a DDS participant starts under cyclonedds-0.10."
        in flat
    )
    same, other = replace(talker, path="/b", profiles=uses), replace(talker, path="/c", profiles={"spec": refused})
    text = full(replace(report, enclaves=(replace(talker, path="/a", profiles=uses), other, same)))
    assert "\n  /a, /b\n    CANNOT START under spec: " in text
    assert (text.count("two texts"), text.count("/c  (")) == (1, 1)
    own = {
        f"/{name}": {"spec": Usability(usable=Truth.NO, reasons=(f"no grant names CN=/{name}",))} for name in ("a", "b")
    }
    both = [replace(talker, path=path, subject=f"CN={path}", profiles=uses) for path, uses in own.items()]
    text = full(replace(report, enclaves=tuple(both)))
    assert "\n  /a, /b\n    CANNOT START under all profiles: no grant names its identity.\n" in text
    assert "no grant names CN=/a.\n" in full(replace(report, enclaves=tuple(both[:1])))


def test_the_cause_of_the_worst_comes_first_though_it_is_lesser(make_report: MakeReport) -> None:
    report = make_report()
    signed, _grants_itself, expires, *_rest = report.findings
    high = replace(signed, severity=Severity.HIGH, code="KA222")
    worst = replace(signed, code="KA703", fingerprint="e" * 64, explained_by=(expires.fingerprint,))
    text = render(replace(report, findings=(worst, high, expires)))
    assert text.index("CRITICAL KA205") < text.index("HIGH     KA222")
    alone = render(replace(report, findings=(replace(worst, explained_by=()), high, expires)))
    assert alone.index("CRITICAL KA703") < alone.index("HIGH     KA222") < alone.index("MEDIUM   KA205")


def test_what_the_audit_says_of_itself_comes_after_its_cause(make_report: MakeReport) -> None:
    report = make_report()
    signed, *_rest = report.findings
    own = replace(signed, code="KA906", name="property-undecided", enclave=None)
    text = full(replace(report, findings=(own, replace(own, enclave="/talker"), signed)))
    assert text.index("KA302") < text.index("KA906")
