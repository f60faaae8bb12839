"""Labels in keystore-audit.toml: what is read, where something is wrong, and what an audit says of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from keystore_audit.errors import UsageError
from keystore_audit.findings import Severity
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from tests.cli.test_flow import SAMPLES, audit
from tests.schemas import schema
from tests.settings.files import plain, read, wrong

LIMITS = '[[label]]\nlabel = "driving"\ntopics = "/motor*"\n[[label]]\nlabel = "entertainment"\ntopics = "/*_limit"\n'
ALIKE = """
[lattice]
order = { a = [], a-to-a = [] }
[[label]]
label = "a"
enclaves = "/a"
[[label]]
label = "a-to-a"
enclaves = "/b"
"""
LEVELS = '[lattice]\nlevels = ["low", "high"]\n'
TWO = '[[label]]\nlabel = "low"\nenclaves = "/a"\n[[label]]\nlabel = "high"\nenclaves = "/b"\n'
VEHICLE = """
[lattice]
preset = "biba"
levels = ["entertainment", "driving"]
severity = "critical"
attacker = "honest"
[[label]]
label = "entertainment"
enclaves = "/infotainment"
[[label]]
label = "driving"
enclaves = "/motor"
"""


FULL = """
single_writer = ["/cmd_vel", "dds:rq/addRequest"]
[lattice]
preset = "biba"
levels = ["low", "middle", "high"]
severity = "low"
attacker = "source"
include_ambient = true
until = 2027-01-01
[[label]]
label = "low"
enclaves = ["/a/*", "/b"]
topics = "/x"
[[label]]
label = "high"
topics = ["dds:ry"]
[[endorser]]
enclaves = "/gate"
from = "low"
to = "high"
[[declassifier]]
enclaves = "/other"
from = "middle"
to = "low"
"""


def test_everything_is_read(tmp_path: Path) -> None:
    settings = read(tmp_path, FULL)
    labels = settings.labels
    assert labels is not None
    assert set(labels.pairs()) == {("low", "middle"), ("low", "high")}
    assert [(one.enclaves, one.topics) for one in labels.labelled] == [(("/a/*", "/b"), ("rt/x",)), ((), ("ry",))]
    assert {(one.enclaves, one.taken, one.given) for one in labels.declassifiers} == {
        (("/gate",), "low", "high"),
        (("/other",), "middle", "low"),
    }
    flows = [claim for claim in settings.claims if claim.kind is ClaimKind.NO_FLOW]
    assert {claim.attacker for claim in flows} == {Attacker.SOURCE}
    assert {(claim.severity, claim.include_ambient) for claim in flows} == {(Severity.LOW, True)}
    assert {frozenset(claim.through) for claim in flows} == {frozenset({"/gate", "/other"})}
    assert all(claim.until is not None and claim.until.year == 2027 for claim in flows)
    assert [claim.id for claim in flows if claim.labels and claim.labels.target == "middle"] == [
        "label-low-to-middle-enclaves-enclaves",
        "label-low-to-middle-topics-enclaves",
    ]
    writers = [claim for claim in settings.claims if claim.kind is ClaimKind.ONLY_PUBLISH]
    assert [claim.id for claim in writers] == ["single-writer-cmd-vel", "single-writer-dds-rq-addrequest"]
    assert [claim.target.topics for claim in writers] == [("rt/cmd_vel",), ("rq/addRequest",)]
    assert [error.message for error in schema("settings").iter_errors(plain(FULL))] == []


def test_categories_and_orders(tmp_path: Path) -> None:
    sets = '[lattice]\ncategories = ["camera", "map"]\n'
    marks = '[[label]]\nlabel = ["map", "camera"]\nenclaves = "/a"\n[[label]]\nlabel = []\nenclaves = "/b"\n'
    labels = read(tmp_path, sets + marks).labels
    assert labels is not None
    assert set(labels.pairs()) == {("camera, map", "no category")}
    assert {claim.labels.id for claim in labels.claims() if claim.labels} == {"label-camera-and-map-to-no-category"}
    assert schema("settings").is_valid(plain(sets + marks))
    order = '[lattice]\norder = { low = [], high = ["low"], apart = [] }\n'
    labels = read(tmp_path, order + TWO + '[[label]]\nlabel = "apart"\ntopics = "/x"\n').labels
    assert labels is not None
    assert set(labels.pairs()) == {
        ("high", "low"), ("low", "apart"), ("apart", "low"), ("high", "apart"), ("apart", "high")
    }  # fmt: skip
    assert schema("settings").is_valid(plain(order + TWO))


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        (TWO, ":1", "expected a [lattice] beside label"),
        (LEVELS, ":1", "expected two labels in use at least, found 0"),
        (f"[lattice]\n{TWO}", ":1", "expected exactly one of levels, categories, order, found 0"),
        (f'{LEVELS}categories = ["a"]\n{TWO}', ":1", "found 2"),
        (f"[lattice]\nlevel = []\n{TWO}", ":2", "did you mean 'levels'"),
        (f'[lattice]\nlevels = ["a", "a"]\n{TWO}', ":2", "'a' stands here twice"),
        (f'[lattice]\nlevels = ["a b"]\n{TWO}', ":2", "expected letters a to z, digits and hyphens"),
        (f'{LEVELS}preset = "biva"\n{TWO}', ":3", "'biva'; expected bell-lapadula, biba"),
        (f"{LEVELS}{TWO}[[label]]\nlabel = 'hihg'\nenclaves = '/c'\n", ":10", "expected low, high"),
        (f"{LEVELS}{TWO}[[label]]\nlabel = 'high'\n", ":9", "expected enclaves or topics"),
        (f"{LEVELS}{TWO}[[label]]\nlabel = 'high'\nenclaves = 'c'\n", ":11", "expected an enclave's path"),
        (f"{LEVELS}{TWO}[[declassifier]]\nenclaves = '/c'\nfrom = 'high'\n", ":9", "missing key `to`"),
        (f"{LEVELS}{TWO}[[endorser]]\nenclave = '/c'\n", ":10", "unknown key 'enclave'"),
        (
            f'[lattice.order]\nlow = ["high"]\nhigh = ["middle"]\nmiddle = ["low"]\n{TWO}',
            ":2",
            "'low' below 'middle' below 'high' below 'low': expected an order without cycles",
        ),
        (f'[lattice]\norder = {{ low = [], high = ["middle"] }}\n{TWO}', ":2", "'middle' is no label of this order"),
        ('[lattice]\ncategories = ["a"]\n[[label]]\nlabel = "b"\nenclaves = "/a"\n', ":4", "'b' is no category"),
        ('single_writer = "/cmd_*"\n', ":1", "has wildcards"),
        ('single_writer = "cmd"\n', ":1", 'expected a topic as "/cmd_vel"'),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, where: str, what: str) -> None:
    said = wrong(tmp_path, text)
    assert said.startswith(f"{where}: ")
    assert what in said


@pytest.mark.parametrize("text", [TWO, f'{LEVELS}categories = ["a"]\n{TWO}', '[[endorser]]\nenclaves = "/a"\n'])
def test_the_schema_refuses_it_too(text: str) -> None:
    assert not schema("settings").is_valid(plain(text))


def test_a_property_may_not_have_the_name_of_what_labels_make(tmp_path: Path) -> None:
    mine = '[[property]]\nname = "single-writer-x"\nable = { from = "/a", to = "/b" }\n'
    with pytest.raises(UsageError, match=r"toml:1: this makes the property 'single-writer-x', which is at .*:2 too"):
        read(tmp_path, f'single_writer = "/x"\n{mine}')


@pytest.mark.parametrize(
    ("text", "name"),
    [
        (
            f'{LEVELS}{TWO}[[property]]\nname = "label-high-to-low"\nable = {{ from = "/a", to = "/b" }}\n',
            "label-high-to-low",
        ),
        (ALIKE, "label-a-to-a-to-a"),
    ],
)
def test_names_that_labels_make_are_nobody_elses(tmp_path: Path, text: str, name: str) -> None:
    with pytest.raises(UsageError, match=f"this makes the property '{name}"):
        read(tmp_path, text)


def judged(tmp_path: Path, sample: str, text: str, *arguments: str) -> tuple[int, dict[str, Any]]:
    (tmp_path / "s.toml").write_text(text, "utf-8")
    return audit(str(SAMPLES / "flows" / sample), "--settings", "s.toml", *arguments, at=tmp_path)


@pytest.mark.parametrize(
    ("sample", "status"),
    [("vehicle_healthy", "holds"), ("vehicle_plain_grant", "violated"), ("vehicle_compromised_relay", "holds")],
)
def test_labels_are_judged_hop_by_hop(tmp_path: Path, sample: str, status: str) -> None:
    code, report = judged(tmp_path, sample, VEHICLE)
    found = {each["id"]: each["status"] for each in report["properties"]}
    assert found["label-entertainment-to-driving"] == status
    told = [each for each in report["findings"] if each["code"] == "KA742"]
    assert len(told) == (status == "violated")
    assert code == (status == "violated")
    for each in told:
        assert each["severity"] == "critical"
        assert "/infotainment -> /media_state (domain 0) -> /gateway -> /motor_limit" in each["message"]
        assert {place["path"] for place in each["locations"][1:]} == {
            f"enclaves/{name}/permissions.p7s" for name in ("infotainment", "gateway", "motor")
        }


def test_whoever_attacks_on_the_way_counts_unless_trusted(tmp_path: Path) -> None:
    everybody = VEHICLE.replace('"honest"', '"relays"')
    assert judged(tmp_path, "vehicle_compromised_relay", everybody)[0] == 1
    trusted = '[[endorser]]\nenclaves = "/gateway"\nfrom = "entertainment"\nto = "driving"\n'
    code, report = judged(tmp_path, "vehicle_compromised_relay", everybody + trusted)
    assert (code, [each for each in report["findings"] if each["code"] == "KA742"]) == (0, [])


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            '[[label]]\nlabel = "driving"\nenclaves = "/info*"\n',
            "s.toml:15: the enclave '/infotainment' is labelled 'driv",
        ),
        (
            '[[endorser]]\nenclaves = "/mot*"\nfrom = "entertainment"\nto = "driving"\n',
            "is labelled 'entertainment turned",
        ),
        (
            LIMITS,
            "s.toml:18: the DDS topic 'rt/motor_limit' is labelled 'entertainment' here, and 'driving' at s.toml:15",
        ),
        ('[[label]]\nlabel = "driving"\nenclaves = "/mtr"\n', "s.toml:15: '/mtr' names no enclave of this keystore"),
        ('[[label]]\nlabel = "driving"\ntopics = "/mtr"\n', "s.toml:15: no permissions document grants anything on"),
    ],
)
def test_overlaps_and_labels_of_nothing_are_wrong_usage(tmp_path: Path, more: str, said: str) -> None:
    code, report = judged(tmp_path, "vehicle_healthy", VEHICLE + more)
    assert code == 2
    assert said in " ".join(report["stderr"].split())


def test_topics_overlap_in_names_that_nobody_uses(tmp_path: Path) -> None:
    more = '[[label]]\nlabel = "driving"\ntopics = "/m*"\n[[label]]\nlabel = "entertainment"\ntopics = "/*a_state"\n'
    code, report = judged(tmp_path, "vehicle_healthy", VEHICLE + more)
    assert code == 2
    assert "expected one label for each" in " ".join(report["stderr"].split())


@pytest.mark.parametrize("doubt", ["unreadable", "ambiguous", "linked_away"])
def test_what_cannot_be_read_leaves_labels_open(tmp_path: Path, doubt: str) -> None:
    text = VEHICLE.replace("/infotainment", "/listener").replace("/motor", "/talker")
    code, report = judged(tmp_path, f"chatter_{doubt}_enclave", text)
    found = {each["id"]: each["status"] for each in report["properties"]}
    assert (code, found["label-entertainment-to-driving"]) == (4, "unknown")


def test_single_writers(tmp_path: Path) -> None:
    code, report = judged(tmp_path, "vehicle_healthy", 'single_writer = ["/media_state", "/motor_limit"]\n')
    found = {each["id"]: each["status"] for each in report["properties"]}
    assert (code, found["single-writer-media-state"], found["single-writer-motor-limit"]) == (0, "holds", "holds")
    code, report = judged(tmp_path, "vehicle_plain_grant", 'single_writer = ["/media_state", "/motor_limit"]\n')
    (told,) = (each for each in report["findings"] if each["code"] == "KA740")
    assert (code, told["locations"][0]["line"]) == (1, 1)
    assert "'single-writer-motor-limit' is violated: /gateway may publish" in told["message"]
    assert "The settings demand: No more than one enclave may publish /motor_limit." in told["message"]
    assert "These could pose as a permitted publisher: /motor, with the keys they hold" in told["message"]


def test_a_single_writer_beside_an_enclave_that_cannot_be_read(tmp_path: Path) -> None:
    code, report = judged(tmp_path, "chatter_linked_away_enclave", 'single_writer = "/chatter"\n')
    found = {each["id"]: each["status"] for each in report["properties"]}
    assert (code, found["single-writer-chatter"]) == (4, "unknown")
