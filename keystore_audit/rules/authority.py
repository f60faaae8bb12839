"""KA2: the authorities that enclaves trust (DDS-Security 1.1, 9.3.1 and 9.4.1.1)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from keystore_audit.findings import Location, Severity, decision
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.trust.chain import Anchors, authority_files, trusted
from keystore_audit.model.trust.verdicts import is_authority
from keystore_audit.rules.certificate import at, what
from keystore_audit.rules.registry import Context, Violation, listed, located, paths, quoted, rule, sole
from keystore_audit.rules.remedies import RENEW_AUTHORITY, SEPARATE
from keystore_audit.rules.subjects import UNPINNED, CertificateUse


@rule(
    "KA208",
    Severity.HIGH,
    "RFC 5280, 4.2.1.9 and 4.2.1.3 (basicConstraints, keyCertSign)",
    RENEW_AUTHORITY,
    explains=("identities-chain-to-the-identity-ca",),
    applies=lambda use, _context: Role.IDENTITY_CA in use.roles,
    stops=True,
)
def authority_not_a_ca(use: CertificateUse) -> Iterator[Violation]:
    """The identity CA's certificate may not issue certificates, so OpenSSL refuses every identity under it.

    A permissions CA needs no CA:TRUE (measured).
    """
    for certificate in use.in_use:
        if not is_authority(certificate):
            got = (
                f"keyUsage {listed(sorted(certificate.key_usage or ())) or 'empty'}, expected keyCertSign in it"
                if certificate.is_ca
                else f"{'no basicConstraints' if certificate.is_ca is None else 'CA:FALSE'}, expected CA:TRUE"
            )
            yield at(certificate, f"{what(use, certificate)} may not issue certificates: got {got}.")


def _trusting(groups: Iterable[tuple[str, Iterable[str], Iterable[Enclave]]]) -> str:
    """Which authorities which enclaves trust in a role: one more enclave is one more that is concerned."""
    parts = ([role, *sorted(keys), *sorted(each.path for each in enclaves)] for role, keys, enclaves in groups)
    return "\0".join(sorted("\n".join(part) for part in parts))


@rule(
    "KA222",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.1; CVE-2023-24010, CVE-2023-24011, CVE-2023-24012; ros2/sros2#282",
    SEPARATE,
    explains=(
        "one-ca-for-one-role",
        "no-enclave-grants-itself-rights",
        "nobody-writes-without-a-grant",
        "nobody-reads-without-a-grant",
    ),
)
def one_ca_for_both_roles(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """One key is both identity CA and permissions CA, as sros2 makes it.

    If the signer is not pinned, every identity under this CA can sign permissions for itself, and peers accept them
    (measured with real processes). High if a chosen profile is such an implementation; else a note. No keyUsage or
    extendedKeyUsage of identities helps, since the CA can issue others.
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
        alone = decision("Leave only the authority of its role in each CA file.")
        yield Violation(
            f"{quoted(of_both[0].subject)} issues the identities and signs the permissions of "
            f"{paths(enclaves)}. Where peers accept any signer that it issued, an enclave can sign itself any right.",
            [located(c) for c in of_both],
            enclave=sole(enclaves),
            severity=None if context.chose(UNPINNED) else Severity.INFO,
            remedy=alone if len(of_both) < len(every) else None,
            profiles=tuple(profile.name for profile in UNPINNED),
            key=_trusting([("both", keys, enclaves)]),
        )


_NAMES: Final = {Role.IDENTITY_CA: "identity CA", Role.PERMISSIONS_CA: "permissions CA"}
_POWERS: Final = {
    Role.IDENTITY_CA: "Peers that trust it accept every identity that its key issues",
    Role.PERMISSIONS_CA: "Peers that trust it accept all permissions that its key signs",
}


@rule(
    "KA223",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 and 9.4.1.1 (participants of a domain share their authorities); measured",
    decision(
        "Remove the authority if nobody meant to trust it, and issue and sign again what it issued and signed. Every "
        "enclave needs the same CA files, as links to public/. If it is meant, declare it under [authorities] in the "
        "settings, by a fingerprint that -v prints."
    ),
)
def unexpected_authority(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A CA file holds an authority that is not the expected one, or lacks the expected one.

    Whoever has the key of such an authority issues identities and signs permissions for anybody. With one appended to
    both CA files, a stranger's participant drives the others (measured on Fast DDS). An enclave with another authority
    refuses its peers, or trusts somebody else. Expected are the authorities that settings or options declare, by
    fingerprint of certificate or key. If none is declared, the first certificate of the file in public/ is expected;
    without public/, whatever all enclaves share. Another certificate of the same key is the same authority, unless the
    certificate itself was declared. Medium if all are declared and enclaves have different ones, so that they refuse
    each other.
    """
    for anchors in trusted(keystore, context.authorities):
        public, read = authority_files(keystore, anchors.role)
        files = [each for each in read if each[0].certificates]
        if public is not None and all(public is not file for file, _enclaves in files):
            files.append((public, ()))
        if anchors.declared or anchors.certificates:
            wrong = gathered((anchors.foreign(each[0]), each) for each in files)
            right = wrong.pop((), [])
            for group in wrong.values():
                yield _unexpected(anchors, group)
            yield from _different(anchors, right, Severity.MEDIUM)
        else:  # none is more trusted than another
            yield from _different(anchors, files)


_Files = Sequence[tuple[CertificateFile, tuple[Enclave, ...]]]
"""CA files with the enclaves that read them."""


def _unexpected(anchors: Anchors, group: _Files) -> Violation:
    """What these files hold alike, beside what is expected or in place of it."""
    foreign = [each for file, _enclaves in group for each in file.certificates if not anchors.trusts(each)]
    enclaves = [enclave for _file, several in group for enclave in several]
    first = group[0][0]
    beside = any(map(anchors.trusts, first.certificates))
    held = listed({c.sha256: quoted(c.subject) for c in foreign}.values())
    of = f" of {paths(enclaves)}" if enclaves else ""
    expected = listed(quoted(each.subject) for each in anchors.certificates)
    why = f"the first in {anchors.found_in}" if anchors.found_in else "as declared"
    wanted = f"expected {expected} alone, {why}" if expected else "and none of the declared authorities is here"
    return Violation(
        f"The {_NAMES[anchors.role]} file {first.file.place}{of} holds {held}{' too' if beside else ''}, {wanted}. "
        f"{_POWERS[anchors.role]}.",
        [located(each, f"certificate, SHA-256: {each.sha256}, its key: {each.key}") for each in foreign],
        enclave=sole(enclaves),
        key=_trusting([(anchors.role.value, (each.key for each in foreign), enclaves)]),
    )


def _different(anchors: Anchors, files: _Files, severity: Severity | None = None) -> Iterator[Violation]:
    """That enclaves have different authorities, where they do."""
    trusting = grouped(files, lambda each: frozenset(certificate.key for certificate in each[0].certificates))
    if len(trusting) < 2:
        return
    concerned = {keys: [e for _file, enclaves in group for e in enclaves] for keys, group in trusting.items()}
    ordered = sorted(trusting, key=lambda keys: len(concerned[keys]), reverse=True)
    said = "; ".join(
        f"{listed([trusting[keys][0][0].file.place])} for {paths(concerned[keys]) or 'new enclaves'}"
        for keys in ordered[:3]
    )
    yield Violation(
        f"Enclaves trust {len(trusting)} different {_NAMES[anchors.role]}s: {said}.",
        # The minority first: it is what has to change.
        [Location(file.file.place) for keys in reversed(ordered) for file, _ in trusting[keys]],
        severity=severity,
        key=_trusting((anchors.role.value, keys, enclaves) for keys, enclaves in concerned.items()),
    )
