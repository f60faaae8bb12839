"""Fleets in which some enclaves run another implementation than all others, `[enclaves."/arm"]`."""

from __future__ import annotations

import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.assumptions import Assumption
from keystore_audit.errors import UsageError
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.profiles import VARIANTS, fleets, in_scope, resolve
from keystore_audit.properties.result import EngineStatus
from keystore_audit.settings.settings import Settings, read_settings
from tests.amount import tried
from tests.engine.test_horizon_exactly import PROFILES
from tests.keystore.documents import allow, domain_rule, governance, grant, permissions, pub, sub, topic_rule
from tests.model.comparing import AT, Member, Store, authority
from tests.model.test_trust_domains_alike import CLAIMS, PATHS, keystore, told

ONE_CA = "no-enclave-grants-itself-rights"


def settings(place: Path, runs: Mapping[str, str], text: str = CLAIMS) -> Settings:
    """The text, and what enclaves run, by `profile`."""
    tables = "".join(f'[enclaves."{path}"]\nprofile = "{profile}"\n' for path, profile in runs.items())
    place.write_text(text + tables)
    return read_settings(place, ())


def answers(root: Path, settings: Settings, profile: str) -> object:
    """Of the one profile: what holds, and who starts; nothing where a claim is about what nobody grants."""
    try:
        report = told(root, settings, (profile,))
    except UsageError:
        return None
    stated = [(each["id"], next(iter(each["profiles"].values()))["status"]) for each in report["properties"]]
    return stated, [(each["path"], [*each["profiles"].values()]) for each in report["enclaves"]]


def status(report: Mapping[str, Any], name: str) -> str:
    [found] = [each["status"] for each in report["properties"] if each["id"] == name]
    return str(found)


@pytest.mark.parametrize("start", range(0, tried(100, 20), 20))
def test_a_fleet_of_which_every_enclave_is_said_to_run_one_is_that_fleet(start: int, tmp_path: Path) -> None:
    """Whatever the profile of the others is, who are none; of random keystores, every property and who starts."""
    for seed in range(start, start + 20):
        chance = random.Random(seed)
        root = keystore(chance, tmp_path / str(seed))
        here = [path for path in PATHS if (root / f"enclaves{path}").is_dir()]
        profile, other = chance.sample(PROFILES, 2)
        uniform = answers(root, settings(tmp_path / "uniform.toml", {}), other)
        every = answers(root, settings(tmp_path / "mixed.toml", dict.fromkeys(here, other)), profile)
        assert every == uniform, seed


def test_what_one_fleet_has_over_another_is_what_its_enclaves_run(tmp_path: Path) -> None:
    """Of random assignments: some answers are those of neither uniform fleet, or of one and not the other."""
    differing = 0
    for seed in range(tried(100, 20)):
        chance = random.Random(seed)
        root = keystore(chance, tmp_path / str(seed))
        here = [path for path in PATHS if (root / f"enclaves{path}").is_dir()]
        profile, other = chance.sample(PROFILES, 2)
        plain = settings(tmp_path / "uniform.toml", {})
        mixed = settings(tmp_path / "mixed.toml", {here[0]: other})
        differing += answers(root, mixed, profile) != answers(root, plain, profile)
    assert differing >= tried(100, 20) / 10


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_both_engines_answer_alike_about_random_mixed_fleets(tmp_path: Path) -> None:
    for seed in range(tried(10)):
        chance = random.Random(f"both {seed}")
        root = keystore(chance, tmp_path / str(seed))
        here = [path for path in PATHS if (root / f"enclaves{path}").is_dir()]
        profile, other, third = chance.sample(PROFILES, 3)
        mixed = settings(tmp_path / "mixed.toml", {here[0]: other, here[-1]: third})
        report = audit(root, Options(at=AT, profiles=(profile,), settings=mixed, engine="auto"))
        assert report.engines_agree, seed
        assert {run.status for run in report.engines} == {EngineStatus.OK}


def test_what_is_accepted_of_one_fleet_is_not_of_another(tmp_path: Path) -> None:
    """The meaning of a finding about rights has the fleet in it."""
    root = SHARED.write(tmp_path / "keys")
    meanings = set()
    for runs in ({"/arm": "cyclonedds-0.10"}, {"/talker": "cyclonedds-0.10"}, {"/arm": "fastdds-2.9"}):
        report = told(root, settings(tmp_path / "it.toml", runs, ""), ("fastdds-2.6",))
        [found] = [each for each in report["findings"] if each["code"] == "KA705"]
        meanings.add(found["meaning"])
    assert len(meanings) == 3


SHARED = Store(
    members={
        "/arm": Member(permissions=permissions(grant("/arm", allow(sub("rt/chatter"))))),
        "/talker": Member(permissions=permissions(grant("/talker", allow(pub("rt/[^x]hatter")))), serial=101),
    },
    identity=(authority("identityCA"),),
    permissions=(authority("identityCA"),),
)
"""One CA for both roles; and the talker may publish /chatter where `[^x]` is anything but x."""

FLOW = """
[[property]]
name = "kept"
no_flow = { from = "/talker", to = "/arm", attacker = "honest" }
"""

INSIDER = 'encrypted = { topic = "/chatter", against = "insider" }'


@pytest.mark.parametrize(
    ("runs", "forged", "kept"),
    [
        ({}, "holds", "violated"),
        ({"/arm": "cyclonedds-0.10"}, "violated", "holds"),
        ({"/talker": "cyclonedds-0.10"}, "violated", "holds"),
        ({"/talker": "fastdds-3.6"}, "holds", "violated"),
        ({"/arm": "cyclonedds-11"}, "holds", "holds"),
    ],
)
def test_a_receiver_judges_by_its_own_implementation(
    runs: Mapping[str, str], forged: str, kept: str, tmp_path: Path
) -> None:
    """Who is open to permissions that an enclave signs for itself; and whose expressions match: the writer's too."""
    root = SHARED.write(tmp_path / "keys")
    report = told(root, settings(tmp_path / "it.toml", runs, FLOW), ("fastdds-2.6",))
    assert (status(report, ONE_CA), status(report, "kept")) == (forged, kept)
    on = [line for line in (report["scope"] or "").split("; ")[1:] if runs]
    assert len(on) == (1 if runs else 0)
    for path, profile in runs.items():
        assert on == [f"{path} on {VARIANTS[profile].title}, declared"]
        assert any(report["scope"] in each for each in report["stated"])


@pytest.mark.parametrize(
    ("runs", "rule", "kept"),
    [
        ({"/arm": "cyclonedds-0.10"}, "", "holds"),
        ({"/arm": "cyclonedds-0.10"}, allow(pub("rt/chatter")), "violated"),
        ({"/arm": "cyclonedds-0.10", "/talker": "cyclonedds-0.10"}, "", "violated"),
    ],
)
def test_nobody_writes_by_a_default_of_which_its_own_implementation_makes_nothing(
    runs: Mapping[str, str], rule: str, kept: str, tmp_path: Path
) -> None:
    """Fast DDS always denies by default (measured): no honest talker sends what the arm would take."""
    sends = Member(permissions=permissions(grant("/talker", *filter(None, (rule,)), default="ALLOW")))
    root = SHARED.member("/talker", permissions=sends.permissions).write(tmp_path / "keys")
    report = told(root, settings(tmp_path / "it.toml", runs, FLOW), ("fastdds-2.6",))
    assert status(report, "kept") == kept


@pytest.mark.parametrize(
    ("runs", "lacking", "why"),
    [
        ({"/arm": "cyclonedds-11"}, (), "implementations that read the keystore differently"),
        ({}, (), None),
        ({}, (Assumption.ROBOTS_ENFORCE,), "it depends on assumptions that were not made, robots-enforce:"),
    ],
)
def test_what_is_undecided_is_told_with_its_reason(
    runs: Mapping[str, str], lacking: tuple[Assumption, ...], why: str | None, tmp_path: Path
) -> None:
    """And not that no engine gave an answer; where it is asserted, and what would decide it."""
    claim = '[[property]]\nname = "kept"\nable = { from = "/talker", to = "/arm" }\n'
    plain = SHARED.member("/talker", permissions=permissions(grant("/talker", allow(pub("rt/chatter")))))
    root, given = plain.write(tmp_path / "keys"), settings(tmp_path / "it.toml", runs, claim)
    options = Options(at=AT, engine="native", profiles=("fastdds-3.6",), settings=given, not_assumed=lacking)
    found = [each for each in audit(root, options).findings if each.code == "KA906"]
    assert found if why else not found
    assert all(why and why in each.message for each in found)
    if runs:
        (each,) = found
        assert each.locations[0].path.endswith("it.toml")
        assert "[enclaves]" in each.fix.steps[0].text


@pytest.mark.parametrize(
    ("signer", "runs", "claim"),
    [
        ("identityCA", {"/arm": "cyclonedds-0.10"}, 'no_flow = { from = "topic:/chatter", to = "/third" }'),
        ("permissionsCA", {"/arm": "cyclonedds-0.10"}, 'no_flow = { from = "topic:/chatter", to = "/third" }'),
        ("identityCA", dict.fromkeys(("/arm", "/talker", "/third"), "cyclonedds-0.10"), INSIDER),
    ],
)
def test_who_signs_itself_permissions_is_told_so(
    signer: str, runs: Mapping[str, str], claim: str, tmp_path: Path
) -> None:
    """Where others judge than those of its own implementation; and where its keys come with what it signs."""
    third = Member(permissions=permissions(grant("/third", allow(pub("rt/other")))), serial=102)
    store = replace(SHARED, members={**SHARED.members, "/third": third}, permissions=(authority(signer),))
    store = replace(store, governance=governance(domain_rule(topic_rule(data="NONE"))))
    text = f'[[property]]\nname = "kept"\n{claim}\n'
    report = told(store.write(tmp_path / "keys"), settings(tmp_path / "it.toml", runs, text), ("fastdds-2.6",))
    [found] = [each["profiles"]["fastdds-2.6"] for each in report["properties"] if each["id"] == "kept"]
    assert found["status"] == ("violated" if signer == "identityCA" else "holds")
    if signer == "identityCA":
        assert ": it can sign its own permissions, and its peers accept them" in found["counterexample"]["text"]


@pytest.mark.parametrize(
    ("scope", "rmw", "expected"),
    [
        (("fastdds-2.6",), "cyclonedds", {"fastdds-2.6": "cyclonedds-0.10"}),
        (("fastdds-3.6",), "cyclonedds", {"fastdds-3.6": "cyclonedds-11"}),
        (("fastdds-2.6", "cyclonedds-0.10"), "fastdds", {"fastdds-2.6": None, "cyclonedds-0.10": "fastdds-2.6"}),
        (("cyclonedds-0.10",), "fastdds", None),
        (("spec",), "cyclonedds", None),
        (("spec", "fastdds-2.6"), "cyclonedds", {"spec": None, "fastdds-2.6": "cyclonedds-0.10"}),
    ],
)
def test_an_alias_stands_for_what_is_shipped_with_the_others(
    scope: tuple[str, ...], rmw: str, expected: Mapping[str, str | None] | None
) -> None:
    """What that leaves open is refused."""
    runs = {"/arm": in_scope((), (rmw,), ())}
    if expected is None:
        with pytest.raises(UsageError, match=r"/arm may run .* or "):
            fleets(resolve(scope), runs)
    else:
        found = {each.name: dict(each.others).get("/arm") for each in fleets(resolve(scope), runs)}
        assert {name: other and other.name for name, other in found.items()} == dict(expected)


def test_an_enclave_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    root = SHARED.write(tmp_path / "keys")
    with pytest.raises(UsageError, match=r"it\.toml:1: '/amr' is no enclave of this keystore\. Did you mean /arm\?"):
        told(root, settings(tmp_path / "it.toml", {"/amr": "cyclonedds-0.10"}, ""), ("fastdds-2.6",))
