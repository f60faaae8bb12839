"""Facts 4.3, end to end: hostile certificates, keys and revocation lists in one enclave."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.hostile.credentials import CASES
from tests.hostile.store import Case, parameters


@pytest.mark.parametrize("case", parameters(CASES))
def test_credential(case: Case, hostile: Callable[[Case], object]) -> None:
    hostile(case)
