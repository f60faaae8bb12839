"""Certificates forged for random stores that violate a property are refused; most of those that hold have one.

More stores, by hand, of seeds from the first to the last (300 take some minutes; the counts are printed):

    PYTHONPATH=. python -m tests.certificate.test_forged 0 300
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

from keystore_audit.certificate.checking import Checker, Implementation
from keystore_audit.certificate.errors import CannotTell, Refused
from keystore_audit.errors import UsageError
from keystore_audit.flow import find_flow, reached
from keystore_audit.profiles import DEFAULT
from keystore_audit.properties.result import Status
from tests.amount import tried
from tests.certificate.asking import EVERY, closed, forged, is_accepted, question, reading
from tests.certificate.stores import asked

SEEDS = tried(100)
SHARE = 0.8
"""Of implementations under which a property holds: how many a certificate convinces at least."""


def one_seed(seed: int, root: Path) -> Counter[str]:
    """How often what came out, by implementation; `forged`: certificates that were refused."""
    store, counts = asked(seed, root), Counter[str]()
    try:
        answer = find_flow(store.root, question(store.property), reading())
        inside = reached(store.root, question(store.property), reading())
        checker = Checker(store.root, store.property, EVERY)
    except (UsageError, CannotTell):
        return Counter(beyond=1)
    ((_attacker, result),) = answer.results
    seen = set[tuple[Implementation, Status]]()
    for name in DEFAULT:
        status = result.profiles[name].status
        try:
            implementation = checker.implementation(name)
        except CannotTell:
            counts["beyond"] += 1
            continue
        if (implementation, status) not in seen:
            seen.add((implementation, status))
            told = {"outsider" if each is None else each for each in inside[name]}
            counts += _violated(implementation, told) if status is Status.VIOLATED else _holding(implementation, told)
    counts["violated stores"] = min(1, counts["violated"])
    return counts


def _violated(implementation: Implementation, reached: set[str]) -> Counter[str]:
    """Every compartment that somebody might claim, each with all reasons that there are."""
    source, target = implementation._source, implementation._target
    everybody, own = {*implementation.participants}, closed(implementation)
    insides = {frozenset(each) for each in (reached - target, everybody - target, source, own - target, own, reached)}
    insides |= {frozenset(own - {each}) for each in own - source}
    count = 0
    for inside in sorted(insides, key=sorted):
        for bare in (False, True):
            assert not is_accepted(implementation, forged(implementation, {*inside}, bare=bare)), sorted(inside)
            count += 1
    return Counter(violated=1, forged=count)


def _holding(implementation: Implementation, reached: set[str]) -> Counter[str]:
    try:
        made = implementation.compartment(reached)
    except Refused:
        return Counter(unconvinced=1)
    assert is_accepted(implementation, made) or implementation._target & reached
    return Counter(convinced=1)


def test_no_forged_certificate_of_a_violated_store_is_accepted(tmp_path: Path) -> None:
    counts = sum((one_seed(seed, tmp_path / str(seed)) for seed in range(SEEDS)), Counter[str]())
    assert counts["violated stores"] >= SEEDS // 5
    assert counts["forged"] >= 4 * counts["violated"]
    assert counts["convinced"] >= SHARE * (counts["convinced"] + counts["unconvinced"])


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        first, last = map(int, sys.argv[1:])
        print(sum((one_seed(seed, Path(folder) / str(seed)) for seed in range(first, last)), Counter[str]()))
