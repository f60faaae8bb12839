"""Search for a document with two readings for as long as one likes: `python -m tests.oracles.xml.long_run --seed 7`."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from keystore_audit.keystore import xsd
from tests.oracles.xml import ours, policy
from tests.oracles.xml.corpus import kind_of
from tests.oracles.xml.measure import found
from tests.oracles.xml.mutation import documents
from tests.oracles.xml.parsers import running
from tests.oracles.xml.plugins import both
from tests.oracles.xml.test_one_meaning import assert_read_alike
from tests.oracles.xml.test_plugins import assert_decided_as_written


def main() -> None:
    """Stop at the first document that contradicts the tests' properties; hypothesis prints the smallest one."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--count", type=int, default=100_000)
    arguments.add_argument("--seed", type=int, default=0)
    chosen = arguments.parse_args()
    xsd.MAX_EXPLAINED_BYTES = 0  # type: ignore[misc] # whether a document is valid, not why
    tried = meant = asked = 0
    with (
        tempfile.TemporaryDirectory() as directory,
        running(found, Path(directory)) as parsers,
        both(found, Path(directory)) as plugins,
    ):

        @seed(chosen.seed)
        @settings(max_examples=chosen.count, database=None, deadline=None, suppress_health_check=list(HealthCheck))
        @given(document=st.one_of(documents(), documents(), documents(), policy.permissions(), policy.governance()))
        def search(document: bytes) -> None:
            nonlocal tried, meant, asked
            reading = ours.read(document, kind_of(document))
            tried += 1
            if reading is not None and reading.typed is not None:
                meant += 1
                assert_read_alike(parsers, reading)
                asked += assert_decided_as_written(plugins, document)

        search()
    print(f"{tried} documents, {meant} of one meaning, {asked} decided by both plugins: no contradiction")


if __name__ == "__main__":
    main()
