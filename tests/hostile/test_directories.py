"""Facts 4.4, end to end: directories, links and special files where one enclave should be."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.hostile.conftest import Audit
from tests.hostile.directories import CASES, CLOSED
from tests.hostile.store import Case, parameters


@pytest.mark.parametrize("case", parameters(CASES))
def test_directory(case: Case, hostile: Callable[[Case], object]) -> None:
    hostile(case)


def test_a_folder_that_may_not_be_listed_counts_itself_and_no_name_in_it(hostile: Callable[[Case], Audit]) -> None:
    findings = hostile(CLOSED).report["findings"]
    places = {place["path"] for finding in findings for place in finding["locations"]}
    assert [place for place in sorted(places) if place.startswith("closed")] == ["closed"]
