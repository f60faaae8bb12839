"""Messages changed at random, with a fixed seed: ours valid means OpenSSL valid, and the same bytes."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterator

import pytest

from keystore_audit.truth import Truth
from tests.amount import tried
from tests.keystore.messages import with_signature
from tests.oracles.smime.comparison import compare
from tests.oracles.smime.der import attribute, tlv
from tests.oracles.smime.mutants import run
from tests.oracles.smime.oracle import Oracle, running
from tests.oracles.smime.signed_data import CA, CONTENT_TYPE, MESSAGE, MESSAGE_DIGEST, changed
from tests.oracles.smime.stricter import listed

MUTATIONS = tried(5_000)
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


def test_values_of_signed_attributes(answers: Oracle) -> None:
    """Every tag with contents of all kinds, signed by the authority: OpenSSL decodes the value, we only look at it."""
    rng = random.Random(1)
    seen: Counter[tuple[Truth, bool]] = Counter()
    for _ in range(tried(1_000)):
        tag = rng.choice((*range(0x1F), *range(0x20, 0x3F), 0x80, 0xA0, 0x65))
        value = tlv(tag, bytes(rng.choices((0, 1, 4, 0x7F, 0x80, 0x81, 0xFF), k=rng.randrange(5))))
        der = changed(attributes=(CONTENT_TYPE, MESSAGE_DIGEST, attribute("1.2.3.4", value))).der()
        comparison = compare(answers, with_signature(MESSAGE, der), (CA,))
        assert comparison.contradictions() == [], value.hex()
        assert comparison.stricter() <= listed().keys(), value.hex()
        seen[comparison.pinned, comparison.answer.pinned is not None] += 1
    assert seen[Truth.YES, True] > tried(250)
    assert seen[Truth.UNKNOWN, False] > tried(250)
    assert seen[Truth.UNKNOWN, True] < tried(200)
