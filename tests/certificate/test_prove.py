"""What `prove` writes, `check` accepts, and nothing that differs from it."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from keystore_audit.certificate.checking import Checker, Given, NoFlow, Property
from keystore_audit.profiles import DEFAULT, resolve
from keystore_audit.prove import prove
from tests.amount import tried
from tests.certificate.asking import AT, damaged, reading, verdict

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
PINNED = tuple(profile.name for profile in resolve(("spec", "fastdds", "cyclonedds-11")))

HOLDING = [
    ("stock/talker_listener", NoFlow("/listener", "/talker"), PINNED),
    ("stock/talker_listener", NoFlow("outsider", "topic:/chatter"), PINNED),
    ("stock/talker_listener", NoFlow("topic:/chatter", "outsider", "honest"), DEFAULT),
    ("stock/turtlesim", NoFlow("outsider", "topic:/move_turtle"), PINNED),
    ("healthy/talker_listener", NoFlow("/listener", "/talker"), DEFAULT),
    ("healthy/talker_listener", NoFlow("outsider", "/listener"), DEFAULT),
    ("healthy/service_action", NoFlow("outsider", "/*"), DEFAULT),
    ("healthy/turtlesim", NoFlow("outsider", "topic:/move_turtle", "source"), DEFAULT),
    ("healthy/vehicle", NoFlow("/infotainment", "/motor"), DEFAULT),
    ("healthy/vehicle", NoFlow("/infotainment", "/motor", "source"), DEFAULT),
    ("healthy/vehicle", NoFlow("/infotainment", "topic:/motor_limit", "honest"), DEFAULT),
    ("flows/turtlesim_healthy", NoFlow("/random", "/turtlesim", "relays", ("/multiplexer",)), DEFAULT),
]


@pytest.mark.parametrize(("sample", "asked", "profiles"), HOLDING)
def test_certificates_of_samples_check_and_damaged_ones_do_not(
    sample: str, asked: Property, profiles: tuple[str, ...]
) -> None:
    store, given = SAMPLES / sample, Given(profiles, AT)
    _answer, content = prove(store, asked, reading(profiles), given)
    assert content is not None
    assert content == prove(store, asked, reading(profiles), given)[1]
    checker = Checker(store, asked, given)
    assert verdict(content, checker) == "accepted"
    for number, other in enumerate(damaged(content, Random(sample), tried(100))):
        assert verdict(other, checker) == "refused", number
