"""Certificates forged for random stores that violate a property are refused; most of those that hold have one.

More stores, by hand, of seeds from the first to the last (300 take some minutes; the counts are printed); with `rights`
behind them, asked about rights:

    PYTHONPATH=. python -m tests.certificate.test_forged 0 300
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from keystore_audit.certificate.checking import Checker, Encrypted, Flow, Implementation, NoFlow, Property
from keystore_audit.certificate.errors import CannotTell, Refused
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import UsageError
from keystore_audit.model.interpret import stated_systems
from keystore_audit.profiles import DEFAULT
from keystore_audit.properties.result import Status
from keystore_audit.prove import answered, within
from tests.amount import tried
from tests.certificate.asking import AT, EVERY, closed, forged, is_accepted, reached, reading
from tests.certificate.stores import asked

SEEDS = tried(100)
SHARE = 0.8
"""Of implementations under which a property holds: how many a certificate convinces at least."""


def one_seed(seed: int, root: Path, *, rights: bool = False) -> Counter[str]:
    """How often what came out, by implementation; `forged`: certificates that were refused."""
    store, counts = asked(seed, root, of_rights=rights), Counter[str]()
    try:
        result = answered(store.root, store.property, reading())
        told = reached(store.root, store.property) if isinstance(store.property, NoFlow) else {}
        checker = Checker(store.root, store.property, EVERY)
    except (UsageError, CannotTell):
        return Counter(beyond=1)
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
            violated = status is Status.VIOLATED
            counts += _violated(implementation, told.get(name, set())) if violated else _holding(implementation)
    counts["violated stores"] = min(1, counts["violated"])
    return counts


def _violated(implementation: Implementation, reached: set[str]) -> Counter[str]:
    """Every compartment that somebody might claim, each with all reasons that there are."""
    source, everybody = {*implementation.source}, {*implementation.participants}
    target = everybody - source - implementation.free
    own = closed(implementation) if isinstance(implementation, Flow) else everybody
    insides = {frozenset(each) for each in (reached - target, everybody - target, source, own - target, own, reached)}
    insides |= {frozenset(own - {each}) for each in own - source}
    count = 0
    for inside in sorted(insides, key=sorted):
        for bare in (False, True):
            assert not is_accepted(implementation, forged(implementation, inside, bare=bare)), sorted(inside)
            count += 1
    return Counter(violated=1, forged=count)


def _holding(implementation: Implementation) -> Counter[str]:
    try:
        made = implementation.compartment(within(implementation))
    except Refused:
        return Counter(unconvinced=1)
    assert is_accepted(implementation, made)
    return Counter(convinced=1)


@pytest.mark.parametrize("rights", [False, True], ids=["flows", "rights"])
def test_no_forged_certificate_of_a_violated_store_is_accepted(tmp_path: Path, rights: bool) -> None:
    counts = sum((one_seed(seed, tmp_path / str(seed), rights=rights) for seed in range(SEEDS)), Counter[str]())
    assert counts["violated stores"] >= SEEDS // 5
    assert counts["forged"] >= 4 * counts["violated"]
    assert counts["convinced"] >= SHARE * (counts["convinced"] + counts["unconvinced"])


PROVES_TOO = [
    (Encrypted("dds:*", "outsider"), {"outsiders-cannot-read"}),
    (Encrypted("dds:*", "insider"), {"nobody-reads-without-a-grant", "relays-cannot-read"}),
    (NoFlow("outsider", "dds:*", include_ambient=True), {"outsiders-cannot-inject"}),
]


@pytest.mark.parametrize(("stated", "implied"), PROVES_TOO)
def test_built_in_properties_follow_from_certificates(tmp_path: Path, stated: Property, implied: set[str]) -> None:
    counts = Counter[bool]()
    for seed in range(SEEDS):
        root = asked(seed, tmp_path / str(seed)).root
        try:
            checker, keystore = Checker(root, stated, EVERY), reading().keystore(root)
        except CannotTell:
            continue
        systems = stated_systems(keystore, reading().profiles, AT, reading().accesses(keystore), None, ())
        engine = NativeEngine(systems)
        for system, answers in zip(systems, engine.answers, strict=True):
            convinced = _holding(checker.implementation(system.profiles[0]))["convinced"] > 0
            assert not convinced or {answers[each].status for each in implied} == {Status.HOLDS}, seed
            counts[convinced] += 1
    assert counts[True] >= SEEDS // 5


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        first, last = map(int, sys.argv[1:3])
        rights = sys.argv[3:] == ["rights"]
        seeds = range(first, last)
        print(sum((one_seed(seed, Path(folder) / str(seed), rights=rights) for seed in seeds), Counter[str]()))
