"""KA2: identities, who issued them, and how they stand to each other (DDS-Security 1.1, 9.3)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Act, Location, Severity, decision, mechanical
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import first_opaque
from keystore_audit.keystore.issuer import Issue
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.unmanaged import UnmanagedIdentity
from keystore_audit.model.inventory import certified_again, unmanaged_identities
from keystore_audit.model.participants.admitted import admitted
from keystore_audit.model.trust.chain import chain_refusal
from keystore_audit.model.trust.verdicts import is_authority, issue, may_have_issued, vouches
from keystore_audit.profiles import VARIANTS, Profile, facts, implementations
from keystore_audit.rules.certificate import has_usual_subject, usual_subject, what
from keystore_audit.rules.registry import Context, Violation, located, paths, quoted, rule
from keystore_audit.rules.remedies import ISSUE_AGAIN, issue_again
from keystore_audit.rules.subjects import EXCHANGED, CertificateUse, exchange_for, is_identity
from keystore_audit.text import instant

_SHARED: Final = ("no-identity-serves-two-enclaves", "no-subject-serves-two-enclaves")
"""What is violated where an enclave has the key of another identity."""


def _carriers(use: CertificateUse) -> Iterator[tuple[Enclave, Certificate]]:
    """Enclaves whose identity it is, with the certificate that counts."""
    for enclave in use.enclaves:
        first = enclave.identity
        carried = enclave.certificate is not None and enclave.certificate.file.place == use.certificates.file.place
        if carried and first is not None:
            yield enclave, first


@rule(
    "KA206",
    Severity.LOW,
    "RFC 5280, 6.1.3 (a)(2) (every certificate of a path has to be in force)",
    mechanical("Plan with the authority's date, or renew the authority before it ends.", Act.RENEW),
    applies=is_identity,
)
def certificate_outlives_its_ca(use: CertificateUse) -> Iterator[Violation]:
    """The identity ends later than the authority that issued it, so it is worthless in its last days.

    In sros2's keystores it is so, by the seconds between the making of authority and enclave.
    """
    for enclave, certificate in _carriers(use):
        authorities = enclave.trusts(Role.IDENTITY_CA)
        earlier = [authority for authority in authorities if authority.not_after < certificate.not_after]
        if len(earlier) < len(authorities):
            continue
        issuers = [authority for authority in earlier if vouches(authority, certificate)]
        if issuers:
            last = max(issuers, key=lambda authority: authority.not_after)
            yield Violation(
                f"{what(use, certificate)} outlives its authority, which ends at {instant(last.not_after)}.",
                (located(certificate), located(last, "the authority")),
                key=certificate.key,
            )
            return


@rule(
    "KA207",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 (signed by the identity CA); RFC 5280, 6.1.3 (a)(1)",
    ISSUE_AGAIN,
    explains=("identities-chain-to-the-identity-ca",),
    applies=is_identity,
    stops=True,
)
def not_issued_by_identity_ca(use: CertificateUse) -> Iterator[Violation]:
    """No certificate of the enclave's identity CA file issued its identity, so peers refuse it.

    Names prove nothing: sros2 calls every authority CN=sros2CA. The signature is verified with the authority's key. If
    that is impossible here, it stays open.
    """
    for enclave, certificate in _carriers(use):
        file = enclave.identity_ca
        if file is None or not file.certificates:
            continue
        answers = {issue(authority, certificate): authority for authority in reversed(file.certificates)}
        if Issue.ISSUED in answers:
            continue
        unread = first_opaque(file.defects) is not None
        if Issue.UNSUPPORTED in answers:
            said, authority = "cannot be verified here", answers[Issue.UNSUPPORTED]
            why = f"no support for {certificate.signature_algorithm} with a key {authority.key_kind}"
        else:
            said, (why, authority) = "was issued by somebody else", _why_not(certificate, answers)
        exchanged = exchange_for(enclave)
        so = f" {EXCHANGED}" if exchanged else ""
        yield Violation(
            f"{what(use, certificate)} {said}, expected the identity CA of {enclave.path}: {why}.{so}",
            (located(certificate), located(authority, "the identity CA")),
            enclave=enclave.path,
            undecided=unread or Issue.UNSUPPORTED in answers,
            key=certificate.key,
            remedy=exchanged,
        )


@rule(
    "KA226",
    Severity.HIGH,
    f"RFC 5280, 6.1; {facts.CHAINS_MEASURED}",
    decision(
        "Put one self-signed certificate alone into identity_ca.cert.pem: that of the authority that issues the "
        "identities."
    ),
    applies=is_identity,
    stops=True,
)
def identity_refused_by_implementations(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """A certificate of the identity CA file issued the identity, but some implementations find no chain.

    Cyclone DDS and OpenDDS read only the first certificate of the file. Fast DDS reads all, and wants a chain to a
    self-signed one, within the path lengths. Of two authorities with one name, OpenSSL tries only the first. High if a
    chosen profile refuses, else medium.
    """
    for enclave, certificate in _carriers(use):
        file = enclave.identity_ca
        authorities = enclave.trusts(Role.IDENTITY_CA)
        if file is None or not any(is_authority(a) and may_have_issued(a, certificate) for a in authorities):
            continue
        refusals: dict[str, list[Profile]] = {}
        for profile in VARIANTS.values():
            why = chain_refusal(certificate, file, profile.trust)
            why = why or chain_refusal(certificate, file, profile.trust, context.at)
            if why is not None:
                refusals.setdefault(why, []).append(profile)
        refusing = [profile for profiles in refusals.values() for profile in profiles]
        if not refusing:
            continue
        reasons = "; ".join(f"{implementations(profiles)}: {why}" for why, profiles in refusals.items())
        accepting = [profile for profile in VARIANTS.values() if profile not in refusing]
        accepted = f"; accepted by {implementations(accepting)}" if accepting else ""
        yield Violation(
            f"{what(use, certificate)} is refused ({reasons}){accepted}.",
            (
                located(certificate),
                Location(file.file.place, 1, message="the identity CA"),
            ),
            enclave=enclave.path,
            severity=None if context.chose(refusing) else Severity.MEDIUM,
            profiles=tuple(profile.name for profile in refusing),
            key=certificate.key,
            explains=frozenset({"identities-chain-to-the-identity-ca"}),
        )


@rule(
    "KA227",
    Severity.CRITICAL,
    f"RFC 5280, 4.1.2.6; {facts.NO_SUBJECT_MEASURED}",
    ISSUE_AGAIN,
    applies=is_identity,
    stops=True,
)
def identity_without_subject(use: CertificateUse) -> Iterator[Violation]:
    """The identity certificate has an empty subject, and Fast DDS crashes when it reads it (measured, every version).

    No grant can name it. Peers see the certificate in the handshake, before they check permissions.
    """
    for enclave, certificate in _carriers(use):
        if not list(certificate.subject_name):
            yield Violation(
                f"The identity of {enclave.path} has an empty subject: {facts.NO_SUBJECT}.",
                (located(certificate),),
                enclave=enclave.path,
                profiles=facts.DIES_OF_NO_SUBJECT,
                key=certificate.key,
            )


def _why_not(certificate: Certificate, answers: dict[Issue, Certificate]) -> tuple[str, Certificate]:
    """The nearest miss in words: a wrong signature under the right name tells most."""
    if Issue.SIGNATURE_INVALID in answers:
        authority = answers[Issue.SIGNATURE_INVALID]
        return f"both say {quoted(certificate.issuer)}, but another key signed", authority
    if Issue.KEY_IDENTIFIER_DIFFERS in answers:
        authority = answers[Issue.KEY_IDENTIFIER_DIFFERS]
        return f"both say {quoted(certificate.issuer)}, but it names another key", authority
    authority = next(iter(answers.values()))
    return f"got the issuer {quoted(certificate.issuer)}, expected {quoted(authority.subject)}", authority


@rule(
    "KA231",
    Severity.MEDIUM,
    "RFC 5280, 4.2.1.9 (basicConstraints)",
    issue_again("Set CA:FALSE in the certificate."),
    applies=is_identity,
)
def identity_is_authority(use: CertificateUse) -> Iterator[Violation]:
    """The identity certificate says CA:TRUE, so the enclave may issue certificates as its identity CA does.

    Fast DDS 2.9.1 and Cyclone DDS 0.10.2 refuse identities that the enclave issued (measured): peers know only the
    identity CA's certificate. They accept them once a CA file holds the enclave's certificate, or a peer is shown a
    chain. No certificate from sros2 says so.
    """
    for enclave, certificate in _carriers(use):
        if certificate.is_ca:
            yield Violation(
                f"{what(use, certificate)} says CA:TRUE (expected CA:FALSE): {enclave.path} may issue identities.",
                (located(certificate),),
                enclave=enclave.path,
                key=certificate.key,
            )


@rule(
    "KA220",
    Severity.LOW,
    "ros2/sros2, create_enclave (the enclave's path is the common name)",
    decision(
        "Rename the enclave's folder back, if it was renamed. Else issue another identity and name it in the "
        "permissions; if no grant names it, the enclave does not start (KA503)."
    ),
    applies=is_identity,
)
def subject_differs_from_enclave(use: CertificateUse, context: Context) -> Iterator[Violation]:
    """The identity's common name is not the enclave's path, as sros2 writes it.

    It works, since run times compare only the subject with the grant. But readers of grants and logs look for another
    enclave. If grants name only somebody else, see no-grant-for-certificate.
    """
    for enclave, certificate in _carriers(use):
        named = {grant.subject_name.text for grant in enclave.grants} or {certificate.subject}
        if certificate.subject in named and not has_usual_subject(certificate, enclave, context.keystore):
            yield Violation(
                f"The identity of {enclave.path} has the subject {quoted(certificate.subject)}, expected "
                f"{quoted(usual_subject(enclave, context.keystore))}.",
                (located(certificate),),
                enclave=enclave.path,
                key=certificate.key,
            )


def _shared_key(key: str, sharing: Sequence[Enclave]) -> str:
    """Who has the key: several as their own, or others beside the one whose it is."""
    owners = [enclave for enclave in sharing if enclave.identity is not None and enclave.identity.key == key]
    if len(owners) != 1:
        return f"{len(sharing)} enclaves have one identity key: {paths(sharing)}."
    carriers = [enclave for enclave in sharing if enclave is not owners[0]]
    one = len(carriers) == 1
    return (
        f"The key file{'' if one else 's'} of {paths(carriers)} hold{'s' if one else ''} the private key of "
        f"{paths(owners)}: whoever has {'it' if one else 'one of them'} can act as {paths(owners)}."
    )


@rule(
    "KA219",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 (a participant's identity is its key)",
    issue_again("Give each enclave its own key and certificate."),
    explains=_SHARED,
)
def identity_shared_by_enclaves(keystore: Keystore) -> Iterator[Violation]:
    """Enclaves share one identity key: whoever takes over one of them can act as all of them.

    The public keys of certificates and private keys are compared, whatever their names. If only the key file is
    another's, the property no-identity-serves-two-enclaves holds.
    """
    holders: dict[str, dict[str, tuple[Enclave, list[Location]]]] = {}
    for enclave in keystore.enclaves:
        first = enclave.identity
        found = [] if first is None else [(first.key, located(first))]
        if enclave.key is not None and enclave.key.key is not None:
            found.append((enclave.key.key, Location(enclave.key.file.place)))
        for key, location in found:
            holders.setdefault(key, {}).setdefault(enclave.files.directory, (enclave, []))[1].append(location)
    for key, sharing in holders.items():
        if len(sharing) > 1:
            yield Violation(
                _shared_key(key, [enclave for enclave, _ in sharing.values()]),
                [location for _enclave, found in sharing.values() for location in found],
                key=key,
                against=_permissions(enclave for enclave, _ in sharing.values()),
            )


@rule(
    "KA225",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.3 (a grant is bound to a subject_name, not to a key)",
    decision("Give each identity its own subject.", Act.ISSUE),
    explains=("no-subject-serves-two-enclaves",),
)
def subject_shared_by_certificates(keystore: Keystore) -> Iterator[Violation]:
    """Identities with different keys have one subject, which a grant names: each may use the grants of the other.

    Peers accept any validly signed document that an enclave presents (measured), so both have the rights of both.
    """
    granted = {grant.subject_name.text for enclave in keystore.enclaves for grant in enclave.grants}
    holders: dict[str, dict[str, tuple[Enclave, Certificate]]] = {}
    for enclave in keystore.enclaves:
        first = enclave.identity
        if first is not None and first.subject in granted:
            holders.setdefault(first.subject, {}).setdefault(first.key, (enclave, first))
    for subject, sharing in holders.items():
        if len(sharing) > 1:
            yield Violation(
                f"{len(sharing)} identities with different keys have the subject {quoted(subject)}, which a "
                f"grant names: {paths(enclave for enclave, _ in sharing.values())}.",
                [located(c) for _enclave, c in sharing.values()],
                key=subject,
                against=_permissions(enclave for enclave, _ in sharing.values()),
            )


@rule(
    "KA228",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 (who has the key of a certificate is its subject); measured",
    issue_again(
        "Give each certificate its own key, and revoke the one that is not meant: deleting the file ends nothing."
    ),
    explains=_SHARED,
)
def identity_key_certified_again(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """The key of an enclave's identity has another certificate in this keystore, which the enclave can use as well.

    A second certificate in cert.pem, in a CA file or in a message has no effect there. Whoever has the key can use it
    (measured on Cyclone DDS and Fast DDS): as another identity, with its subject's grants, or as a signer. If an
    enclave's identity CA vouches for it, flows and properties count it. For certificates in other files, if the private
    key can be read, see KA668. Certificates outside the keystore are not seen. The places include grants for a second
    certificate that peers accept.
    """
    joining = {identity.certificate.sha256 for identity in unmanaged_identities(keystore, context.at)}
    again = list(certified_again(keystore))
    every = [other for _enclave, others in again for other in others]
    rights = _rights(every, keystore, context)
    for enclave, others in again:
        first = enclave.identity
        if first is not None:
            also = ", ".join(f"{quoted(other.subject)}, issued by {quoted(other.issuer)}" for other in others[:3])
            times = "once" if len(others) == 1 else f"{len(others)} times"
            yield Violation(
                f"The identity key of {enclave.path} is certified {times} more: {also}.",
                (
                    *(located(c) for c in (first, *others)),
                    *(right for other in others for right in rights.get(other.sha256, ())),
                ),
                enclave=enclave.path,
                key="\n".join([first.key, *(f"{other.subject} {other.issuer}" for other in others)]),
                explains=frozenset(_SHARED if any(other.sha256 in joining for other in others) else ()),
            )


def _permissions(enclaves: Iterable[Enclave]) -> tuple[Location, ...]:
    """Their documents: what one of them is granted, each of them may do."""
    return tuple(Location(enclave.files.files[Role.PERMISSIONS].place) for enclave in enclaves)


def _rights(
    certificates: Sequence[Certificate], keystore: Keystore, context: Context
) -> dict[str, tuple[Location, ...]]:
    """By certificate that peers take what lets it in; whoever carries it has its key."""
    held = [UnmanagedIdentity(certificate=each, key=each.path) for each in certificates]
    found = admitted(keystore, held, context.profiles, context.at) if held else ()
    return {
        each.certificate.sha256: tuple(replace(place, message="what lets it in") for place in each.rights)
        for each in found
    }
