"""What nodes forward, in settings: what is read, where something is wrong, and what an audit makes of it."""

from __future__ import annotations

import shutil
from datetime import datetime, timezone
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.assumptions import Assumption
from keystore_audit.engine.alloy.user_file import read_user_files
from keystore_audit.errors import UsageError
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule
from tests.model.comparing import Member, Store
from tests.settings.files import read, wrong
from tools.samples.base import IDENTITY_CA, LISTENER, TALKER, TWO
from tools.samples.certificates import Certificate
from tools.samples.documents import DISCOVERY, Criterion, Grant, Permissions, Rule
from tools.samples.keys import Key
from tools.samples.store import write

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
TURTLESIM, JOYSTICK = SAMPLES / "flows/turtlesim_healthy", SAMPLES / "flows/turtlesim_joystick"

FORWARD = """\
[[forward]]
enclave = "/multiplexer"
from = ["/high_priority", "/low_priority"]
to = "/move_turtle"
scheduler = "priority"
"""
MOVED = '[[property]]\nname = "moved"\ndeterministic = { low = "/move_turtle" }\n'


def asked(low: str, high: str = "") -> str:
    besides = f', high = "{high}"' if high else ""
    return f'[[property]]\nname = "moved"\ndeterministic = {{ low = "{low}"{besides} }}\n'


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        (FORWARD.replace("scheduler =", "schedule ="), ":5", "unknown key 'schedule'"),
        (FORWARD.replace('scheduler = "priority"', ""), ":1", "missing key `scheduler`"),
        (FORWARD.replace('"priority"', '"fifo"'), ":5", "expected any, priority"),
        (FORWARD.replace('"/multiplexer"', '"multiplexer"'), ":2", "path of one enclave"),
        (FORWARD.replace('"/multiplexer"', '"/multi*"'), ":2", "path of one enclave"),
        (FORWARD.replace('to = "/move_turtle"', ""), ":1", "missing key `to`"),
        (FORWARD.replace('"/move_turtle"', '"/move_*"'), ":4", "without a pattern"),
        (FORWARD.replace('"/low_priority"', '"/high_priority"'), ":3", "stands here twice"),
        (FORWARD.replace('"/low_priority"', '"low"'), ":3", 'expected a topic as "/cmd_vel"'),
        (FORWARD.replace('"/move_turtle"', str([f"/t{n}" for n in range(9)])), ":4", "at most 8 topics, found 9"),
        (MOVED.replace("low =", "lo ="), ":3", "unknown key 'lo'"),
        (MOVED, ":3", "no [[forward]] leads to it"),
        (FORWARD + MOVED.replace("det", "until = 2027-01-01\ndet"), ":8", "expected no until"),
        (FORWARD + asked("/move_turtle", "outsider"), ":8", "expected enclaves or topics"),
        (FORWARD + asked("/move_turtle", "topic:/low_*"), ":8", "without a pattern"),
        (FORWARD + asked("/move_*"), ":8", "without a pattern"),
        (FORWARD + MOVED + MOVED, ":10", "there is a property 'moved' already"),
        ("forward = 1\n", ":1", "Expected `array`, got `int`"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, where: str, what: str) -> None:
    said = wrong(tmp_path, text)
    assert said.startswith(f"{where}: ")
    assert what in said


def report(tmp_path: Path, keystore: Path, text: str, *profiles: str, not_assumed: tuple[str, ...] = ()) -> Report:
    options = Options(
        at=datetime(2026, 11, 21, 12, tzinfo=timezone.utc),
        engine="native",
        profiles=profiles or ("fastdds",),
        settings=read(tmp_path, text),
        not_assumed=frozenset(map(Assumption, not_assumed)),
    )
    return audit(keystore, options)


def status(found: Report) -> str:
    return next(each.status.value for each in found.properties if each.prop.id == "moved")


def message(found: Report, code: str) -> str:
    return next(each.message for each in found.findings if each.code == code)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (FORWARD + MOVED, "holds"),
        (FORWARD.replace('priority"\n', 'any"\n') + MOVED, "violated"),
        (FORWARD + asked("/move_turtle", "/random"), "violated"),
        (FORWARD + asked("/move_turtle", "topic:/low_priority"), "violated"),
        (FORWARD + asked("/move_turtle", "/turtlesim"), "holds"),
        (FORWARD.replace(', "/low_priority"', "") + asked("/move_turtle", "/random"), "holds"),
        (FORWARD.replace(', "/low_priority"', "") + asked("/move_turtle", "/keyboard"), "violated"),
        (asked("/high_priority", "/random"), "holds"),
        (asked("/low_priority", "/random"), "violated"),
    ],
)
def test_the_turtlesim_is_decided(tmp_path: Path, text: str, expected: str) -> None:
    found = report(tmp_path, TURTLESIM, text)
    assert status(found) == expected
    assert found.exit_code == {"holds": 0, "violated": 1}[expected]


@pytest.mark.parametrize(
    ("text", "rounds", "freely"),
    [(FORWARD + MOVED, True, "unknown"), (asked("/high_priority", "/random"), False, "holds")],
)
def test_rounds_are_needed_where_a_forward_is_seen(tmp_path: Path, text: str, rounds: bool, freely: str) -> None:
    needs = next(each.needs for each in report(tmp_path, TURTLESIM, text).properties if each.prop.id == "moved")
    assert (Assumption.LOCKSTEP_ROUNDS in needs) == rounds
    found = report(tmp_path, TURTLESIM, text, not_assumed=("lockstep-rounds",))
    assert status(found) == freely


def test_an_id_is_given_once(tmp_path: Path) -> None:
    labels = '[lattice]\nlevels = ["low", "high"]\n'
    labels += '[[label]]\nlabel = "low"\nenclaves = "/a"\n[[label]]\nlabel = "high"\nenclaves = "/b"\n'
    (made,) = read(tmp_path, labels).claims
    with pytest.raises(UsageError, match=f"this makes the property '{made.id}'"):
        read(tmp_path, FORWARD + MOVED.replace("moved", made.id) + labels)
    file = tmp_path / "own.als"
    file.write_text("module own\nopen keystore_audit\ncheck moved { some none } for 0\n")
    settings = read(tmp_path, FORWARD + MOVED.replace("moved", "own-moved"))
    with pytest.raises(UsageError, match="'own-moved', is taken at"):
        read_user_files((file,), settings.asserted)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (FORWARD + asked("/move_turtle", "/joystick"), "/keyboard, and no [[forward]] says what happens there"),
        (asked("/high_priority", "/joystick"), "/keyboard, and no [[forward]] says what happens there"),
        (
            FORWARD.replace('"/move_turtle"', '"/high_priority"') + asked("/high_priority"),
            "/multiplexer may not publish rt/high_priority",
        ),
        (
            FORWARD.replace('"/low_priority"', '"/joystick"') + asked("/move_turtle"),
            "/multiplexer may not subscribe to rt/joystick",
        ),
    ],
)
def test_what_is_not_declared_or_not_possible_is_unknown(tmp_path: Path, text: str, why: str) -> None:
    found = report(tmp_path, JOYSTICK, text)
    assert (status(found), found.exit_code) == ("unknown", 4)
    assert why in message(found, "KA906")
    finding = next(each for each in found.findings if each.code == "KA906")
    assert finding.locations[0].message == "asserted here"


def test_a_node_that_is_declared_passes_nothing_else_on(tmp_path: Path) -> None:
    keyboard = '[[forward]]\nenclave = "/keyboard"\nfrom = "/joystick"\nto = "/high_priority"\nscheduler = "any"\n'
    one_way = FORWARD.replace('"/high_priority", ', "")
    assert status(report(tmp_path, JOYSTICK, FORWARD + keyboard + asked("/move_turtle", "/joystick"))) == "violated"
    assert status(report(tmp_path, JOYSTICK, one_way + keyboard + asked("/move_turtle", "/joystick"))) == "holds"
    assert status(report(tmp_path, JOYSTICK, FORWARD + keyboard + MOVED)) == "holds"


def test_what_could_not_be_read_leaves_it_unknown(tmp_path: Path) -> None:
    keystore = tmp_path / "keys"
    shutil.copytree(TURTLESIM, keystore, symlinks=True)
    file = keystore / "enclaves/random/permissions.p7s"
    file.write_bytes(file.read_bytes()[:-300])
    found = report(tmp_path, keystore, FORWARD + MOVED)
    assert (status(found), found.exit_code) == ("unknown", 4)
    assert "it depends on what could not be read" in message(found, "KA906")


def test_who_could_sign_itself_rights_races_with_nobody(tmp_path: Path) -> None:
    """One authority under Cyclone DDS 0.10: to sign rights for oneself is an attack, and nobody attacks here."""
    shared, split = SAMPLES / "flows/turtlesim_shared_ca", SAMPLES / "flows/turtlesim_split_cas"
    assert status(report(tmp_path, shared, FORWARD + MOVED, "cyclonedds-0.10")) == "holds"
    assert status(report(tmp_path, split, FORWARD + MOVED, "cyclonedds-0.10")) == "holds"
    assert status(report(tmp_path, shared, FORWARD + MOVED, "fastdds-3.6")) == "holds"


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (FORWARD.replace("/multiplexer", "/multi") + MOVED, "'/multi' is no enclave of this keystore"),
        (FORWARD.replace("/low_priority", "/low") + MOVED, "on the DDS topic 'rt/low'"),
        (FORWARD + asked("/move_turtle", "/randm"), "'/randm' names no enclave"),
        (FORWARD + asked("/move_turtle", "topic:/nothing"), "on the DDS topic 'rt/nothing'"),
        (FORWARD + asked("/move_turtle", "/multi*"), "is high, but"),
    ],
)
def test_what_is_not_in_the_keystore_is_a_mistake(tmp_path: Path, text: str, what: str) -> None:
    with pytest.raises(UsageError) as caught:
        report(tmp_path, TURTLESIM, text)
    assert what in caught.value.message


@pytest.mark.parametrize(("partition", "expected"), [("q", "holds"), ("*", "violated"), ("", "violated")])
def test_inputs_count_that_can_be_in_the_partition_of_the_forwards(
    tmp_path: Path, partition: str, expected: str
) -> None:
    """The listener is high: in a partition of its own it gets nothing to the talker, in `*` it does."""
    said = Criterion(topics=("rt/map",), partitions=(partition,) if partition else ())
    heard = Rule(subscribe=("rt/map", "rt/low"), publish=("rt/out",))
    rules = {"/talker": heard, "/listener": Rule(publish=(said,)), "/other": Rule(publish=("rt/low",))}
    other = Certificate(key=Key(label="rules /other"), subject="/other", issuer=IDENTITY_CA)
    enclaves = (TALKER, LISTENER, replace(LISTENER, path="/other", certificate=other))
    given = (
        replace(each, permissions=Permissions(grants=(Grant(path=each.path, rules=(rules[each.path], DISCOVERY)),)))
        for each in enclaves
    )
    write(replace(TWO, enclaves=tuple(given)).tree(), tmp_path / "keys")
    forward = '[[forward]]\nenclave = "/talker"\nfrom = ["/map", "/low"]\nto = "/out"\nscheduler = "priority"\n'
    found = report(tmp_path, tmp_path / "keys", forward + asked("/out", "/listener"), "cyclonedds-11")
    assert status(found) == expected


def test_a_domain_in_which_one_forward_is_impossible_is_looked_at_all_the_same(tmp_path: Path) -> None:
    """In domain 9 two publish what the first forward passes on; the second one is in domain 0 alone."""

    def allowed(name: str, *rules: str) -> Member:
        return Member(permissions=permissions(grant(name, *rules)))

    everywhere = "<id>0</id><id>9</id>"
    passing = rule(criterion("publish", "rt/mv"), criterion("subscribe", "rt/hi"), domains=everywhere)
    on = rule(criterion("publish", "rt/out"), criterion("subscribe", "rt/mv"))
    hi = criterion("publish", "rt/hi")
    store = Store(
        members={
            "/m": allowed("/m", passing),
            "/m2": allowed("/m2", on),
            "/k": allowed("/k", rule(hi, domains=everywhere)),
            "/r": allowed("/r", rule(hi, domains="<id>9</id>")),
        },
        governance=governance(domain_rule(domains=everywhere)),
    )
    form = '[[forward]]\nenclave = "{}"\nfrom = ["{}"]\nto = "{}"\nscheduler = "priority"\n'
    both = asked(low="/mv").replace('"/mv"', '["/mv", "/out"]')
    text = form.format("/m", "/hi", "/mv") + form.format("/m2", "/mv", "/out") + both
    keystore = store.write(tmp_path / "keys")
    assert status(report(tmp_path, keystore, text, "fastdds")) == "violated"
    alone = replace(store, members={**store.members, "/r": allowed("/r", rule(criterion("publish", "rt/z")))})
    assert status(report(tmp_path, alone.write(tmp_path / "alone"), text, "fastdds")) == "holds"
