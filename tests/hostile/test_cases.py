"""Facts 4.1 to 4.5, end to end: one thing of one enclave is hostile, and everything that its case promises holds."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from tests.hostile import credentials, directories, documents, envelopes, names
from tests.hostile.conftest import Audit
from tests.hostile.store import Case, parameters

pytestmark = pytest.mark.filterwarnings("ignore:Attribute's length")  # of long names, while they are made


@pytest.mark.parametrize(
    "case", parameters((*documents.CASES, *envelopes.CASES, *credentials.CASES, *directories.CASES))
)
def test_case(case: Case, hostile: Callable[[Case], object]) -> None:
    hostile(case)


@pytest.mark.parametrize("case", parameters(names.CASES))
def test_name(case: Case, hostile: Callable[[Case], Audit]) -> None:
    """Names that would steer what shows them, in text and in JSON."""
    audited = hostile(case)
    told = [line for line in audited.text.decode().splitlines() if names.MARK in line]
    assert told or names.MARK in json.dumps(audited.report), "nobody sees the name at all"


def test_a_folder_that_may_not_be_listed_counts_itself_and_no_name_in_it(hostile: Callable[[Case], Audit]) -> None:
    findings = hostile(directories.CLOSED).report["findings"]
    places = {place["path"] for finding in findings for place in finding["locations"]}
    assert [place for place in sorted(places) if place.startswith("closed")] == ["closed"]
