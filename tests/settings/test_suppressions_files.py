"""`[[suppression]]` and `[[accepted]]`: every key, and where something in a file is wrong."""

from __future__ import annotations

from datetime import date, datetime, timezone
from pathlib import Path
from typing import Any

import pytest

from keystore_audit import toml
from keystore_audit.findings import Severity
from keystore_audit.settings.settings import read_baseline
from tests.schemas import schema
from tests.settings.files import read, wrong
from tests.settings.test_suppressions import ENTRY, PLACED, PRINT, WHY


def test_every_key_is_read(tmp_path: Path) -> None:
    text = f"""max_suppression_days = 400
{PLACED}
[[suppression]]
code = "KA711"
fingerprint = "{PRINT}"
severity = "critical"
profiles = ["spec", "fastdds-3.6"]
meaning = "{PRINT}"
{WHY}"""
    settings = read(tmp_path, text)
    placed, printed = settings.suppressions
    assert settings.max_suppression_days == 400
    assert (placed.code, placed.where, placed.fingerprint, placed.severity) == ("KA205", ("/talker",), None, None)
    assert (placed.reason, placed.owner, placed.until) == ("so", "Ada", date(2026, 12, 4))
    assert (placed.location.line, placed.location.beside, placed.place) == (2, True, f"{settings.file.path}:2")
    assert (printed.where, printed.fingerprint, printed.severity) == ((), PRINT, Severity.CRITICAL)
    assert printed.profiles == {"spec", "fastdds-3.6"}
    assert (placed.meaning, printed.meaning) == (None, PRINT)
    assert placed.end == datetime(2026, 12, 4, 23, 59, 59, tzinfo=timezone.utc)


WRONG = [
    (
        PLACED.replace("reason", "reson"),
        ":4",
        "unknown key 'reson'; expected code, profiles, reason",
    ),
    (PLACED.replace('reason = "so"\n', ""), ":1", "missing key `reason`"),
    (PLACED.replace('owner = "Ada"\n', ""), ":1", "missing key `owner`"),
    (PLACED.replace("until = 2026-12-04\n", ""), ":1", "missing key `until`"),
    (PLACED.replace("2026-12-04", '"2026-12-04"'), ":6", "Expected `date` without quotes"),
    (PLACED.replace("2026-12-04", "2026-12-04T12:00:00Z"), ":6", "Expected `date` without quotes"),
    (PLACED.replace("2026-12-04", "2026-13-04"), ":6:", "this is not TOML"),
    (PLACED.replace('"so"', '"  "'), ":4", "expected words, and not only spaces"),
    (PLACED.replace('"so"', '""'), ":4", "expected words, and not only spaces"),
    (PLACED.replace('"so"', f'"{"x" * 1001}"'), ":4", "Expected `str` of length <= 1000"),
    (PLACED.replace("Ada", "x" * 201), ":5", "Expected `str` of length <= 200"),
    (PLACED.replace("KA205", "KA2"), ":2", "expected one rule's code, e.g. KA203, and no family"),
    (PLACED.replace("KA205", "certificate-expires-soon"), ":2", "expected one rule's code"),
    (PLACED.replace("KA205", "KA903"), ":2", "which nothing accepts"),
    (PLACED.replace('where = "/talker"\n', ""), ":1", "exactly one of where, fingerprint"),
    (f'{PLACED}fingerprint = "{PRINT}"\n', ":1", "exactly one of where, fingerprint"),
    (PLACED.replace('"/talker"', '["*", "/talker"]'), ":3", "everything: expected it alone"),
    (PLACED.replace("/talker", "./talker"), ":3", "expected an enclave"),
    (PLACED.replace("/talker", "enclaves//talker"), ":3", "expected an enclave"),
    (PLACED.replace("/talker", "../talker"), ":3", "expected an enclave"),
    (PLACED.replace('"/talker"', "[]"), ":3", "Expected `array` of length >= 1"),
    (f'{PLACED}severity = "bad"\n', ":7", "'bad'; expected critical, high"),
    (f'{PLACED}meaning = "{PRINT}"\n', ":7", "this belongs to a fingerprint"),
    (PLACED.replace('where = "/talker"', f'fingerprint = "{PRINT}"'), ":1", "missing key `meaning`"),
    (f'{PLACED}profiles = "humble"\n', ":7", "'humble' is no profile; expected names as in reports"),
    (PLACED.replace('where = "/talker"', f'fingerprint = "{PRINT[:-1]}"'), ":3", "expected 64 digits"),
    ("suppression = 3\n", ":1", "Expected `array`, got `int`"),
    ("max_suppression_days = 0\n", ":1", "Expected `int` >= 1"),
    ("max_suppression_days = true\n", ":1", "Expected `int`, got `bool`"),
    ("max_suppression_days = 99999\n", ":1", "Expected `int` <= 3650"),
]


@pytest.mark.parametrize(("text", "where", "what"), WRONG)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, text: str, where: str, what: str) -> None:
    said = wrong(tmp_path, text)
    assert said.startswith(where)
    assert what in said


WRONG_ENTRIES = [
    (ENTRY.replace('severity = "low"\n', ""), ":1", "missing key `severity`"),
    (ENTRY.replace("fingerprint", "where"), ":3", "unknown key 'where'"),
    (f"{ENTRY}{ENTRY}", ":11", "accepted already, at"),
    (ENTRY.replace(f'meaning = "{PRINT}"', 'meaning = "x"'), ":4", "expected 64 digits"),
    (f"{ENTRY}profiles = []\n", ":9", "Expected `array` of length >= 1"),
    (ENTRY.replace("KA205", "KA905"), ":2", "which nothing accepts"),
    (ENTRY.replace("accepted", "suppression"), ":1", "unknown key 'suppression'; expected accepted"),
    (ENTRY.replace("low", "none"), ":5", "'none'; expected critical, high"),
]


@pytest.mark.parametrize(("text", "where", "what"), WRONG_ENTRIES)
def test_what_is_wrong_with_a_baseline_too(tmp_path: Path, text: str, where: str, what: str) -> None:
    said = wrong(tmp_path, text, read_baseline)
    assert said.startswith(where)
    assert what in said


NOT_OF_THE_SCHEMA = (
    "accepted already",
    "expected an enclave",
    "everything",
    "'humble' is no",
    "this is not TOML",
    "expected one rule's code, e.g. KA203",
)
"""What no JSON Schema says."""


def test_the_schemas_refuse_what_is_refused() -> None:
    for name, good, bad in (("settings", PLACED, WRONG), ("baseline", ENTRY, WRONG_ENTRIES)):
        validator = schema(name)
        assert [error.message for error in validator.iter_errors(_plain(toml.loads(good)))] == []
        for text, _where, what in bad:
            if not what.startswith(NOT_OF_THE_SCHEMA) and "12:00" not in text:
                assert not validator.is_valid(_plain(toml.loads(text))), text


def _plain(value: Any) -> Any:
    """Dates as strings; a date that was a string already is none any more."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_plain(each) for each in value]
    if isinstance(value, str) and value == "2026-12-04":
        return "in quotes"
    return value.isoformat() if isinstance(value, date) else value
