"""Every sample keystore, as the default profiles read it, is decided alike by both engines, in both readings.

tests/test_samples.py asks the whole program about some families with both; here all are asked, in one JVM.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime

import pytest
from msgspec.structs import replace

from keystore_audit import toml
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import resolve
from keystore_audit.properties import PROPERTIES
from tests.engine.alloy_batch import compare_batch
from tests.engine.test_agreement import holding
from tests.test_samples import EXPECTATIONS, name

_WORDS = re.compile(r"label=(?:'[^']*'|\"[^\"]*\")|location=Location\([^)]*\)|topic='[^']*'")


def systems() -> Iterator[tuple[str, System]]:
    """The systems of all samples that differ by more than names and places."""
    seen: set[str] = set()
    for description in EXPECTATIONS:
        at = datetime.fromisoformat(toml.loads(description.read_text())["at"].replace("Z", "+00:00"))
        try:
            keystore = read_keystore(description.with_suffix(""))
        except NothingToAudit:
            continue
        accesses = AccessViews(documents_of(keystore), at, None)
        meaning = interpret(keystore, resolve(()), at, accesses, Usabilities(None, accesses))
        for system in meaning.systems:
            key = _WORDS.sub("", repr(replace(system, profiles=())))
            if key not in seen:
                seen.add(key)
                yield name(description), system


@pytest.mark.alloy
@pytest.mark.slow
@pytest.mark.xdist_group("alloy")
def test_both_engines_agree_on_every_system_of_every_sample() -> None:
    asked = list(systems())
    answers = [NativeEngine([system]).answers[0] for _name, system in asked]
    expected = [holding(each) for each in answers]
    compared = compare_batch([system for _name, system in asked], expected)
    differing = [(name, one) for (name, _system), one in zip(asked, compared, strict=True) if one]
    assert differing == []
    assert len(asked) > 300
    assert {system.may for _name, system in asked} == {True, False}
    for prop in PROPERTIES:
        assert any(not holds[prop.id] for holds in expected), f"no sample violates {prop.id}"
