"""What a verdict rests on: a line of its own in every format, and `--no-assume` decides without it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from keystore_audit.assumptions import Assumption
from tests.cli.keystores import run_at
from tests.schemas import schema

HEALTHY = Path(__file__).parents[2] / "sample_keystores/healthy"
AUDIT = ("turtlesim", "--engine", "native", "--offline", "--at", "2026-11-23T00:00:00Z")
LINE = (
    "HOLDS IF peers announce endpoints truthfully (Cyclone DDS does not check); authorities issued no other "
    "certificates"
)


def audit(*options: str) -> tuple[int, str]:
    done = run_at(HEALTHY, *AUDIT, *options)
    return done.returncode, done.stdout


@pytest.mark.parametrize("form", ["-v", "-q", "json", "sarif", "junit", "markdown", "html", "statement"])
def test_every_format_says_what_it_holds_under_and_it_passes(form: str) -> None:
    code, said = audit(*([form] if form.startswith("-") else ["-f", form]))
    assert code == 0
    assert LINE in " ".join(said.replace("\\", "").split())


def report(*options: str) -> tuple[int, dict[str, dict[str, object]], dict[str, str]]:
    code, said = audit("-f", "json", *options)
    document = json.loads(said)
    schema("report").validate(document)
    statuses = {each["id"]: each["status"] for each in document["properties"]}
    return code, {each["name"]: each for each in document["assumptions"]}, statuses


def test_who_needs_it_is_told() -> None:
    _code, assumptions, statuses = report()
    assert list(assumptions) == [
        "truthful-announcements",
        "nothing-else-certified",
        "robots-enforce",
        "authorities-as-found",
        "no-other-documents",
    ]
    needing = assumptions["truthful-announcements"]["needed_by"]
    assert needing == ["nobody-writes-without-a-grant", "nobody-reads-without-a-grant"]
    assert assumptions["no-other-documents"]["needed_by"] == [
        "no-subject-serves-two-enclaves",
        *needing,
        "relays-cannot-read",
    ]
    assert statuses["documents-signed-by-the-permissions-ca"] == "holds"
    assert not any("documents-signed-by-the-permissions-ca" in each["needed_by"] for each in assumptions.values())
    _code, pinned, _statuses = report("--profile", "spec")
    assert "truthful-announcements" not in pinned


@pytest.mark.parametrize(
    ("assumption", "code", "prop", "status"),
    [
        (Assumption.TRUTHFUL_ANNOUNCEMENTS, 1, "nobody-writes-without-a-grant", "violated"),
        (Assumption.NOTHING_ELSE_CERTIFIED, 4, "no-enclave-grants-itself-rights", "unknown"),
        (Assumption.AUTHORITIES_AS_FOUND, 4, "no-enclave-grants-itself-rights", "unknown"),
        (Assumption.NO_OTHER_DOCUMENTS, 4, "nobody-reads-without-a-grant", "unknown"),
        (Assumption.ROBOTS_ENFORCE, 4, "outsiders-cannot-read", "unknown"),
        (Assumption.NOTHING_IN_UNREAD_FILES, 0, "no-enclave-grants-itself-rights", "holds"),
        (Assumption.LOCKSTEP_ROUNDS, 0, "no-enclave-grants-itself-rights", "holds"),
    ],
)
def test_without_one(assumption: Assumption, code: int, prop: str, status: str) -> None:
    found, assumptions, statuses = report("--no-assume", assumption.value)
    assert (found, statuses[prop]) == (code, status)
    assert assumption.value not in assumptions


def test_settings_say_who_takes_it_upon_himself(tmp_path: Path) -> None:
    settings = tmp_path / "s.toml"
    said = '[[assumption]]\nname = "nothing-else-certified"\nowner = "Ada"\nreason = "We keep a log."\n'
    settings.write_text(said, "utf-8")
    _code, assumptions, _statuses = report("--settings", str(settings))
    told = assumptions["nothing-else-certified"]
    assert (told["source"], told["owner"], told["reason"]) == ("settings", "Ada", "We keep a log.")
    assert assumptions["robots-enforce"]["source"] == "default"
    _code, statement = audit("-f", "statement", "--settings", str(settings))
    assert '"owner": "Ada"' in statement
    settings.write_text(said.replace("nothing-else", "nothing"), "utf-8")
    done = run_at(HEALTHY, *AUDIT, "--settings", str(settings))
    assert done.returncode == 2
    assert "s.toml:2: name: Invalid enum value 'nothing-certified'; expected authorities-as-found, " in done.stderr
