"""KA2, continued: private keys and revocation (DDS-Security 1.1, 9.3; RFC 5280, 5)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.crl import RevocationList, crl_signed_by
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.revocation import revoked_serials
from keystore_audit.rules.certificate import ISSUE_AGAIN
from keystore_audit.rules.context import Context
from keystore_audit.rules.places import from_defect, of_kinds
from keystore_audit.rules.registry import Rule, Violation, rule

NEW_CRL = "Write the list again with the identity CA: openssl ca -gencrl -crldays 30 -out crl.pem"


@rule(
    "KA209",
    "key-does-not-match-certificate",
    Severity.HIGH,
    on=Enclave,
    clause="DDS-Security 1.1, 9.3.2.1",
    remedy=ISSUE_AGAIN + ".",
)
def key_does_not_match_certificate(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """key.pem belongs to another certificate.

    Fast DDS refuses the participant; Cyclone DDS starts it and never completes a handshake (measured).
    """
    first = enclave.certificate.first if enclave.certificate else None
    key = enclave.key
    if first is not None and key is not None and key.key is not None and key.key != first.key:
        yield Violation(
            message=(
                f"The private key ({key.key_kind}) does not belong to the certificate {first.subject!r}"
                f" ({first.key_kind})."
            ),
            locations=(
                Location(path=key.file.place, line=1),
                Location(path=first.path, line=first.line, message="the certificate"),
            ),
            enclave=enclave.path,
            key="key",
        )


@rule(
    "KA210",
    "private-key-unreadable",
    Severity.HIGH,
    on=Enclave,
    clause="RFC 5958; RFC 7468",
    remedy=ISSUE_AGAIN + ".",
)
def private_key_unreadable(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """The private key does not parse, so whether the enclave can start is unknown."""
    for defect in of_kinds(enclave.key.defects if enclave.key else (), {Kind.KEY_UNREADABLE}):
        yield from_defect(defect, (enclave,), undecided=True)


@rule(
    "KA211",
    "private-key-encrypted",
    Severity.HIGH,
    on=Enclave,
    clause="DDS-Security 1.1, 9.3.1 (dds.sec.auth.password)",
    remedy="Write the key without a password, readable by its owner only: openssl pkey -in key.pem -out key.pem.new",
)
def private_key_encrypted(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """The private key needs a password.

    ROS 2 passes none to the implementation, so the enclave cannot start (measured).
    """
    for defect in of_kinds(enclave.key.defects if enclave.key else (), {Kind.KEY_ENCRYPTED}):
        yield from_defect(defect, (enclave,), undecided=False)


@rule(
    "KA212",
    "identity-revoked",
    Severity.HIGH,
    on=Enclave,
    clause="RFC 5280, 6.3; DDS-Security 1.1, 9.3.2.1",
    remedy=ISSUE_AGAIN + ".",
    explains=("identities-chain-to-the-identity-ca",),
)
def identity_revoked(enclave: Enclave, context: Context) -> Iterator[Violation]:
    """A revocation list in the keystore names the enclave's identity: enclaves that carry the list refuse it."""
    first = enclave.certificate.first if enclave.certificate else None
    if first is None:
        return
    for holder in context.keystore.enclaves:
        if (first.issuer_der, first.serial) in revoked_serials(holder):
            place = holder.crl.file.place if holder.crl else ""
            yield Violation(
                message=f"The identity {first.subject!r} is revoked by {place}.",
                locations=(
                    Location(path=first.path, line=first.line),
                    Location(path=place, line=1, message="the revocation list"),
                ),
                enclave=enclave.path,
                key=first.sha256,
            )
            return


def _lists(enclave: Enclave) -> tuple[RevocationList, ...]:
    return enclave.crl.revocation_lists if enclave.crl else ()


@rule(
    "KA213",
    "crl-invalid",
    Severity.HIGH,
    on=Enclave,
    clause="RFC 5280, 5 and 6.3.3",
    remedy=NEW_CRL + ".",
)
def crl_invalid(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """crl.pem does not parse, or no identity CA of the enclave signed it.

    Implementations then refuse every identity, or revoke nothing.
    """
    for defect in of_kinds(enclave.crl.defects if enclave.crl else (), {Kind.CRL_UNREADABLE}):
        yield from_defect(defect, (enclave,), undecided=True)
    authorities = enclave.identity_ca.certificates if enclave.identity_ca else ()
    for revocations in _lists(enclave):
        if authorities and not any(crl_signed_by(revocations, authority) for authority in authorities):
            yield Violation(
                message=f"The revocation list of {revocations.issuer!r} is not signed by the enclave's identity CA.",
                locations=(Location(path=revocations.path, line=revocations.line),),
                enclave=enclave.path,
                key=revocations.issuer,
            )


@rule(
    "KA214",
    "crl-stale",
    Severity.HIGH,
    on=Enclave,
    clause="RFC 5280, 5.1.2.5 (nextUpdate)",
    remedy=NEW_CRL + ".",
)
def crl_stale(enclave: Enclave, context: Context) -> Iterator[Violation]:
    """The revocation list is past its nextUpdate: implementations then refuse every identity (measured)."""
    for revocations in _lists(enclave):
        if revocations.next_update is not None and revocations.next_update < context.at:
            yield Violation(
                message=(
                    f"The revocation list ended at {revocations.next_update:%Y-%m-%dT%H:%M:%SZ} (audit: "
                    f"{context.at:%Y-%m-%dT%H:%M:%SZ}): every identity is refused."
                ),
                locations=(Location(path=revocations.path, line=revocations.line),),
                enclave=enclave.path,
                key=revocations.issuer,
            )


@rule(
    "KA215",
    "crl-not-everywhere",
    Severity.MEDIUM,
    on=Keystore,
    clause="DDS-Security 1.1, 9.3.1; ros2/rmw_dds_common#52",
    remedy="Put the same crl.pem into every enclave.",
)
def crl_not_everywhere(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Some enclaves carry a revocation list and others none, or another one.

    Only its holders refuse a revoked peer (measured).
    """
    lists: dict[str | None, list[Enclave]] = {}
    for enclave in keystore.enclaves:
        lists.setdefault(enclave.crl.file.sha256 if enclave.crl else None, []).append(enclave)
    if len(lists) > 1:
        without = lists.get(None, [])
        holders = [enclave for digest, group in lists.items() if digest is not None for enclave in group]
        said = (
            f"{len(without)} of {len(keystore.enclaves)} enclaves carry no revocation list"
            if without
            else "enclaves carry different revocation lists"
        )
        yield Violation(
            message=f"Of the enclaves, {said}: only holders refuse a revoked peer.",
            locations=tuple(Location(path=e.crl.file.place, line=1) for e in holders if e.crl),
            key="crl",
        )


PRIVATE_KEY: tuple[Rule[Any], ...] = (
    key_does_not_match_certificate,
    private_key_unreadable,
    private_key_encrypted,
    identity_revoked,
    crl_invalid,
    crl_stale,
    crl_not_everywhere,
)
