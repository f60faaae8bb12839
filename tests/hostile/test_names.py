"""Facts 4.5, end to end: names that would steer what shows them, in text and in JSON."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from tests.hostile.conftest import Audit
from tests.hostile.names import CASES, MARK
from tests.hostile.store import Case, parameters

pytestmark = pytest.mark.filterwarnings("ignore:Attribute's length")  # of long names, while they are made


@pytest.mark.parametrize("case", parameters(CASES))
def test_name(case: Case, hostile: Callable[[Case], Audit]) -> None:
    audited = hostile(case)
    told = [line for line in audited.text.decode().splitlines() if MARK in line]
    assert told or MARK in json.dumps(audited.report), "nobody sees the name at all"
