"""Every named message: what we find in it, what we and OpenSSL make of it, and never a contradiction."""

from __future__ import annotations

import base64
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from keystore_audit.truth import Truth
from tests.keystore.builder import read
from tests.oracles.smime.comparison import Comparison, compare
from tests.oracles.smime.corpus import TABLE, cases
from tests.oracles.smime.der import parse
from tests.oracles.smime.oracle import Oracle, running
from tests.oracles.smime.signed_data import CA, MESSAGE
from tests.oracles.smime.stricter import Reason, listed

ROWS = [line.split("\t") for line in TABLE.read_text(encoding="utf-8").splitlines()[1:]]

pytestmark = pytest.mark.xdist_group("smime-corpus")  # every message is compared once


@pytest.fixture(scope="module")
def oracle_running(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Oracle]:
    with running(oracle, tmp_path_factory.mktemp("oracle")) as answers:
        yield answers
        assert answers.crashes == []


@pytest.fixture(scope="module")
def compared(oracle_running: Oracle) -> dict[str, Comparison]:
    return {case.name: compare(oracle_running, case.message, case.trusted, case.known) for case in cases()}


def test_the_corpus_is_the_table() -> None:
    names = [row[0] for row in ROWS]
    assert [case.name for case in cases()] == names
    assert len(set(names)) == len(names)
    counts = {kind: sum(name.startswith(kind) for name in names) for kind in ("EC: ", "text: ", "CMS: ", "chain: ")}
    assert counts["EC: "] >= 26
    assert counts["text: "] >= 25
    assert counts["CMS: "] >= 30
    assert counts["chain: "] >= 40


@pytest.mark.parametrize(
    "row",
    [pytest.param(row, id=row[0]) for row in ROWS],
)
def test_the_verdicts_on(row: list[str], compared: dict[str, Comparison]) -> None:
    assert (row[0], *compared[row[0]].columns()) == tuple(row)
    assert compared[row[0]].contradictions() == []


def test_what_is_accepted_has_the_same_bytes(compared: dict[str, Comparison]) -> None:
    accepted = [comparison for comparison in compared.values() if comparison.pinned is Truth.YES]
    assert len(accepted) >= 100
    assert all(comparison.document.content == comparison.answer.pinned for comparison in accepted)


def test_where_we_are_stricter_is_listed_with_a_reason(compared: dict[str, Comparison]) -> None:
    found: dict[Reason, set[str]] = defaultdict(set)
    for name, comparison in compared.items():
        for reason in comparison.stricter():
            found[reason].add(name)
    assert found == {reason: names for reason, names in listed().items() if names}


def test_an_oracle_that_dies_is_reported_and_started_again(oracle: Callable[[str], str], tmp_path: Path) -> None:
    with running(oracle, tmp_path, CA.pem) as answers:
        before = answers.ask(MESSAGE)
        assert before.pinned is not None
        assert answers._process is not None
        answers._process.kill()
        answers._process.wait()
        assert answers.ask(MESSAGE).pinned is None
        assert answers.crashes == [MESSAGE]
        assert answers.ask(MESSAGE) == before


def test_a_certificate_with_an_empty_name_warns_nobody() -> None:
    (structure,) = parse(CA.der)
    for element in structure.walk():
        element.octets = b"" if element.octets == b"sros2CA" else element.octets
    encoded = base64.encodebytes(structure.encode())
    file = read(b"-----BEGIN CERTIFICATE-----\n" + encoded + b"-----END CERTIFICATE-----\n")
    assert [certificate.subject for certificate in file.certificates] == ["CN="]
