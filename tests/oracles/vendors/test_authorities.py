"""Whom real participants let in by what stands in their CA files: what `unexpected-authority` is high for."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.engines import Engines
from keystore_audit.findings import Severity
from keystore_audit.flow import FlowQuestion, find_flow
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.profiles import resolve
from keystore_audit.properties.result import Status
from tests.keystore.builder import authority, certificate
from tests.oracles.vendors.pairs import Pairs
from tests.oracles.vendors.pairs_case import CAS, KEYSTORE, PLAIN_FIRST, PLAIN_SECOND, Case, outcome
from tests.oracles.vendors.pairs_material import EVERYTHING, Authorities, Enclave, governance, grant, permissions

pytestmark = pytest.mark.xdist_group("vendors-pairs")  # the programs are compiled once

STRANGERS = Authorities(identity=authority("their identity CA"), permissions=authority("their permissions CA"))
BOTH = {
    "identity_ca": CAS.identity.pem + STRANGERS.identity.pem,
    "permissions_ca": CAS.permissions.pem + STRANGERS.permissions.pem,
}
STRANGER = Enclave(
    authorities=STRANGERS,
    identity=STRANGERS.issue("/second"),
    governance=STRANGERS.sign(governance()),
    permissions=STRANGERS.sign(permissions(grant("CN=/second", EVERYTHING))),
    **BOTH,
)
"""A participant that nobody here issued anything to; with CA files like its victim's, since it accepts that one."""

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
ENCLAVE = certificate("/third", CAS.identity, ca=True)
ISSUED_BY_ENCLAVE = replace(
    PLAIN_SECOND, identity=certificate("/second", ENCLAVE), identity_ca=CAS.identity.pem + ENCLAVE.pem
)
ALONE = certificate("/second")
WITH_ALONE = CAS.identity.pem + ALONE.pem
STANDING_ALONE = replace(PLAIN_SECOND, identity=ALONE, identity_ca=WITH_ALONE)

CASES = {
    "appended": (Case(title="", first=replace(PLAIN_FIRST, **BOTH), second=STRANGER), "++"),
    "not appended": (Case(title="", second=STRANGER), ".."),
    "issued by an enclave with CA:TRUE": (Case(title="", second=ISSUED_BY_ENCLAVE), ".."),
    "self-signed, in the peer's file": (
        Case(title="", first=replace(PLAIN_FIRST, identity_ca=WITH_ALONE), second=STANDING_ALONE),
        "++",
    ),
    "self-signed, in its own file alone": (Case(title="", second=STANDING_ALONE), ".."),
}


@pytest.mark.parametrize("title", CASES)
def test_fast_dds_lets_in_whom_its_ca_files_let_in(title: str, vendors: dict[str, Pairs], tmp_path: Path) -> None:
    case, expected = CASES[title]
    meeting = vendors["fastdds"].meet_as(*case.sides(tmp_path), lambda seen: outcome(seen, case) == expected)
    assert outcome(meeting, case) == expected


# Cyclone DDS reads the first certificate of a CA file alone: each of these starts with its own.
STRANGERS_OWN = replace(STRANGER, identity_ca=STRANGERS.identity.pem, permissions_ca=STRANGERS.permissions.pem)
ENCLAVES_OWN = replace(ISSUED_BY_ENCLAVE, identity_ca=certificate("/third", key=ENCLAVE.key, ca=True).pem)
ALONES_OWN = replace(STANDING_ALONE, identity_ca=ALONE.pem)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (replace(PLAIN_FIRST, **BOTH), STRANGERS_OWN),
        (PLAIN_FIRST, ENCLAVES_OWN),
        (replace(PLAIN_FIRST, identity_ca=WITH_ALONE), ALONES_OWN),
    ],
    ids=["appended", "issued by an enclave with CA:TRUE", "self-signed, in the peer's file"],
)
def test_cyclone_dds_refuses_them_all(
    first: Enclave, second: Enclave, vendors: dict[str, Pairs], tmp_path: Path
) -> None:
    case = Case(title="", first=first, second=second)
    meeting = vendors["cyclone"].meet(*case.sides(tmp_path))
    assert outcome(meeting, case) == ".."
    assert "Certificate not valid" in meeting.complaints[0], "the victim refuses"


@pytest.mark.parametrize("title", ["self-signed, in the peer's file", "self-signed, in its own file alone"])
def test_whom_fast_dds_lets_in_is_a_participant(title: str, tmp_path: Path) -> None:
    """Whatever its own CA file says, which whoever has its key leaves at home."""
    case, measured = CASES[title]
    assert case.second is not None
    own = replace(case.second, identity_ca=None)  # CAS's alone
    replace(case, second=own).sides(tmp_path)
    question = FlowQuestion(source="/second", target="/first", attackers=(Attacker.SOURCE,))
    found = find_flow(
        tmp_path / KEYSTORE,
        question,
        Circumstances(profiles=resolve(("fastdds-2.9",)), at=AT),
        engines=Engines(choice="native", jar=None, offline=True, timeout=60),
    )
    assert (found.status is Status.HOLDS) is (measured == "..")


@pytest.mark.parametrize(
    ("first", "expected"),
    [(replace(PLAIN_FIRST, **BOTH), {Severity.HIGH}), (PLAIN_FIRST, set())],
    ids=["appended", "not"],
)
def test_what_lets_strangers_in_is_high(first: Enclave, expected: set[Severity], tmp_path: Path) -> None:
    first.write(tmp_path / "enclaves/first")
    report = audit(str(tmp_path), Options(at=AT, engine="native"))
    assert {each.severity for each in report.findings if each.code == "KA223"} == expected
