"""Random mutations of the messages that some implementation accepts, each compared with OpenSSL's verdict."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from itertools import chain

from msgspec import Struct, field

from tests.oracles.smime.comparison import WORDS, Comparison, compare
from tests.oracles.smime.corpus import Case, cases
from tests.oracles.smime.mutation import mutated
from tests.oracles.smime.oracle import Oracle
from tests.oracles.smime.resigning import Signers

_WRITERS = ("EC: ", "RSA: ", "P-384: ")
_SIGNED_BY = ("signer: ", "chain: an enclave with", "chain: a middle authority")


class Tally(Struct):
    """What a run saw. `stricter`: reasons for which we leave open what OpenSSL accepts, with the first such message."""

    tried: int = 0
    different: int = 0
    verdicts: Counter[tuple[str, str]] = field(default_factory=Counter)
    contradictions: list[tuple[str, bytes, bytes]] = field(default_factory=list)
    """What is wrong, the message, and the permissions CA file."""
    stricter: Counter[tuple[str, str]] = field(default_factory=Counter)
    examples: dict[tuple[str, str], bytes] = field(default_factory=dict)

    def add(self, comparison: Comparison, message: bytes, trusted: bytes) -> None:
        self.tried += 1
        theirs = "refused" if comparison.answer.pinned is None else "accepted"
        self.verdicts[WORDS[comparison.pinned], theirs] += 1
        for text in comparison.contradictions():
            self.contradictions.append((text, message, trusted))
        for reason in comparison.stricter():
            self.stricter[reason] += 1
            self.examples.setdefault(reason, message)


def seeds(oracle: Oracle) -> list[Case]:
    """What real writers make and what other signers sign, where OpenSSL accepts it and we agree."""
    found = []
    for case in cases():
        if case.name.startswith((*_WRITERS, *_SIGNED_BY)):
            comparison = compare(oracle, case.message, case.trusted, case.known)
            accepted = comparison.answer.pinned is not None or comparison.answer.chained is not None
            if accepted and not comparison.contradictions():
                found.append(case)
    return found


def signers_of(found: Sequence[Case]) -> Signers:
    """Whoever signed one of them or is trusted by it."""
    everyone = chain.from_iterable((*case.trusted, *case.known) for case in (*cases(), *found))
    return {signed.certificate.serial_number: signed for signed in everyone}


def run(oracle: Oracle, count: int, seed: int) -> Tally:
    """Try `count` mutations; the same seed makes the same choices."""
    rng, tally = random.Random(seed), Tally()
    found = seeds(oracle)
    signers = signers_of(found)
    for _ in range(count):
        case = rng.choice(found)
        message = mutated(case.message, rng, signers)
        tally.different += message != case.message
        trusted = b"".join(signed.pem for signed in case.trusted)
        tally.add(compare(oracle, message, case.trusted, case.known), message, trusted)
    return tally
