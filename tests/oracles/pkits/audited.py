"""What the auditor says of one identity, from reading its files to the findings of KA2."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from msgspec import Struct

from keystore_audit.findings import Result, Severity
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import VARIANTS
from keystore_audit.rules import RULES
from keystore_audit.rules.judge import judge
from keystore_audit.rules.registry import Context
from tests.oracles.pkits.paths import CALLERS, Paths
from tests.oracles.pkits.suite import pem

REFUSALS = frozenset({"denied", "unusable"})

VENDORS = {"Fast DDS": "fastdds", "Cyclone DDS": "cyclonedds", "OpenDDS": "opendds"}

NO_PARTICIPANT = frozenset({"unusable", "unloaded", "open"})
"""What `objections` says of an enclave of which nothing may be proven that needs its participant."""

_ABSENT = tuple(f"{role.value}: " for role in Role)
"""How reasons begin that are about files that these keystores do not have."""

_LOADING = ("it does not load ", "it loads no CA ")
"""How reasons begin of Fast DDS's look at the first certificate of the file, beside X509_verify_cert of the identity.
"""


def objections(
    directory: Path, at: datetime, authorities: Sequence[bytes], leaf: bytes, *crls: bytes
) -> dict[str, frozenset[str]]:
    """Why the auditor would not call the identity accepted by a vendor's implementations at `at`; empty: it would.

    `denied`: peers refuse it even in the MAY reading. `doubted`: in the MUST reading alone. `unusable`: no participant
    is created, for reasons of the identity; `unloaded`: since the CA file is not loaded. A code: a finding of KA2 that
    fails the default gate. `open`: a question of KA2 that was left open. What is in `REFUSALS` says that
    implementations refuse the identity.
    """
    enclave = directory / "enclaves" / "e"
    enclave.mkdir(parents=True)
    (enclave / "identity_ca.cert.pem").write_bytes(pem("CERTIFICATE", *authorities))
    (enclave / "cert.pem").write_bytes(pem("CERTIFICATE", leaf))
    if crls:
        (enclave / "crl.pem").write_bytes(pem("X509 CRL", *crls))
    keystore = read_keystore(directory)
    profiles = tuple(VARIANTS.values())
    accesses = AccessViews(documents_of(keystore), at, None)
    meaning = interpret(keystore, profiles, at, accesses, Usabilities(None, accesses))
    context = Context(
        keystore=keystore,
        meaning=meaning,
        accesses=accesses,
        results=(),
        engines=(),
        at=at,
        expires_within=timedelta(0),
        deployed=False,
        profiles=profiles,
        fleets=profiles,
    )
    # That nobody declared the authorities of a file with several is no matter of the identity (KA223).
    judgement = judge(context, RULES, select=("KA2",), ignore=("KA223",))
    found: dict[str, frozenset[str]] = {}
    for vendor, prefix in VENDORS.items():
        variants = {profile.name for profile in profiles if profile.name.startswith(prefix)}
        assert variants
        said = {
            finding.code
            for finding in judgement.findings
            if finding.severity.at_least(Severity.HIGH) and (not finding.profiles or variants & {*finding.profiles})
        }
        if any(outcome.outcome is Result.OPEN for outcome in judgement.outcomes):
            said.add("open")
        systems = [system for system in meaning.systems if variants & {*system.profiles}]
        assert systems
        said |= {"denied" if system.may else "doubted" for system in systems if not _vouched(system)}
        ((place, _),) = {(place, "") for place, _variant in meaning.usability}
        reasons = {reason for name in variants for reason in meaning.usability[place, name].reasons}
        of_path = {reason for reason in reasons if not reason.startswith(_ABSENT)}
        said |= {"unloaded" if reason.startswith(_LOADING) else "unusable" for reason in of_path}
        found[vendor] = frozenset(said)
    return found


def _vouched(system: System) -> bool:
    """Whether peers may take an enclave for one of theirs, by what was read, now."""
    views = (
        (TrustDomainView(system, each.trust_domain, Permissions(system)), n) for n, each in enumerate(system.enclaves)
    )
    return any(
        view.open or system.enclaves[number].opaque or view.introduced(number, in_force=True) for view, number in views
    )


class Row(Struct, frozen=True):
    """What came of a trial for one implementation. Empty `refused` and empty `said`: both accept."""

    trial: Any
    vendor: str
    refused: str
    said: frozenset[str]

    def __str__(self) -> str:
        said = ", ".join(sorted(self.said)) or "accepted"
        return f"{self.trial}: {self.vendor} {self.refused or 'accepts'}, we: {said}"


def rows_of(
    trial: object,
    openssl: Paths,
    directory: Path,
    at: datetime,
    authorities: Sequence[bytes],
    leaf: bytes,
    *crls: bytes,
) -> Iterator[Row]:
    """What each implementation makes of an identity, as it asks OpenSSL, and what we say."""
    said = objections(directory, at, authorities, leaf, *crls)
    for caller in CALLERS:
        refused = openssl.accepts(caller, authorities, leaf, at, *crls)
        yield Row(trial, caller.name, refused, said[caller.name])
