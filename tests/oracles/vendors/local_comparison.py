"""What we say of keystores beside what the vendors do with them."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from msgspec import Struct, field

from keystore_audit.truth import Truth
from tests.oracles.vendors.enclave import Answer, Vendor
from tests.oracles.vendors.ours import Asked
from tests.oracles.vendors.recipe import NOW, Recipe


class Comparison(Struct, kw_only=True):
    """How often the answers agree, and where they do not: by vendor and title, in words."""

    agreed: Counter[str] = field(default_factory=Counter)
    abstained: dict[tuple[str, str], str] = field(default_factory=dict)
    deviating: dict[tuple[str, str], str] = field(default_factory=dict)

    def add(self, recipe: Recipe, vendor: str, ours: Asked, answer: Answer) -> None:
        """Compare the participant, and the endpoints where one starts."""
        place, started = (vendor, recipe.title), ours.starts(vendor)
        usable = started.usable
        if usable is Truth.UNKNOWN:
            self.abstained[place] = started.reason
            return
        if usable.must != (answer.participant is None):
            theirs = answer.participant or "starts"
            self.deviating[place] = f"ours: usable is {usable.value} ({started.reason}); theirs: {theirs}"
            return
        self.agreed[vendor] += 1
        listed = zip(recipe.endpoints, ours.endpoints(vendor), answer.endpoints, strict=usable.must)
        for endpoint, told, refusal in listed:
            if told.decision is Truth.UNKNOWN:
                self.abstained[place] = str(endpoint)
            elif told.decision is not Truth(refusal is None):
                said = told.decision.value
                self.deviating[place] = f"{endpoint}; ours: {said}; theirs: {refusal or 'created'}"
            else:
                self.agreed[vendor] += 1


def compare(
    asked: Mapping[str, Vendor], recipes: Iterable[Recipe], folder: Path, comparison: Comparison
) -> dict[str, dict[str, Answer]]:
    """Ask everybody about every recipe; the vendors' answers by title and vendor."""
    answers: dict[str, dict[str, Answer]] = {}
    for recipe in recipes:
        keystore = folder / "keystore"
        enclave = recipe.build(keystore / "enclaves/talker")
        theirs = {
            name: vendor.ask(enclave, recipe.domain, recipe.endpoints, recipe.time_zone)
            for name, vendor in asked.items()
        }
        ours = Asked(keystore, "/talker", recipe.domain, recipe.endpoints, NOW, recipe.time_zone)
        answers[recipe.title] = {name: answer() for name, answer in theirs.items()}
        for name, answer in answers[recipe.title].items():
            comparison.add(recipe, name, ours, answer)
        shutil.rmtree(keystore)
    return answers
