"""Every rule of KA8 on real sessions: what its finding warns of comes about with the bad files, and not with the good.

What is meant comes through with the good files all the same.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
import zenoh
from msgspec.structs import replace

from keystore_audit.intent.environment import CONFIGURATION, read_environment
from keystore_audit.rules import BY_CODE
from tests.amount import SHARE
from tests.oracles.zenoh.asking import OLDER, real, real_answers
from tests.oracles.zenoh.attacks import (
    ATTACKS,
    EFFECTS,
    ENDING,
    IMAGE,
    STOLEN_KEYS,
    THIEVES,
    Attack,
    Effect,
    ending_at,
    write_identities,
)
from tests.oracles.zenoh.case import Case, K
from tools.samples.network_stories import KEYSTORE
from tools.samples.story import read_description

SAMPLES = Path(__file__).resolve().parents[3] / "sample_keystores"
FIRST_PORT = 22000
PORTS = ("7446", "7447", "7448", "7449", "7450")
"""Those that samples and attackers have."""
WAITED = timedelta(seconds=1)
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all
RULES = sorted(code for code in BY_CODE if code.startswith("KA8"))


class Sample:
    """The files of a side of a pair."""

    def __init__(self, code: str, side: str) -> None:
        self.keystore = SAMPLES / "rules" / f"{code}-{BY_CODE[code].name}" / side
        options = read_description(self.keystore)["options"]
        said = dict(zip(options[::2], options[1::2], strict=True))
        self.folder = SAMPLES / said["--zenoh"]
        self.sessions = {each.stem: json.loads(each.read_text("utf-8")) for each in self.folder.glob("*.json5")}
        override = read_environment(SAMPLES / said["--env"]).value(CONFIGURATION) if "--env" in said else ""
        self.override = dict(each.split("=", 1) for each in override.split(";") if each)


def attacked(attack: Attack, sample: Sample) -> Case:
    """The sample's sessions and whoever attacks."""
    there = {name: each for name, each in sample.sessions.items() if name != attack.instead}
    there |= {} if attack.default is None else dict([attack.default]) | there
    if attack.own is not None:
        there[attack.who] = attack.own
    elif attack.does != "link":
        there[attack.who] = without_rules(sample, attack.who)
    return Case("", "", there, (), attack.who, attack.whom, attack.does, attack.key, attack.at)


def without_rules(sample: Sample, name: str) -> dict[str, Any]:
    """A session of somebody who drops its rules and connects to all others that listen."""
    own = {field: value for field, value in sample.sessions[name].items() if field != "access_control"}
    others = [each for other, each in sample.sessions.items() if other != name]
    return own | {"connect": {"endpoints": [end for each in others for end in each["listen"]["endpoints"]]}}


def meant(sample: Sample, effect: Effect | None = None) -> Case:
    """What the samples are there for."""
    there = dict(sample.sessions)
    if effect is not None and effect.drops:
        there[effect.drops] = without_rules(sample, effect.drops) | {"connect": there[effect.drops]["connect"]}
    who, whom = (effect.who, effect.whom) if effect is not None else ("talker", "listener")
    if "camera" in there:
        return Case("", "", there, (), "camera", "viewer", key=IMAGE, at=IMAGE)
    return Case("", "", there, (), who, whom, key=K, at=K)


def placed(case: Case, name: str, number: int, keystore: Path, thieves: Path, override: Mapping[str, str]) -> Case:
    """The case with paths and ports of this machine."""
    text = json.dumps(case.sessions)
    port = FIRST_PORT + 6 * number
    for each, old in enumerate(PORTS):
        text = text.replace(f":{old}", f":{port + each}")
    text = text.replace(f"224.0.0.224:{port}", f"224.0.0.224:{port}#iface=lo")
    text = text.replace(KEYSTORE, f"{keystore}").replace(f"{THIEVES}", f"{thieves}")
    sessions = json.loads(text)
    for each in sessions.values():
        if each["scouting"]["multicast"]["enabled"]:
            each["scouting"]["multicast"]["address"] = f"224.0.0.226:{port + 5}"
    return replace(case, name=name, sessions=sessions, override=override)


def every() -> Iterator[tuple[str, str, Case, Sample]]:
    """Name, what is expected, and the case; what is meant is asked once of files that several samples share."""
    asked = set[str]()
    for code in RULES:
        for side in ("bad", "good"):
            sample = Sample(code, side)
            if code in ATTACKS:
                yield f"{code} {side}", "yes" if side == "bad" else "no", attacked(ATTACKS[code], sample), sample
            elif code in EFFECTS:
                effect = EFFECTS[code]
                yield f"{code} {side}", getattr(effect, side), meant(sample, effect), sample
            text = json.dumps(sample.sessions, sort_keys=True)
            if side == "good" and text not in asked:
                asked.add(text)
                yield f"{code} meant", "yes", meant(sample), sample


@pytest.fixture(scope="module", params=["", *(OLDER if SHARE >= 1 else ())])
def answers(
    tmp_path_factory: pytest.TempPathFactory, oracle: Callable[[str], str], request: Any
) -> Mapping[str, tuple[str, str]]:
    """What is expected, and what came of it: of the newest release, and in `make test-long` of older ones."""
    python = oracle(f"{sys.prefix}/zenoh-{request.param}/bin/python") if request.param else sys.executable
    thieves = write_identities(tmp_path_factory.mktemp("thieves"), STOLEN_KEYS)
    expected, cases = {}, []
    for number, (name, said, case, sample) in enumerate(every()):
        expected[name] = said
        cases.append(placed(case, name, number, sample.keystore, thieves, sample.override))
    came = real_answers(cases, expected, python)
    return {name: (said, came[name]) for name, said in expected.items()}


@pytest.mark.parametrize("code", [code for code in RULES if code != ENDING])
def test_a_remedy_ends_what_the_finding_warns_of(code: str, answers: Mapping[str, tuple[str, str]]) -> None:
    own = {name: each for name, each in answers.items() if name.startswith(code)}
    assert {name: came for name, (_said, came) in own.items()} == {name: said for name, (said, _came) in own.items()}
    assert {f"{code} bad", f"{code} good"} <= own.keys()


def test_a_link_ends_with_its_certificate_by_the_remedy(tmp_path: Path) -> None:
    """KA813. A busy machine may need longer than a certificate lasts: then another one lasts longer."""
    for seconds in (5, 15, 45):
        end = datetime.now(timezone.utc).replace(microsecond=0) + timedelta(seconds=seconds)
        root = write_identities(tmp_path / f"{seconds}", ending_at(end))
        reads = (
            replace(meant(Sample(ENDING, side)), who="listener", whom="talker", does="read", after=end + WAITED)
            for side in ("bad", "good")
        )
        both = [placed(case, "", 100 + number, root, root, {}) for number, case in enumerate(reads)]
        with ThreadPoolExecutor() as pool:
            came = [*pool.map(real, both)]
        if came[0] == "yes":
            break
    assert came == ["yes", "no"]


def test_a_file_that_we_do_not_read_is_read_there() -> None:
    """KA826: so that nobody knows what a process does that starts with it."""
    (file,) = Sample("KA826", "bad").folder.glob("*.yaml")
    assert zenoh.Config.from_file(file).get_json("mode") == '"peer"'
