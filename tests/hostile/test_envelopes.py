"""Facts 4.2, end to end: hostile MIME and CMS around one enclave's permissions."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.hostile.envelopes import CASES
from tests.hostile.store import Case, parameters


@pytest.mark.parametrize("case", parameters(CASES))
def test_message(case: Case, hostile: Callable[[Case], object]) -> None:
    hostile(case)
