"""Facts 4.1, end to end: hostile XML in one enclave's signed documents."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.hostile.documents import CASES
from tests.hostile.store import Case, parameters


@pytest.mark.parametrize("case", parameters(CASES))
def test_xml(case: Case, hostile: Callable[[Case], object]) -> None:
    hostile(case)
