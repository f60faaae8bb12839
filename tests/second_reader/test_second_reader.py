"""Both engines are given what an independent reader finds, on every sample and on random stores."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit import toml
from keystore_audit.keystore.typed import ProtectionKind
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

OUT_OF_FORM = frozenset({"rules/KA501-permissions-schema-invalid/bad", "rules/KA502-permissions-ambiguous/bad"})
"""Samples whose documents each implementation reads in its own way: this reader knows the plain form alone."""

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
        if name(description) in OUT_OF_FORM:
            continue
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


Change = Callable[[System], System]


def _first(
    where: str,
    which: Callable[[System, int, Any], bool] = lambda _s, _n, _each: True,
    **new: Callable[[System, Any], Any],
) -> Change:
    """The first of `where` that is one of `which`, with other values of some fields."""

    def change(system: System) -> System:
        several = getattr(system, where)
        n, found = next((n, each) for n, each in enumerate(several) if which(system, n, each))
        other = replace(found, **{field: value(system, found) for field, value in new.items()})
        return replace(system, **{where: (*several[:n], other, *several[n + 1 :])})

    return change


def _not(field: str) -> dict[str, Callable[[System, Any], bool]]:
    return {field: lambda _system, each: not getattr(each, field)}


def _swapped(where: str, which: Callable[[Any, Any], bool]) -> Change:
    """The first two neighbours of `where` that are so, in the other order."""

    def change(system: System) -> System:
        several = getattr(system, where)
        n = next(n for n, pair in enumerate(pairwise(several)) if which(*pair))
        return replace(system, **{where: (*several[:n], several[n + 1], several[n], *several[n + 2 :])})

    return change


def _without(where: str, which: Callable[[int, Any], bool]) -> Change:
    return lambda s: replace(
        s, **{where: tuple(each for n, each in enumerate(getattr(s, where)) if not which(n, each))}
    )


def _nothing(_system: System, _each: object) -> frozenset[int]:
    return frozenset()


def _carried(system: System) -> list[int | None]:
    return [*(e.document for e in system.enclaves), *(r.governance for r in system.trust_domains)]


def _governed(system: System) -> int | None:
    return next((r.governance for r in system.trust_domains if r.governance is not None), None)


CHANGES: dict[str, Change] = {
    "nobody issued an identity": _first(
        "certificates",
        lambda s, n, _c: n in {e.identity for e in s.enclaves if not e.unmanaged},
        issuers=_nothing,
    ),
    "another key": _first("certificates", key=lambda s, c: s.certificates[1].key + (c.key == s.certificates[1].key)),
    "an authority or not": _first("certificates", **_not("authority")),
    "fit to sign or not": _first("certificates", **_not("fit_to_sign")),
    "it ends as it begins": _first("certificates", not_after=lambda _s, c: c.not_before),
    "no identity CA": _first("trust_domains", identity_ca=_nothing),
    "no permissions CA": _first("trust_domains", permissions_ca=_nothing),
    "nobody signed": _first("documents", lambda _s, _n, d: d.intact, signers=_nothing, intact=lambda _s, _d: False),
    "signed by the permissions CA, and was by somebody else": _first(
        "documents",
        lambda s, _n, d: not d.signers <= s.trust_domains[0].permissions_ca,
        signers=lambda s, _d: frozenset({min(s.trust_domains[0].permissions_ca)}),
    ),
    "nobody unmanaged": _without("enclaves", lambda _n, each: each.unmanaged),
    "an enclave less": _without("enclaves", lambda n, _each: n == 0),
    # Documents are numbers: an unmanaged one is put out of reach by being another one's copy.
    "an unmanaged document less": _first(
        "documents",
        lambda s, n, _d: n not in _carried(s),
        label=lambda s, _d: s.documents[next(n for n in _carried(s) if n is not None)].label,
    ),
    "another identity": _first(
        "enclaves",
        identity=lambda s, _e: next(
            n for n, _c in enumerate(s.certificates) if n not in {e.identity for e in s.enclaves}
        ),
    ),
    "another default": _first("grants", **_not("default_allow")),
    "another subject": _first("grants", names=lambda _s, g: g.names ^ {0}),
    "a grant ends now": _first("grants", not_after=lambda s, _g: s.now),
    "grants in another order": _swapped("grants", lambda a, b: a.document == b.document and a.subject != b.subject),
    "rules in another order": _swapped("rules", lambda a, b: a.grant == b.grant and a.allow is not b.allow),
    "a rule about no topic": _first("rules", lambda _s, _n, r: r.publish and r.domains, publish=_nothing),
    "rules of no domain": lambda s: replace(s, rules=tuple(replace(each, domains=frozenset()) for each in s.rules)),
    "another kind of protection": _first(
        "domain_rules",
        lambda s, _n, r: r.document == _governed(s),
        rtps_protection_kind=lambda _s, r: next(each for each in ProtectionKind if each is not r.rtps_protection_kind),
    ),
    "access control of writers or not": _first("topic_rules", **_not("enable_write_access_control")),
    "access control of participants or not": _first("domain_rules", **_not("enable_join_access_control")),
    # Names that no expression names stand for all others.
    "channels of another topic": lambda s: replace(s, channels=tuple(c._replace(topic="nowhere") for c in s.channels)),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_each_changed_fact_is_a_difference(read: list[tuple[Listing, Asked]], change: Change) -> None:
    """Under both ways to look for signers; some stores have nothing to change, or what is changed is in no use."""
    told: set[bool] = set()
    for listing, asked in read:
        for system in asked.systems:
            try:
                changed = change(system)
            except (StopIteration, ValueError, IndexError):
                continue
            if changed != system and compare(listing, [changed], asked.certificates, AT, Counter()):
                told.add(system.readings[0].pins_signer)
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
