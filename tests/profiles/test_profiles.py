"""The profiles, and what their documentation says of them."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

from keystore_audit import api
from keystore_audit.profiles import ALIASES, DEFAULT, VARIANTS, Evidence


def test_the_documentation_names_every_profile_and_how_it_is_known(repository: Path) -> None:
    rows = {
        cells[0]: cells[-1]
        for line in (repository / "docs/profiles.md").read_text().splitlines()
        if len(cells := [cell.strip() for cell in line.strip("|").split("|")]) == 4
    }
    letters = {Evidence.TESTED: "T", Evidence.MEASURED: "M", Evidence.READ: "R"}
    for name, profile in VARIANTS.items():
        assert rows[name].startswith("the text" if name == "spec" else letters[profile.evidence]), name


def test_every_supported_distribution_is_judged_by_default() -> None:
    shipped = {
        name
        for name, profile in VARIANTS.items()
        if {"humble", "jazzy", "kilted", "lyrical"} & {*profile.distributions}
    }
    assert set(DEFAULT) == {"spec", *shipped}
    assert set(ALIASES["all"]) == set(VARIANTS)


def test_a_vendor_is_every_release_that_a_supported_distribution_ships(repository: Path) -> None:
    """Not the newest alone: the stock keystore passes there, and fails with what Humble, Jazzy and Kilted ship."""
    assert {*ALIASES["fastdds"], *ALIASES["cyclonedds"], "spec"} == {*DEFAULT}
    stock = str(repository / "sample_keystores/stock/talker_listener")
    given = {"engine": "native", "at": datetime(2026, 11, 21, tzinfo=timezone.utc)}
    exits = {name: api.audit(stock, profiles=[name], **given).exit_code for name in ("cyclonedds", "cyclonedds-11")}
    assert exits == {"cyclonedds": 1, "cyclonedds-11": 0}
