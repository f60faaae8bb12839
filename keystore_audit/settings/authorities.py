"""Whom the user trusts: `[authorities]` in settings, `--expect-identity-ca` and `--expect-permissions-ca`."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Final

from msgspec import Meta

from keystore_audit.errors import UsageError
from keystore_audit.given import check_beside
from keystore_audit.keystore.certificate import Certificate, read_certificate, read_certificates
from keystore_audit.keystore.files import File, Status
from keystore_audit.model.trust.chain import Authorities
from keystore_audit.settings.document import Table, several

PREFIX: Final = "sha256:"
_FINGERPRINT: Final = rf"^{PREFIX}[0-9a-fA-F]{{2}}(:?[0-9a-fA-F]{{2}}){{31}}\Z"
Fingerprint = Annotated[
    str, Meta(pattern=_FINGERPRINT, description='a fingerprint: "sha256:" and 64 hexadecimal digits')
]
Fingerprints = Fingerprint | Annotated[list[Fingerprint], Meta(min_length=1)]
MAX_BYTES: Final = 1_000_000
"""Of a file of certificates that is named."""


class AuthoritiesTable(Table, frozen=True, kw_only=True):
    """The table `[authorities]`."""

    identity: Fingerprints | None = None
    permissions: Fingerprints | None = None


def declared_authorities(table: AuthoritiesTable) -> Authorities:
    """What settings declare."""
    identity, permissions = (frozenset(map(_digits, several(each))) for each in (table.identity, table.permissions))
    return Authorities(identity=identity, permissions=permissions)


def _digits(fingerprint: str) -> str:
    return fingerprint.removeprefix(PREFIX).replace(":", "").lower()


def expected(
    declared: Authorities, identity: Sequence[str], permissions: Sequence[str], keystores: Iterable[str | Path]
) -> Authorities:
    """What settings declare, of each role for which options do in their words. Raises errors.UsageError."""
    beside = tuple(keystores)
    return Authorities(
        identity=_expected(identity, beside) or declared.identity,
        permissions=_expected(permissions, beside) or declared.permissions,
    )


def _expected(values: Sequence[str], keystores: Sequence[str | Path]) -> frozenset[str]:
    """Fingerprints, and files of certificates, each of which is then expected as it is."""
    found = set[str]()
    for value in values:
        if value.startswith(PREFIX):
            if not re.match(_FINGERPRINT, value):
                raise UsageError(f"{value!r} is no fingerprint: expected sha256: and 64 hexadecimal digits.")
            found.add(_digits(value))
        else:
            found.update(certificate.sha256 for certificate in _certificates(Path(value), keystores))
    return frozenset(found)


def _certificates(path: Path, keystores: Sequence[str | Path]) -> tuple[Certificate, ...]:
    check_beside(path, keystores)
    try:
        with path.open("rb") as opened:
            content = opened.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}.") from error
    name = os.fspath(path)
    in_der = read_certificate(content, 1, name)
    if isinstance(in_der, Certificate):
        return (in_der,)
    read = read_certificates(File(path=name, resolved=name, status=Status.PRESENT, content=content))
    if len(content) > MAX_BYTES or not read.certificates or read.defects:
        raise UsageError(f"{path} is no file of certificates alone, in PEM or DER, nor a fingerprint (sha256:...).")
    return read.certificates
