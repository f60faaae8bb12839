"""What an enclave may do by its own implementation: ours beside the real Cyclone DDS 0.10.2 and Fast DDS 2.9.1.

Some 1,000 recipes that probe every row of the semantics tables, up to 1,000 keystores with random rules, and as many
whose documents are out of form. Where we do not know, the recipe stands in local_abstentions.json with our reason.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.amount import tried
from tests.oracles.vendors import random_documents, random_keystores
from tests.oracles.vendors.enclave import Answer, Vendor, vendors
from tests.oracles.vendors.local_answers import ABSTENTIONS, MEASURED, abstentions, written
from tests.oracles.vendors.local_comparison import Comparison, compare
from tests.oracles.vendors.recipes import every
from tests.oracles.xml.parsers import require_measured_versions

pytestmark = pytest.mark.xdist_group("vendors-local")


@pytest.fixture(scope="module")
def asked(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Vendor]]:
    require_measured_versions(oracle)
    with vendors(oracle, tmp_path_factory.mktemp("programs")) as running:
        yield running


@pytest.fixture(scope="module")
def recipes(
    asked: dict[str, Vendor], tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, dict[str, Answer]], Comparison]:
    """Every recipe, asked once: the vendors' answers, and how ours compare."""
    comparison = Comparison()
    folder = tmp_path_factory.mktemp("recipes")
    return compare(asked, every().values(), folder, comparison), comparison


def test_the_vendors_answer_as_measured(recipes: tuple[dict[str, dict[str, Answer]], Comparison]) -> None:
    answers, _ = recipes
    expected: dict[str, dict[str, str]] = json.loads(MEASURED.read_text())
    assert {title: {name: written(a) for name, a in each.items()} for title, each in answers.items()} == expected


def test_ours_agree_on_every_recipe(recipes: tuple[dict[str, dict[str, Answer]], Comparison]) -> None:
    _, comparison = recipes
    assert comparison.deviating == {}
    assert min(comparison.agreed.values()) >= 3500


def test_where_we_do_not_know_is_listed(recipes: tuple[dict[str, dict[str, Answer]], Comparison]) -> None:
    _, comparison = recipes
    assert abstentions(comparison.abstained) == json.loads(ABSTENTIONS.read_text())


def test_ours_agree_on_random_keystores(asked: dict[str, Vendor], tmp_path: Path) -> None:
    comparison = Comparison()
    compare(asked, map(random_keystores.keystore, range(tried(1_000))), tmp_path, comparison)
    assert comparison.deviating == {}
    assert comparison.abstained == {}
    assert min(comparison.agreed.values()) >= tried(5_000)


def test_ours_agree_on_documents_out_of_form(asked: dict[str, Vendor], tmp_path: Path) -> None:
    """Of one in twenty we say that it is not known; wherever we say more, the vendors agree."""
    comparison = Comparison()
    compare(asked, map(random_documents.keystore, range(tried(1_000))), tmp_path, comparison)
    assert comparison.deviating == {}
    assert len(comparison.abstained) <= tried(1_000) * len(asked) / 20
    assert min(comparison.agreed.values()) >= tried(3_500)
