"""Every recipe, by title."""

from __future__ import annotations

from tests.oracles.vendors import (
    recipes_documents,
    recipes_expressions,
    recipes_governance,
    recipes_grants,
    recipes_identities,
    recipes_rules,
    recipes_signers,
    recipes_subjects,
)
from tests.oracles.vendors.recipe import Recipe


def every() -> dict[str, Recipe]:
    """All of them; making the keys takes a second."""
    listed = (
        *recipes_rules.RECIPES,
        *recipes_governance.RECIPES,
        *recipes_expressions.RECIPES,
        *recipes_grants.RECIPES,
        *recipes_subjects.RECIPES,
        *recipes_documents.RECIPES,
        *recipes_signers.recipes(),
        *recipes_identities.recipes(),
    )
    named = {recipe.title: recipe for recipe in listed}
    assert len(named) == len(listed), "two recipes of one title"
    return named
