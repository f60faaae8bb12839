"""Whom the text of a grant means, and which grants name just that subject."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from keystore_audit.model.stolen_key import holding
from keystore_audit.model.subjects.told import grants_naming, meaning
from tests.engine.systems import IDENTITY_CA, TALKER_PERMISSIONS, Builder, healthy_builder


@pytest.mark.parametrize(
    "text", [" CN=/a,O=b", "CN=/a , O=b", 'CN="/a",O="b"', "CN=/a,O=b,", "O=b,CN=/a", "CN=/a,2.5.4.10=b"]
)
def test_words_that_mean_one_subject(text: str) -> None:
    assert meaning(text) == meaning("CN=/a,O=b")


@pytest.mark.parametrize("text", ["CN=/a", "CN=/A,O=b", "CN=/a/c,O=b", "CN=/a+O=b", "CN=/a,O=b,O=b", "", "O=b", "/a"])
def test_words_that_mean_another(text: str) -> None:
    assert meaning(text) != meaning("CN=/a,O=b")


def granting(*texts: str) -> Builder:
    """A document with a grant for each text, in this order."""
    b = healthy_builder()
    b.grants.clear()
    b.rules.clear()
    for text in texts:
        number = b.grant(TALKER_PERMISSIONS, [])
        b.grants[number] = replace(b.grants[number], subject=text)
    return b


@pytest.mark.parametrize(
    ("profile", "shorter", "longer"),
    [("cyclonedds-11", {0, 1}, {1}), ("fastdds-3.6", {0}, {1}), ("spec", {0}, {1}), ("of a test", {0}, {1})],
)
def test_to_cyclonedds_a_longer_name_names_the_shorter(profile: str, shorter: set[int], longer: set[int]) -> None:
    system = replace(granting("CN=/arm", "CN=/arm/hand").system(), profiles=(profile,))
    assert grants_naming(system, ["CN=/arm", "CN=/arm/hand"]) == {"CN=/arm": (shorter,), "CN=/arm/hand": (longer,)}


def test_profiles_that_read_all_certificates_alike_may_differ_about_others() -> None:
    system = replace(granting("CN=/arm", "CN=/arm/hand").system(), profiles=("spec", "cyclonedds-11"))
    assert grants_naming(system, ["CN=/arm"]) == {"CN=/arm": ({0}, {0, 1})}


def test_who_has_the_key_of_the_identity_authority_makes_each_subject_that_grants_tell() -> None:
    system = replace(granting("CN=/arm", "CN=/arm/hand").system(), profiles=("cyclonedds-11",))
    held = holding(system, system.certificates[IDENTITY_CA].key)
    made = range(len(system.certificates), len(held.certificates))
    naming = {frozenset(n for n, grant in enumerate(held.grants) if each in grant.names) for each in made}
    assert naming == {frozenset(), frozenset({0, 1}), frozenset({1})}
