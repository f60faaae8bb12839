"""Of a single trust domain, functions are called without arguments, and nothing is answered otherwise."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.facts import MODULES, module_texts, with_one_trust_domain
from keystore_audit.model.formal.system import System
from tests.amount import tried
from tests.engine.alloy_batch import as_expected, asking, outcomes, shipped, unlike, values, whole_world
from tests.engine.systems import lively, random_system, with_claims

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

SYSTEMS = tried(12, 4)
"""Random systems of one trust domain; the seeds are fixed."""


def dependent() -> dict[str, str]:
    """Every function of trust domains alone in the modules that are asked, with its arguments."""
    texts = module_texts((*MODULES, *claims.MODULES)).values()
    heads = re.findall(r"^fun (\w+)\[(trust_domain|sending, receiving): TrustDomain\]", "\n".join(texts), re.MULTILINE)
    return {name: ", ".join("TrustDomain" for _ in trust_domains.split(", ")) for name, trust_domains in heads}


def of_one_trust_domain(seed: int) -> System:
    system = with_claims(lively(random_system(seed), seed), seed, count=6)
    return replace(
        system,
        trust_domains=system.trust_domains[:1],
        enclaves=tuple(replace(enclave, trust_domain=0) for enclave in system.enclaves),
    )


def test_every_function_of_trust_domains_alone_is_worked_out_once() -> None:
    once = with_one_trust_domain(module_texts((*MODULES, *claims.MODULES)))
    assert len(dependent()) > 25
    assert set(re.findall(r"^fun only_(\w+): ", "\n".join(once.values()), re.MULTILINE)) == set(dependent())


def test_what_is_worked_out_once_is_the_same(tmp_path: Path) -> None:
    modules = shipped()
    full = 0
    for seed in range(SYSTEMS):
        system = of_one_trust_domain(seed)
        asked = asking(system)
        once = with_one_trust_domain(modules)
        assert as_expected(whole_world(tmp_path, once, system), outcomes(tmp_path, modules | asked)), seed
        expressions = [f"{name}[{trust_domains}]" for name, trust_domains in dependent().items()]
        expected = dict(zip(expressions, values(tmp_path, modules | asked, expressions), strict=True))
        assert unlike(tmp_path, once | asked, expected) == [], seed
        full += sum(map(bool, expected.values()))
        if seed == 0:
            turned = next(each for each, tuples in expected.items() if tuples)
            expected[turned].pop()
            assert unlike(tmp_path, once | asked, expected) == [turned]
    assert full > SYSTEMS * 10
