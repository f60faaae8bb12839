"""Both engines are given what an independent reader finds, on every sample and on random stores."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit import toml
from keystore_audit.keystore.governance import ProtectionKind
from keystore_audit.model.formal.system import System
from tests.amount import tried
from tests.conftest import libcrypto
from tests.second_reader.asked import Asked, ask
from tests.second_reader.check import check, check_seed
from tests.second_reader.comparison import compare
from tests.second_reader.given import differences
from tests.second_reader.implementations import IMPLEMENTATIONS
from tests.second_reader.listing import Listing
from tests.second_reader.material import AT, identities
from tests.second_reader.stores import store
from tests.test_samples import EXPECTATIONS, name

READER = ("openssl", "walk", "documents", "implementations", "listing", "given", "comparison")
"""The modules of the second reader; the others make stores and ask keystore_audit."""

SLICE = tried(100, 50)
SLICES = tried(3)

DIFFERING = {
    # OpenSSL refuses a certificate with a critical extension that it does not know; whoever has it counts as let in all
    # the same, and what is told of usability says otherwise (KA221).
    "rules/KA221-unknown-critical-extension/bad": "lets in CN=/talker",
}
"""Samples about which the readers differ, and what every difference says."""

_seen: Counter[str] = Counter()


@pytest.fixture(autouse=True, scope="module")
def _openssl() -> None:
    libcrypto()


def test_the_second_reader_shares_no_code_with_the_first() -> None:
    modules = ", ".join(f"tests.second_reader.{module}" for module in READER)
    program = f"import sys, {modules}; print(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "tests" in loaded
    assert loaded.isdisjoint({"keystore_audit", "cryptography", "lxml"})


@pytest.mark.parametrize("part", range(4))
def test_every_sample_is_read_alike(part: int) -> None:
    seen: Counter[str] = Counter()
    for description in EXPECTATIONS[part::4]:
        at = datetime.fromisoformat(toml.loads(description.read_text())["at"].replace("Z", "+00:00"))
        found = check(description.with_suffix(""), at, tuple(IMPLEMENTATIONS), seen) or []
        expected = DIFFERING.get(name(description))
        assert bool(found) is (expected is not None), (name(description), found[:3])
        assert all(expected is not None and expected in each for each in found), found[:3]
    assert seen["document"] > 1_000
    assert seen["channel"] > 1_000
    assert seen["enclave"] > 20 * seen["opaque enclave"]


@pytest.mark.slow
@pytest.mark.parametrize("part", range(SLICES))
def test_random_stores_are_read_alike(part: int, tmp_path: Path) -> None:
    """Of fixed seeds, as many as are tried."""
    seen: Counter[str] = Counter()
    for seed in range(part * SLICE, (part + 1) * SLICE):
        assert check_seed(seed, tmp_path, seen) == [], f"seed {seed}"
    assert {"store: cross certificate", "store: several identity CAs", "store: unmanaged permissions"} <= seen.keys()
    for what in ("unmanaged identity", "unmanaged document", "rule", "identity under a trust domain", "further name"):
        assert seen[what] > SLICE / 2, what
    assert seen["given, and not as the files are"] < seen["document under a trust domain"] / 20


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Listing, Asked]]:
    """Stores as both readers have them."""
    found = []
    for seed in range(24):
        made = store(seed)
        asked = ask(made.write(tmp_path_factory.mktemp("store")), AT, ("spec", "fastdds-2.9"))
        if asked is not None and not made.may_be_unknown:
            found.append((Listing(Path(asked.keystore.root)), asked))
    return found


def _changed(several: tuple[Any, ...], number: int, **how: Any) -> tuple[Any, ...]:
    return (*several[:number], replace(several[number], **how), *several[number + 1 :])


def _issued(system: System) -> System:
    """Without what issued an enclave's identity."""
    number = next(e.identity for e in system.enclaves if e.identity is not None and not e.unmanaged)
    return replace(system, certificates=_changed(system.certificates, number, issuers=frozenset()))


def _key(system: System) -> System:
    other = system.certificates[1].key
    return replace(
        system, certificates=_changed(system.certificates, 0, key=other + (system.certificates[0].key == other))
    )


def _authority(system: System) -> System:
    return replace(
        system, certificates=_changed(system.certificates, 0, authority=not system.certificates[0].authority)
    )


def _fit(system: System) -> System:
    return replace(
        system, certificates=_changed(system.certificates, 0, fit_to_sign=not system.certificates[0].fit_to_sign)
    )


def _expiry(system: System) -> System:
    return replace(system, certificates=_changed(system.certificates, 0, not_after=system.certificates[0].not_before))


def _anchor(role: str) -> Callable[[System], System]:
    return lambda system: replace(system, trust_domains=_changed(system.trust_domains, 0, **{role: frozenset()}))


def _signer(system: System) -> System:
    number = next(n for n, each in enumerate(system.documents) if each.intact)
    return replace(system, documents=_changed(system.documents, number, signers=frozenset(), intact=False))


def _accepted(system: System) -> System:
    """With the permissions CA as the signer of a document that somebody else signed."""
    ca = system.trust_domains[0].permissions_ca
    number = next(n for n, each in enumerate(system.documents) if not each.signers <= ca)
    return replace(system, documents=_changed(system.documents, number, signers=frozenset({min(ca)})))


def _without_unmanaged(system: System) -> System:
    return replace(system, enclaves=tuple(each for each in system.enclaves if not each.unmanaged))


def _without_enclave(system: System) -> System:
    return replace(system, enclaves=system.enclaves[1:])


def _without_stray(system: System) -> System:
    """Documents are numbers: an unmanaged one is put out of reach by being another one's copy."""
    carried = {e.permissions for e in system.enclaves} | {r.governance for r in system.trust_domains}
    number = next(n for n, _each in enumerate(system.documents) if n not in carried)
    other = next(n for n in carried if n is not None)
    return replace(system, documents=_changed(system.documents, number, label=system.documents[other].label))


def _identity(system: System) -> System:
    own = [e.identity for e in system.enclaves]
    other = next(n for n, _c in enumerate(system.certificates) if n not in own)
    return replace(system, enclaves=_changed(system.enclaves, 0, identity=other))


def _default(system: System) -> System:
    return replace(system, grants=_changed(system.grants, 0, default_allow=not system.grants[0].default_allow))


def _named(system: System) -> System:
    return replace(system, grants=_changed(system.grants, 0, names=system.grants[0].names ^ {0}))


def _grant_date(system: System) -> System:
    return replace(system, grants=_changed(system.grants, 0, not_after=system.now))


def _grant_order(system: System) -> System:
    pairs = enumerate(zip(system.grants, system.grants[1:], strict=False))
    n = next(n for n, (a, b) in pairs if a.document == b.document and a.subject != b.subject)
    swapped = (*system.grants[:n], system.grants[n + 1], system.grants[n], *system.grants[n + 2 :])
    return replace(system, grants=swapped)


def _rule_order(system: System) -> System:
    pairs = enumerate(zip(system.rules, system.rules[1:], strict=False))
    n = next(n for n, (a, b) in pairs if a.grant == b.grant and a.allow is not b.allow)
    return replace(system, rules=(*system.rules[:n], system.rules[n + 1], system.rules[n], *system.rules[n + 2 :]))


def _rule_topics(system: System) -> System:
    n = next(n for n, each in enumerate(system.rules) if each.publish and each.domains)
    return replace(system, rules=_changed(system.rules, n, publish=frozenset()))


def _rule_domains(system: System) -> System:
    return replace(system, rules=tuple(replace(each, domains=frozenset()) for each in system.rules))


def _kind(system: System) -> System:
    n = next(r.governance for r in system.trust_domains if r.governance is not None)
    m = next(m for m, each in enumerate(system.domain_rules) if each.document == n)
    kind = system.domain_rules[m].rtps_protection_kind
    other = next(each for each in ProtectionKind if each is not kind)
    return replace(system, domain_rules=_changed(system.domain_rules, m, rtps_protection_kind=other))


def _flag(system: System) -> System:
    flag = system.topic_rules[0].enable_write_access_control
    return replace(system, topic_rules=_changed(system.topic_rules, 0, enable_write_access_control=not flag))


def _join(system: System) -> System:
    flag = system.domain_rules[0].enable_join_access_control
    return replace(system, domain_rules=_changed(system.domain_rules, 0, enable_join_access_control=not flag))


def _channel(system: System) -> System:
    """Names that no expression names stand for all others."""
    plain = tuple(each._replace(topic="nowhere") for each in system.channels)
    return replace(system, channels=plain)


_CHANGES = (
    *(_issued, _key, _authority, _fit, _expiry, _anchor("identity_ca"), _anchor("permissions_ca"), _signer, _accepted),
    *(_without_unmanaged, _without_enclave, _without_stray, _identity, _default, _named, _grant_date, _grant_order),
    *(_rule_order, _rule_topics, _rule_domains, _kind, _flag, _join, _channel),
)


@pytest.mark.parametrize("change", _CHANGES)
def test_each_changed_fact_is_a_difference(
    read: list[tuple[Listing, Asked]], change: Callable[[System], System]
) -> None:
    """Under both ways to look for signers; some stores have nothing to change, or what is changed is in no use."""
    told: set[bool] = set()
    for listing, asked in read:
        for system in asked.systems:
            try:
                changed = change(system)
            except (StopIteration, ValueError, IndexError):
                continue
            if changed != system and compare(listing, [changed], asked.certificates, AT, Counter()):
                told.add(system.pins_signer)
    assert told == {True, False}


def test_the_text_for_alloy_is_compared_line_by_line(read: list[tuple[Listing, Asked]]) -> None:
    _listing, asked = read[0]
    system, text = asked.systems[0], asked.texts[0]
    assert differences(system, text) == []
    lines = [line for line in text.split("\n") if line.startswith("fun ") and line.endswith("}") and "none" not in line]
    assert len(lines) > 10
    for line in lines:
        head, _brace, _body = line.partition("{")
        assert differences(system, text.replace(line, f"{head}{{ none }}")) != [], line


def test_pools_hold_what_the_issue_names() -> None:
    kinds = set(identities()["/a"])
    assert {"by permissions", "another subject", "expired", "identity again", "twin", "self"} <= kinds
