"""What a node got at one moment it may keep and pass on at a later one, until the end of a claim."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest

from keystore_audit import audit
from keystore_audit.properties.result import AssertedResult
from tests.keystore.documents import criterion, grant, permissions, rule
from tests.model.comparing import Member, Store

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
EARLY = {"end": "2026-12-24T00:00:00"}
LATE = {"start": "2027-01-06T00:00:00", "end": "2027-01-20T00:00:00"}
LAST = {"start": "2027-02-01T00:00:00"}
Dates = dict[str, str]


def sub(topic: str) -> str:
    return rule(criterion("subscribe", topic))


def pub(topic: str) -> str:
    return rule(criterion("publish", topic))


def chain(*dates: tuple[Dates, Dates]) -> Store:
    """From /n0 to /n1 and on, over /t0, /t1 and so on: between two of these, when one reads, and when it writes."""
    members = {"/n0": permissions(grant("/n0", pub("rt/t0")))}
    for number, (reading, writing) in enumerate(dates, 1):
        own = grant(f"/n{number}", sub(f"rt/t{number - 1}"), **reading)
        members[f"/n{number}"] = permissions(own, grant(f"/n{number}", pub(f"rt/t{number}"), **writing))
    last = f"/n{len(dates) + 1}"
    members[last] = permissions(grant(last, sub(f"rt/t{len(dates)}")))
    return Store(members={path: Member(permissions=text) for path, text in members.items()})


def asked(store: Store, root: Path, claim: str, until: str = "2027-06-30", profile: str = "spec") -> AssertedResult:
    settings = root / "settings.toml"
    settings.write_text(f'[[property]]\nname = "apart"\nuntil = {until}\nno_flow = {{ {claim} }}\n')
    report = audit(
        store.write(root / "k"), at=AT, time_zone="UTC", engine="native", profiles=[profile], settings=settings
    )
    [result] = (each for each in report.properties if each.prop.id == "apart")
    assert isinstance(result, AssertedResult)
    return result


def status(result: AssertedResult) -> str:
    [found] = result.profiles.values()
    assert set(found.engines.values()) == {found.status}
    return found.status.value


@pytest.mark.parametrize("attacker", ["honest", "source"])
@pytest.mark.parametrize("ends", ['from = "/n0", to = "/n2"', 'from = "topic:/t0", to = "topic:/t1"'])
@pytest.mark.parametrize(("reads", "writes", "expected"), [(EARLY, LATE, "violated"), (LATE, EARLY, "holds")])
def test_what_was_kept_goes_on(
    reads: Dates, writes: Dates, expected: str, ends: str, attacker: str, tmp_path: Path
) -> None:
    """At no instant the one in the middle may read and write, but it has only to wait."""
    result = asked(chain((reads, writes)), tmp_path, f'{ends}, attacker = "{attacker}"')
    assert status(result) == expected
    [found] = result.profiles.values()
    told = found.counterexample.text if found.counterexample is not None else ""
    assert ("of what was kept" in told) is (expected == "violated")
    assert any(": kept: " in each for each in result.breaches or ()) is (expected == "violated")


@pytest.mark.parametrize(
    ("more", "until"), [(', through = ["/n1"]', "2027-06-30"), ("", "2027-01-05"), ("", "2026-11-20")]
)
def test_who_may_pass_it_on_and_until_when(more: str, until: str, tmp_path: Path) -> None:
    claim = 'from = "/n0", to = "/n2", attacker = "honest"'
    assert status(asked(chain((EARLY, LATE)), tmp_path, claim + more, until)) == "holds"


@pytest.mark.parametrize(
    ("second", "expected"), [((LATE, LAST), "violated"), ((LAST, LATE), "holds"), ((EARLY, LAST), "holds")]
)
def test_it_is_told_moment_by_moment(second: tuple[Dates, Dates], expected: str, tmp_path: Path) -> None:
    claim = 'from = "/n0", to = "/n3", attacker = "honest"'
    result = asked(chain((EARLY, LATE), second), tmp_path, claim)
    assert status(result) == expected
    [found] = result.profiles.values()
    if found.counterexample is not None:
        first, *others = found.counterexample.text.split("; later, of what was kept, ")
        assert first == "/n0 -> /t0 (domain 0) -> /n1 now"
        assert [each.split(" ")[0] for each in others] == ["/n1", "/n2"]
        assert others[-1].endswith("from 2027-02-01T00:00:00Z on (no attack is needed).")
        lines = {step.path for step in found.counterexample.steps}
        assert lines == {f"enclaves/n{number}/permissions.p7s" for number in range(4)}
