"""A process of Fast DDS and one of Cyclone DDS: each judges the other by its own reading, as in our mixed fleets.

They meet where Cyclone DDS opens the handshake, as the second process. The other way about Fast DDS 2.9.1 proposes a
key agreement that Cyclone DDS 0.10.2 does not know: no claim of ability holds between implementations of two kinds.
"""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.assumptions import EVERY
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.inventory import system_documents
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import VARIANTS, fleets
from tests.keystore.documents import allow, pubsub
from tests.oracles.vendors.enclave import publish, subscribe
from tests.oracles.vendors.ours import PROFILES
from tests.oracles.vendors.pairs import Pairs
from tests.oracles.vendors.pairs_case import CAS, KEYSTORE, PLAIN_FIRST, Case, outcome
from tests.oracles.vendors.pairs_material import EVERY_DOMAIN, grant, permissions

pytestmark = pytest.mark.xdist_group("vendors-pairs")  # the programs are compiled once

NOT_X = allow(pubsub("[^x]b"), domains=EVERY_DOMAIN)
"""Anything but x before b to Fast DDS; x, or ^, to Cyclone DDS."""

ENDPOINTS = (publish("ab"), subscribe("ab"), publish("xb"), subscribe("xb"))


def signed(name: str, *rules: str, default: str = "DENY") -> bytes:
    return CAS.sign(permissions(grant(f"CN=/{name}", *rules, default=default)))


CASES = {
    # Whose implementations: first, second; what either side does at the second one's endpoints, as `outcome` has it.
    Case(title="by expression", presented=signed("second", NOT_X), endpoints=ENDPOINTS): {
        ("fastdds", "cyclone"): "++..",
        ("fastdds", "fastdds"): "++..",
        ("cyclone", "cyclone"): "..++",
    },
    Case(title="by default", presented=signed("second", default="ALLOW"), endpoints=ENDPOINTS): {
        ("fastdds", "cyclone"): "....",
        ("fastdds", "fastdds"): "....",
        ("cyclone", "cyclone"): "++++",
    },
    Case(
        title="the second judges", first=replace(PLAIN_FIRST, permissions=signed("first", NOT_X)), endpoints=ENDPOINTS
    ): {
        ("fastdds", "cyclone"): "..==",
        ("fastdds", "fastdds"): "++==",
        ("cyclone", "cyclone"): "==++",
    },
}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.title)
def test_each_side_judges_by_its_own_implementation(case: Case, vendors: dict[str, Pairs], tmp_path: Path) -> None:
    for (first, second), expected in CASES[case].items():
        pair = vendors[first].beside(vendors[second])
        place = tmp_path / f"{first}-{second}"
        meeting = pair.meet_as(*case.sides(place), lambda found, wanted=expected: outcome(found, case) == wanted)
        assert outcome(meeting, case) == expected, (first, second)
        assert accepted(case, place / KEYSTORE, first, second) == tuple(
            letter == "+" for letter in expected if letter != "="
        ), (first, second)


def accepted(case: Case, keystore: Path, first: str, second: str) -> tuple[bool, ...]:
    """Of each endpoint of whom the other judges, whether that one takes it by our model."""
    [fleet] = fleets((VARIANTS[PROFILES[first]],), {"/second": (PROFILES[second],)})
    read, at = read_keystore(keystore), datetime.now(timezone.utc)
    accesses = AccessViews(system_documents(read), at, None, EVERY)
    names = list(dict.fromkeys((each.topic, "") for each in case.endpoints))
    builder = SystemBuilder(read, (fleet,), at, accesses, names)
    system = builder.systems()[0]
    number = {enclave.label: n for n, enclave in enumerate(system.enclaves)}
    judged, judge = ("/second", "/first") if case.presented is not None else ("/first", "/second")
    view = trust_domain_views(system)[system.enclaves[number[judge]].trust_domain]
    able = view.abilities(number[judged])
    found = []
    for endpoint in case.endpoints:
        if case.presented is None and (endpoint.topic == "ab") == (first == "cyclone"):
            continue  # its own implementation does not make it
        publishes = (endpoint.operation is Operation.PUBLISH) == (case.presented is not None)
        channel = builder.channels.of_point(0, names.index((endpoint.topic, "")))
        found.append(bool((able.may_write if publishes else able.may_read) >> channel & 1))
    return tuple(found)


def test_fast_dds_opens_no_handshake_that_cyclone_dds_takes(vendors: dict[str, Pairs], tmp_path: Path) -> None:
    case = Case(title="the other way about")
    for first, second, met in (("fastdds", "cyclone", True), ("cyclone", "fastdds", False)):
        sides = case.sides(tmp_path / first)
        assert vendors[first].beside(vendors[second]).meet_as(*sides, lambda found, so=met: found.met is so).met is met
