"""Where we say that a document has one meaning, tinyxml2, Cyclone DDS's parser and libxml2 read the same in it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings

from keystore_audit.keystore import grammar
from tests.amount import tried
from tests.oracles.xml import ours
from tests.oracles.xml.corpus import DOCUMENTS, kind_of
from tests.oracles.xml.measure import MEASURED as MEASURED_FILE
from tests.oracles.xml.measure import measured
from tests.oracles.xml.mutation import documents
from tests.oracles.xml.ours import DocumentKind, OurReading
from tests.oracles.xml.parsers import Parsers, lxml_reading, require_measured_versions, running

pytestmark = pytest.mark.xdist_group("xml-oracle")

MEASURED: dict[str, dict[str, str]] = json.loads(MEASURED_FILE.read_text())


@pytest.fixture(scope="module")
def parsers(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Parsers]:
    require_measured_versions(oracle)
    with running(oracle, tmp_path_factory.mktemp("parsers")) as both:
        yield both


def assert_read_alike(parsers: Parsers, reading: OurReading) -> None:
    """If it has one meaning for us: nobody refuses, all read the same, and ours are those values."""
    if reading.values is None:
        return
    by_lxml = lxml_reading(reading.content)
    assert by_lxml is not None
    assert parsers.tinyxml2.read(reading.content) == by_lxml, "Fast DDS's parser"
    assert parsers.cyclone.read(reading.content) == by_lxml, "Cyclone DDS's parser"
    assert ours.comparable(by_lxml) == reading.values, "our own typed values"


def test_the_corpus_is_measured() -> None:
    assert list(MEASURED) == list(DOCUMENTS), "python -m tests.oracles.xml.measure"


@pytest.mark.parametrize("title", DOCUMENTS)
def test_every_parser_reads_what_was_measured(parsers: Parsers, title: str) -> None:
    assert measured(parsers, DOCUMENTS[title]) == MEASURED[title]


@pytest.mark.parametrize("title", DOCUMENTS)
def test_one_meaning_is_one_reading(parsers: Parsers, title: str) -> None:
    reading = ours.read(DOCUMENTS[title], kind_of(DOCUMENTS[title]))
    if reading is not None:
        assert_read_alike(parsers, reading)


def test_every_signed_document_of_the_samples(parsers: Parsers, repository: Path) -> None:
    found = {
        (path.read_bytes(), DocumentKind.GOVERNANCE if path.name.startswith("governance") else DocumentKind.PERMISSIONS)
        for path in (repository / "sample_keystores").rglob("*.p7s")
        if path.is_file()
    }
    readings = [reading for message, kind in found if (reading := ours.read_message(message, kind)) is not None]
    for reading in readings:
        assert_read_alike(parsers, reading)
    assert sum(reading.values is not None for reading in readings) >= 100, "most samples are sound"


@pytest.fixture(scope="module")
def without_explanations() -> Iterator[None]:
    """Whether a document is valid is libxml2's word; xmlschema's explanations would take most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grammar, "MAX_EXPLAINED_BYTES", 0)
        yield


@pytest.mark.usefixtures("without_explanations")
def test_no_change_makes_two_readings_of_one_meaning(parsers: Parsers) -> None:
    asked: list[bool] = []

    @settings(max_examples=tried(5_600))
    @given(document=documents())
    def search(document: bytes) -> None:
        reading = ours.read(document, kind_of(document))
        if reading is not None:
            asked.append(reading.values is not None)
            assert_read_alike(parsers, reading)

    search()
    assert len(asked) >= tried(5_000)
    assert sum(asked) >= tried(1_000), "the search says something only where we say one meaning"
