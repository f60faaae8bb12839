"""KA2: the authorities that enclaves trust (DDS-Security 1.1, 9.3.1 and 9.4.1.1)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.trust.verdicts import is_authority
from keystore_audit.rules.acceptance import PINNED, UNPINNED
from keystore_audit.rules.certificate import RENEW_AUTHORITY, at, what
from keystore_audit.rules.commands import MAKE_PERMISSIONS_CA, SIGN_GOVERNANCE, SIGN_PERMISSIONS, UNREVIEWED
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.subjects import CertificateUse
from keystore_audit.rules.wording import implementations, listed, located, paths, places, quoted, sole


@rule(
    "KA208",
    Severity.HIGH,
    clause="RFC 5280, 4.2.1.9 and 4.2.1.3 (basicConstraints, keyCertSign)",
    remedy=RENEW_AUTHORITY,
    explains=("identities-chain-to-the-identity-ca",),
    applies=lambda use, _context: Role.IDENTITY_CA in use.roles,
    stops=True,
)
def authority_not_a_ca(use: CertificateUse, _context: Context) -> Iterator[Violation]:
    """The identity CA's certificate may not issue certificates: OpenSSL refuses every identity under it.

    Nobody demands CA:TRUE of a permissions CA (measured).
    """
    for certificate in use.in_use:
        if not is_authority(certificate):
            got = (
                f"keyUsage {listed(sorted(certificate.key_usage or ())) or 'empty'}, expected keyCertSign in it"
                if certificate.is_ca
                else f"{'no basicConstraints' if certificate.is_ca is None else 'CA:FALSE'}, expected CA:TRUE"
            )
            yield at(use, certificate, f"{what(use, certificate)} may not issue certificates: got {got}.")


def _trusting(groups: Iterable[tuple[str, Iterable[str], Iterable[Enclave]]]) -> str:
    """Which authorities which enclaves trust in a role: one more enclave is one more that is concerned."""
    parts = ([role, *sorted(keys), *sorted(each.path for each in enclaves)] for role, keys, enclaves in groups)
    return "\0".join(sorted("\n".join(part) for part in parts))


_SEPARATE: Final = (
    "Make a second authority beside sros2's links and move it over them, in the keystore's root: "
    f"{MAKE_PERMISSIONS_CA} (written through the links, it would overwrite the one CA there is). Sign everything with "
    f"it: {SIGN_GOVERNANCE}, and for every enclave {SIGN_PERMISSIONS}. {UNREVIEWED}."
)


@rule(
    "KA222",
    Severity.MEDIUM,
    clause="DDS-Security 1.1, 9.4.1.1; CVE-2023-24010, CVE-2023-24011, CVE-2023-24012; ros2/sros2#282",
    remedy=_SEPARATE,
    explains=(
        "one-ca-for-one-role",
        "no-enclave-grants-itself-rights",
        "nobody-writes-without-a-grant",
        "nobody-reads-without-a-grant",
    ),
)
def one_ca_for_both_roles(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """One key is identity CA and permissions CA, as sros2 makes it.

    Where the signer is not pinned, every identity that this authority issued can sign permissions for itself, and peers
    take them (measured with real processes). High if a chosen profile is such an implementation, else medium: one
    update, or one old robot, is enough. Identities whose keyUsage or extendedKeyUsage forbids S/MIME are not exempted,
    since the authority can issue others.
    """
    shared: dict[tuple[str, ...], tuple[CertificateFile, CertificateFile, list[Enclave]]] = {}
    for enclave in keystore.enclaves:
        identity, permissions = enclave.identity_ca, enclave.permissions_ca
        if identity is not None and permissions is not None:
            both = {c.key for c in identity.certificates} & {c.key for c in permissions.certificates}
            if both:
                shared.setdefault(tuple(sorted(both)), (identity, permissions, []))[2].append(enclave)
    for keys, (identity, permissions, enclaves) in shared.items():
        every = [c for file in (identity, permissions) for c in file.certificates]
        of_both = [c for c in every if c.key in keys]
        alone = f"Leave in each CA file the authority of its role alone. Where one still has both roles: {_SEPARATE}"
        yield Violation(
            message=f"{quoted(of_both[0].subject)} issues the identities and signs the permissions of "
            f"{paths(enclaves)}: an enclave can sign itself any right, which {implementations(UNPINNED)} accept; "
            f"{implementations(PINNED)} refuse.",
            locations=places(located(c) for c in of_both),
            enclave=sole(enclaves),
            severity=Severity.HIGH if context.chose(UNPINNED) else None,
            remedy=alone if len(of_both) < len(every) else None,
            profiles=tuple(profile.name for profile in UNPINNED),
            key=_trusting([("both", keys, enclaves)]),
        )


_ROLES: Final = ((Role.IDENTITY_CA, "identity CAs"), (Role.PERMISSIONS_CA, "permissions CAs"))


@rule(
    "KA223",
    Severity.MEDIUM,
    clause="DDS-Security 1.1, 9.3.1 and 9.4.1.1 (participants of a domain share their authorities)",
    remedy="Give every enclave the same CA files, links to public/ as sros2 makes them, and issue and sign again "
    "what the others issued and signed.",
)
def enclaves_trust_different_cas(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Enclaves trust different authorities, so that they refuse each other.

    It is the trace of an authority that was renewed for some of them. Keystores that are meant to be separate are
    better kept in separate directories. Compared are keys.
    """
    for role, name in _ROLES:
        trusted: dict[frozenset[str], list[tuple[Enclave, CertificateFile]]] = {}
        for enclave in keystore.enclaves:
            file = enclave.identity_ca if role is Role.IDENTITY_CA else enclave.permissions_ca
            if file is not None and file.certificates:
                keys = frozenset(certificate.key for certificate in file.certificates)
                trusted.setdefault(keys, []).append((enclave, file))
        if len(trusted) > 1:
            groups = sorted(trusted.values(), key=len, reverse=True)
            said = "; ".join(
                f"{listed([group[0][1].file.place])} for {paths(enclave for enclave, _ in group)}"
                for group in groups[:3]
            )
            yield Violation(
                message=f"Enclaves trust {len(groups)} different {name}: {said}.",
                # The minority first: it is what has to change.
                locations=places(Location(path=file.file.place) for group in reversed(groups) for _, file in group),
                key=_trusting((role.value, keys, [enclave for enclave, _ in group]) for keys, group in trusted.items()),
            )
