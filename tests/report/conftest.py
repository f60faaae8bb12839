"""Reports built by hand: one that says everything that a report can say, with names of the test's choosing."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timezone

import pytest
from msgspec.structs import replace

from keystore_audit.assumptions import Assumption, Needed
from keystore_audit.findings import (
    Finding,
    Location,
    Outcomes,
    Result,
    Row,
    Severity,
    Suppressed,
    decision,
    fingerprint,
)
from keystore_audit.model.question import Usability
from keystore_audit.properties import BY_ID, Status
from keystore_audit.properties.result import (
    Counterexample,
    EngineRun,
    EngineStatus,
    ProfileResult,
    PropertyResult,
    Step,
)
from keystore_audit.report.content import Anchor, Anchors, Checked, EnclaveEntry, Report, Verdict
from keystore_audit.truth import Truth

PROFILES = ("spec", "fastdds-2.6", "cyclonedds-0.10")
CAN_START = Usability(usable=Truth.YES, reasons=())

ReportMaker = Callable[..., Report]
"""`name`: used wherever a keystore's author chooses the text. The rest: fields of Report to replace."""


def _finding(code: str, name: str, severity: Severity, enclave: str | None, path: str, **more: object) -> Finding:
    key = path.encode("utf-8", "backslashreplace").decode()
    finding = Finding(
        code=code,
        name=name,
        severity=severity,
        message="",
        fix=decision("Do something."),
        clause="DDS-Security 1.1, 9.4.1.1",
        enclave=enclave,
        locations=(Location(path=path, line=1),),
        fingerprint=fingerprint(code, None, key, ""),
        meaning=fingerprint(code, None, key, "what it is about"),
    )
    return replace(finding, **more)  # type: ignore[arg-type]


def _findings(name: str) -> tuple[Finding, ...]:
    document = f"enclaves/{name}/permissions.p7s"
    signed = _finding(
        "KA302",
        "signed-by-an-identity",
        Severity.CRITICAL,
        f"/{name}",
        document,
        message=f"permissions.p7s is signed by the identity CN=/{name}, not by the permissions CA "
        "CN=permissionsCA. fastdds-2.6 refuses it, cyclonedds-0.10 accepts it.",
        fix=decision("Sign the document again with the key of the permissions CA."),
        locations=(Location(path=document, line=41, message="the signature"), Location(path=document)),
        profiles=("cyclonedds-0.10",),
    )
    grants_itself = _finding(
        "KA705",
        "no-enclave-grants-itself-rights",
        Severity.HIGH,
        f"/{name}",
        document,
        message=f"/{name} signs itself permissions.",
        fix=decision("Use a separate permissions CA."),
        explained_by=(signed.fingerprint,),
        profiles=("cyclonedds-0.10",),
    )
    expires = _finding(
        "KA205",
        "certificate-expires-soon",
        Severity.MEDIUM,
        "/listener",
        "enclaves/listener/cert.pem",
        message="The identity certificate of /listener expires at 2025-06-20T00:00:00Z, 19 days after the audit.",
        fix=decision("Issue the identity again."),
        clause="DDS-Security 1.1, 9.3.1; RFC 5280, 4.1.2.5",
    )
    ca_key = _finding(
        "KA109",
        "ca-private-key-in-tree",
        Severity.INFO,
        None,
        "private/ca.key.pem",
        message="The private key of the CA CN=sros2CA is in the tree.",
        fix=decision("Leave it out of what goes on a robot."),
        locations=tuple(Location(path=f"private/ca{number}.key.pem") for number in range(8)),
    )
    accepted = _finding(
        "KA420",
        "domain-above-230",
        Severity.MEDIUM,
        None,
        "enclaves/governance.p7s",
        message="The governance names domain 231.",
        suppressed=Suppressed(reason="no Cyclone", until="2026-01-01", owner="me", source="baseline.json"),
    )
    return (signed, grants_itself, expires, accepted, ca_key)


def _answer(status: Status, counterexample: Counterexample | None = None) -> ProfileResult:
    return ProfileResult(status=status, engines={"alloy": status, "native": status}, counterexample=counterexample)


def _needs(profile: str) -> tuple[Assumption, ...]:
    return (Assumption.TRUTHFUL_ANNOUNCEMENTS,) if profile.startswith("cyclonedds") else ()


def _properties(name: str) -> tuple[PropertyResult, ...]:
    step = Step(
        enclave=f"/{name}",
        channel=f"domain 0, topic rt/{name}",
        witness=f"rt/{name}",
        path=f"enclaves/{name}/permissions.p7s",
        line=41,
    )
    counterexample = Counterexample(text=f"/{name} can sign a document for itself.", steps=(step,))
    self_grant = {profile: _answer(Status.HOLDS) for profile in PROFILES}
    self_grant["cyclonedds-0.10"] = _answer(Status.VIOLATED, counterexample)
    return (
        PropertyResult(
            prop=BY_ID["documents-signed-by-the-permissions-ca"],
            profiles={profile: replace(_answer(Status.HOLDS), needs=_needs(profile)) for profile in PROFILES},
        ),
        PropertyResult(prop=BY_ID["no-enclave-grants-itself-rights"], profiles=self_grant),
    )


AUTHORITIES = tuple(
    Anchors(role=role, declared=(), here=(Anchor(subject="CN=CA", path="public/ca.cert.pem", sha256=sha, key=key),))
    for role, sha, key in (("identity", "a" * 64, "b" * 64), ("permissions", "c" * 64, "d" * 64))
)


def _full(name: str) -> Report:
    refused = Usability(usable=Truth.NO, reasons=("permissions.p7s is signed by no permissions CA",))
    return Report(
        version="0.1.0",
        keystore=f"./keys/{name}",
        layout="sros2",
        digest="0" * 64,
        at=datetime(2025, 6, 1, tzinfo=timezone.utc),
        safe_until=datetime(2025, 6, 20, tzinfo=timezone.utc),
        safe_until_why="the identity certificate of /listener expires",
        verdict=Verdict.FAIL,
        exit_code=1,
        fail_on=Severity.HIGH,
        weakened=("--at 2025-06-01T00:00:00Z",),
        assumptions=(
            Needed(
                assumption=Assumption.TRUTHFUL_ANNOUNCEMENTS,
                needed_by=("documents-signed-by-the-permissions-ca",),
                unchecked=("Cyclone DDS",),
            ),
            Needed(assumption=Assumption.ROBOTS_ENFORCE),
        ),
        stated=("Robots are in the time zone Europe/Berlin.",),
        engines=(
            EngineRun(name="alloy", version="6.2.0", status=EngineStatus.OK, reason="", required=True),
            EngineRun(name="native", version=None, status=EngineStatus.OK, reason="", required=True),
        ),
        engines_agree=True,
        enclaves=(
            EnclaveEntry(
                path="/listener",
                directory="enclaves/listener",
                subject="CN=/listener",
                profiles=dict.fromkeys(PROFILES, CAN_START),
            ),
            EnclaveEntry(
                path=f"/{name}",
                directory=f"enclaves/{name}",
                subject=f"CN=/{name}",
                profiles={"spec": refused, "fastdds-2.6": refused, "cyclonedds-0.10": CAN_START},
            ),
        ),
        properties=_properties(name),
        findings=_findings(name),
        authorities=AUTHORITIES,
        outcomes=Outcomes(
            rows=(
                Row(
                    "KA205",
                    ("enclaves/listener/cert.pem", f"enclaves/{name}/cert.pem"),
                    ((Result.FAIL, 1), (Result.PASS, 1)),
                ),
                Row("KA302", (f"enclaves/{name}/permissions.p7s",), ((Result.FAIL, 1),)),
            )
        ),
        scope="DDS-Security 1.1, Fast DDS 2.6 (Humble), Cyclone DDS 0.10 (Humble, Jazzy, Kilted)",
        checked=Checked(certificates=4, documents=3, channels=17, rules=72, not_checked=("Timing.", "The nodes.")),
    )


@pytest.fixture(scope="session")
def make_report() -> ReportMaker:
    def make(name: str = "talker", **changes: object) -> Report:
        return replace(_full(name), **changes)  # type: ignore[arg-type]

    return make
