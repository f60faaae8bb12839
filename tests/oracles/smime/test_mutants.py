"""Messages changed at random, with a fixed seed: ours valid means OpenSSL valid, and the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.oracles.smime.mutants import run
from tests.oracles.smime.oracle import Oracle, running
from tests.oracles.smime.stricter import listed

MUTATIONS = 5000
"""For each seed; four seeds take 50 s of processor time. More of them: docs/testing.md."""


@pytest.fixture(scope="module")
def answers(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Oracle]:
    with running(oracle, tmp_path_factory.mktemp("oracle")) as answers:
        yield answers


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_no_mutation_is_accepted_that_openssl_refuses(seed: int, answers: Oracle) -> None:
    tally = run(answers, MUTATIONS, seed)
    assert tally.contradictions == []
    assert answers.crashes == []
    assert {reason: message for reason, message in tally.examples.items() if reason not in listed()} == {}
    assert tally.tried == MUTATIONS
    assert tally.different > MUTATIONS * 0.95, "mutations change something"
    assert tally.verdicts["accepted", "accepted"] > MUTATIONS * 0.05, "some leave the signature intact"
    assert tally.verdicts["refused", "refused"] > MUTATIONS * 0.1, "some break it"
    assert tally.verdicts["unknown", "accepted"] < MUTATIONS * 0.15, "we do not hide behind not knowing"
