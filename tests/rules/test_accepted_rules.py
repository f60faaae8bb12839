"""KA909, KA910: what is accepted, what is not, and that nothing hides behind it."""

from __future__ import annotations

import re
from datetime import timedelta
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.findings import MAX_PLACES, Finding, Location, Result, Severity, decision
from keystore_audit.keystore.files import Status as FileStatus
from keystore_audit.rules import RULES
from keystore_audit.rules.judge import judge
from keystore_audit.rules.registry import Violation
from keystore_audit.settings.suppressions import (
    Fate,
    FileOfUses,
    Suppression,
    accepted,
    check_dates,
    uses,
)
from tests.rules.evidence import AT, DAY, absent, context, healthy, judged
from tests.rules.test_judge import made

PROFILES = ("spec", "fastdds-3.6")


def suppression(code: str = "KA205", **more: Any) -> Suppression:
    """One until the day after the audit's."""
    if "fingerprint" not in more:
        more = {"where": ("*",), **more}
    more = {"reason": "it is so", "owner": "Ada", "until": (AT + DAY).date(), **more}
    line = more.pop("line", 3)
    file = more.pop("file", "keystore-audit.toml")
    return Suppression(
        code=code, location=Location(path=file, line=line, beside=True), place=f"{file}:{line}:1", **more
    )


def test_nothing_accepts_what_is_undecided() -> None:
    store = healthy()
    link = absent("enclaves/more", FileStatus.DIRECTORY, "to /opt")
    linked = replace(store, layout=replace(store.layout, directory_links=(link,)))
    (plain,) = judged(linked).findings
    assert plain.undecided
    for entry in (suppression(plain.code), suppression(plain.code, fingerprint=plain.fingerprint)):
        judgement = judged(linked, suppressions=(entry,))
        assert [(f.code, f.suppressed) for f in judgement.findings] == [(plain.code, None), ("KA910", None)]
        assert "undecided, and nothing accepts that" in judgement.findings[1].message
        assert any(outcome.outcome is Result.OPEN for outcome in judgement.outcomes)


# What findings mean: by hand


def finding(code: str = "KA205", mark: str = "a", **more: Any) -> Finding:
    more = {
        "name": "x", "severity": Severity.HIGH, "message": "", "fix": decision("Do it."), "clause": "", "enclave": None,
        "locations": (Location(path="enclaves/talker/cert.pem"),), **more,
    }  # fmt: skip
    return Finding(code=code, fingerprint=mark * 64, **more)


def fate(entry: Suppression, *findings: Finding) -> tuple[Fate, str]:
    ((use,),) = (file.uses for file in uses(findings, [entry], AT, PROFILES))
    assert bool(use.findings) is (use.fate is Fate.USED)
    return use.fate, use.why


@pytest.mark.parametrize(
    ("limits", "changed", "why"),
    [
        ({"severity": Severity.HIGH}, {"severity": Severity.CRITICAL}, "it is critical now, and high was accepted"),
        ({"profiles": frozenset({"spec"})}, {"profiles": PROFILES}, "it holds under fastdds-3.6 too"),
        ({"profiles": frozenset({"spec"})}, {"profiles": ()}, "it holds under fastdds-3.6 too"),
        ({"meaning": ""}, {"meaning": "c" * 64}, "what it is about has changed"),
    ],
)
def test_one_that_became_worse_or_another_is_not_accepted(
    limits: dict[str, Any], changed: dict[str, Any], why: str
) -> None:
    entry = suppression(fingerprint="a" * 64, **limits)
    assert fate(entry, finding(profiles=("spec",))) == (Fate.USED, "")
    assert fate(entry, finding(**{"profiles": ("spec",), **changed})) == (Fate.UNUSED, why)


def test_every_place_of_a_finding_must_be_accepted() -> None:
    """A finding that folds several files is hidden by no suppression of one of them."""
    here, there = Location(path="enclaves/talker/cert.pem"), Location(path="enclaves/listener/cert.pem")
    entry = suppression(where=("enclaves/talker/*",))
    assert fate(entry, finding(locations=(here,)))[0] is Fate.USED
    assert fate(entry, finding(locations=(here, there))) == (Fate.UNUSED, "what was found is not, or not only, there")
    beside = Location(path="policy.xml", beside=True)
    assert fate(entry, finding(locations=(here, beside)))[0] is Fate.USED
    assert fate(entry, finding(locations=()))[0] is Fate.UNUSED
    assert fate(entry, finding(locations=(beside,)))[0] is Fate.UNUSED
    cut = tuple(Location(path=f"enclaves/talker/{n}") for n in range(MAX_PLACES))
    assert fate(entry, finding(locations=cut))[0] is Fate.UNUSED, "there may be more places than are listed"


def test_an_enclave_is_no_name_for_what_lies_outside_all_enclaves() -> None:
    """A document that it may present, wherever it comes to lie later."""
    here, shared, old = "enclaves/talker/cert.pem", "public/identity_ca.cert.pem", "old/p.p7s"

    def taken(where: tuple[str, ...], *paths: str) -> bool:
        said = Violation(message="so", locations=tuple(Location(path=path) for path in paths), enclave="/talker")
        (found,) = judge(context(suppressions=(suppression(where=where),)), [made("KA205", said)]).findings
        return found.suppressed is not None

    assert taken(("/talker",), here, shared)
    assert not taken(("/talker",), here, old)
    assert taken(("/talker", "old/*"), here, old)
    assert not taken(("/listener", "old/*"), here, old)
    many = [f"old/{number}" for number in range(MAX_PLACES)]
    assert taken(("/talker", "old/*"), *many)
    assert not taken(("/talker", "old/*"), *many, "other/p.p7s"), "which no finding lists"


def test_a_crash_on_what_is_accepted_is_said() -> None:
    """It leaves the audit incomplete, which is never without a finding."""
    crashing = replace(made("KA910", error=RuntimeError()), on=FileOfUses)
    rules = [*(rule for rule in RULES if rule.code == "KA905"), crashing]
    (found,) = judge(context(suppressions=(suppression(where=("/talker",)),)), rules).findings
    assert (found.code, found.undecided) == ("KA905", True)
    assert "Rule KA910 ended in an error (RuntimeError)" in found.message


def test_dates_too_far_away() -> None:
    check_dates([suppression(until=(AT + 180 * DAY).date())], AT)
    far = suppression(until=(AT + 181 * DAY).date())
    with pytest.raises(UsageError, match=r"^keystore-audit\.toml:3:1: 2027-05-21 is too far .* 2027-05-20 or sooner"):
        check_dates([far], AT)
    check_dates([far], AT, days=181)


# Against a definition of its own


PLACES = st.sampled_from(["enclaves/a/cert.pem", "enclaves/b/cert.pem", "public/ca.pem"])
GLOBS = st.sampled_from(["*", "/a", "/*", "/b*", "enclaves/*", "enclaves/a/*", "*.pem", "public/ca.pem"])
FINDINGS = st.builds(
    lambda mark, **more: finding(mark=mark, **more),
    mark=st.sampled_from("abc"),
    code=st.sampled_from(["KA205", "KA711", "KA901"]),
    enclave=st.sampled_from([None, "/a", "/b"]),
    severity=st.sampled_from(Severity),
    locations=st.lists(PLACES.map(lambda path: Location(path=path)), max_size=2).map(tuple),
    undecided=st.booleans(),
)
ENTRIES = st.builds(
    suppression,
    code=st.sampled_from(["KA205", "KA711", "KA901"]),
    where=st.lists(GLOBS, min_size=1, max_size=2).map(tuple),
    severity=st.none() | st.sampled_from(Severity),
    until=st.integers(-1, 1).map(lambda days: (AT + timedelta(days=days)).date()),
) | st.builds(
    lambda mark, **more: suppression(fingerprint=mark * 64, **more),
    mark=st.sampled_from("abc"),
    code=st.sampled_from(["KA205", "KA711", "KA901"]),
)


def speaks(entry: Suppression, one: Finding) -> bool:
    def like(name: str, *globs: str) -> bool:
        return any(re.fullmatch(re.escape(glob).replace(r"\*", ".*"), name) for glob in globs)

    if entry.code != one.code or one.code[:3] == "KA9" or one.undecided or entry.until < AT.date():
        return False
    if entry.severity and list(Severity).index(one.severity) < list(Severity).index(entry.severity):
        return False
    if entry.fingerprint:
        return entry.fingerprint == one.fingerprint
    if one.code == "KA711":
        return False
    if "*" in entry.where:
        return True
    by_path = one.locations and all(like(place.path, *entry.where) for place in one.locations)
    by_enclave = one.enclave and like(one.enclave, *(glob for glob in entry.where if glob[0] == "/"))
    return bool(by_path or by_enclave)


@settings(max_examples=300, derandomize=True, deadline=None)
@given(st.lists(FINDINGS, max_size=4, unique_by=lambda f: f.fingerprint), st.lists(ENTRIES, max_size=4))
def test_accepted_is_what_some_entry_speaks_of(found: list[Finding], entries: list[Suppression]) -> None:
    files = uses(found, entries, AT, PROFILES)
    for before, after in zip(found, accepted(found, files), strict=True):
        assert (after.suppressed is not None) is any(speaks(entry, before) for entry in entries)
        assert replace(after, suppressed=None) == before
    told = [use for file in files for use in file.uses]
    assert len(told) == len(entries)
    for use in told:
        if use.fate is not Fate.ENDED:
            assert (use.fate is Fate.USED) is any(speaks(use.suppression, one) for one in found)
