"""Users' settings, `keystore-audit.toml`: what they assert of their keystore (docs/settings.md)."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Final

from msgspec import Meta, Struct, field

from keystore_audit.assumptions import Assumption, Declaration
from keystore_audit.errors import UsageError
from keystore_audit.given import GivenFile, check_beside
from keystore_audit.keystore.certificate import Certificate, read_certificate, read_certificates
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.foreign import DeclaredFiles
from keystore_audit.model.claims.named import Declared, Determinism
from keystore_audit.model.claims.stated import Claim, Labelling
from keystore_audit.model.trust.chain import Authorities
from keystore_audit.profiles import in_scope
from keystore_audit.settings.claims import ForwardTable, PropertyTable, read_properties
from keystore_audit.settings.document import (
    Enclave,
    Enclaves,
    Source,
    Table,
    Text,
    Texts,
    Topics,
    read_document,
    several,
)
from keystore_audit.settings.labels import DeclassifierTable, LabelTable, LatticeTable, read_labels, single_writers
from keystore_audit.settings.suppressions import (
    MAX_DAYS,
    AcceptedTable,
    Suppression,
    SuppressionTable,
    read_accepted,
    read_suppressions,
)

# Whom the user trusts: `[authorities]` in settings, `--expect-identity-ca` and `--expect-permissions-ca`.


PREFIX: Final = "sha256:"
_FINGERPRINT: Final = rf"^{PREFIX}[0-9a-fA-F]{{2}}(:?[0-9a-fA-F]{{2}}){{31}}\Z"
Fingerprint = Annotated[
    str, Meta(pattern=_FINGERPRINT, description='a fingerprint: "sha256:" and 64 hexadecimal digits')
]
Fingerprints = Fingerprint | Annotated[list[Fingerprint], Meta(min_length=1)]
MAX_CERTIFICATE_BYTES: Final = 1_000_000
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
            content = opened.read(MAX_CERTIFICATE_BYTES + 1)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}.") from error
    name = os.fspath(path)
    in_der = read_certificate(content, 1, name)
    if isinstance(in_der, Certificate):
        return (in_der,)
    read = read_certificates(File(path=name, resolved=name, status=Status.PRESENT, content=content))
    if len(content) > MAX_CERTIFICATE_BYTES or not read.certificates or read.defects:
        raise UsageError(f"{path} is no file of certificates alone, in PEM or DER, nor a fingerprint (sha256:...).")
    return read.certificates


MAX_BYTES: Final = 1_000_000
"""A settings file is written by people."""

MAX_BASELINE_BYTES: Final = 10_000_000
"""Of a baseline, which is written by this program: 20,000 findings."""

MOST_DAYS: Final = 3650
"""Of `max_suppression_days`: ten years, after which nobody knows why."""

_Sha256 = Annotated[
    str, Meta(pattern=r"^sha256:[0-9a-f]{64}\Z", description='"sha256:" and 64 digits 0 to 9 and a to f')
]


class ScopeTable(Table, frozen=True, kw_only=True):
    """What the robots run: distributions and middleware."""

    distro: Texts | None = None
    rmw: Texts | None = None


class EnclaveTable(Table, frozen=True, kw_only=True):
    """What one enclave runs, `[enclaves."/arm"]`, in the words of `--rmw` and `--profile`."""

    rmw: Texts | None = None
    profile: Texts | None = None


class AssumptionTable(Table, frozen=True, kw_only=True):
    """An `[[assumption]]` that somebody answers for."""

    name: Assumption
    owner: Text
    reason: Text


class FilesTable(Table, frozen=True, kw_only=True):
    """What is said of the files of a keystore (`keystore.foreign.DeclaredFiles`)."""

    foreign: Texts | None = None
    accepted: _Sha256 | Annotated[list[_Sha256], Meta(min_length=1)] | None = None
    key_group: Annotated[int, Meta(ge=0, le=2**32 - 2)] | None = None
    aliases: Enclaves | None = None


class SettingsTable(Table, frozen=True, kw_only=True):
    """A settings file."""

    properties: list[PropertyTable] = field(default_factory=list, name="property")
    forward: list[ForwardTable] = field(default_factory=list)
    lattice: LatticeTable | None = None
    label: list[LabelTable] = field(default_factory=list)
    declassifier: list[DeclassifierTable] = field(default_factory=list)
    endorser: list[DeclassifierTable] = field(default_factory=list)
    single_writer: Topics | None = None
    suppression: list[SuppressionTable] = field(default_factory=list)
    max_suppression_days: Annotated[int, Meta(ge=1, le=MOST_DAYS)] = MAX_DAYS
    assumption: list[AssumptionTable] = field(default_factory=list)
    authorities: AuthoritiesTable = field(default_factory=AuthoritiesTable)
    files: FilesTable = field(default_factory=FilesTable)
    scope: ScopeTable | None = None
    enclaves: dict[Enclave, EnclaveTable] = field(default_factory=dict)


class BaselineTable(Table, frozen=True, kw_only=True):
    """A baseline."""

    accepted: list[AcceptedTable] = field(default_factory=list)


class Settings(Struct, frozen=True, kw_only=True):
    """What a settings file says.

    `claims`: all that it asserts, what `labels` and single writers come to among it.
    `suppressions` may last so many days from the audit instant.
    """

    file: GivenFile
    authorities: Authorities = Authorities()
    claims: tuple[Claim, ...] = ()
    labels: Labelling | None = None
    declared: Declared = field(default_factory=Declared)
    suppressions: tuple[Suppression, ...] = ()
    max_suppression_days: int = MAX_DAYS
    files: DeclaredFiles = DeclaredFiles()
    assumptions: Mapping[Assumption, Declaration] = field(default_factory=dict)
    """What somebody declared of what is taken for granted."""

    scope: tuple[str, ...] = ()
    """The variants that a gate is to judge under, by name; none: it does not say."""

    runs: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By the path of an enclave the variants of which it runs one, whatever all others run."""

    @property
    def lasting(self) -> tuple[str, ...]:
        """The properties that are about a time, by id."""
        return tuple(claim.id for claim in self.claims if claim.until is not None)

    @property
    def asserted(self) -> tuple[Claim | Determinism, ...]:
        """All properties, each with an id of its own."""
        return (*self.claims, *self.declared.claims)


class Baseline(Struct, frozen=True, kw_only=True):
    """Findings that were accepted one by one."""

    file: GivenFile
    suppressions: tuple[Suppression, ...] = ()


def read_settings(path: Path, keystores: Iterable[str | Path]) -> Settings:
    """The settings in the file at `path`.

    Raises errors.UsageError, with the line, for what is no settings file. Raises it too for one in one of the
    `keystores`, which could then absolve itself.
    """
    file, root, source = read_document(path, keystores, MAX_BYTES, SettingsTable)
    labels = read_labels(root, source)
    claims, declared = read_properties(root.properties, root.forward, source)
    writers = single_writers(root.single_writer, source.at("single_writer"))
    return Settings(
        file=file,
        authorities=declared_authorities(root.authorities),
        claims=_unique((*claims, *(labels.claims() if labels else ()), *writers), declared),
        labels=labels,
        declared=declared,
        suppressions=read_suppressions(root.suppression, source.at("suppression")),
        files=_files(root, source),
        scope=_scope(root.scope, source.at("scope")),
        runs={path: _runs(table, source.at("enclaves", path)) for path, table in root.enclaves.items()},
        max_suppression_days=root.max_suppression_days,
        assumptions={each.name: Declaration(owner=each.owner, reason=each.reason) for each in root.assumption},
    )


def _files(root: SettingsTable, source: Source) -> DeclaredFiles:
    """What is said of the keystore's files."""
    table = root.files
    foreign = several(table.foreign)
    for pattern in foreign:
        if pattern.startswith(("/", "./")) or "//" in pattern or ".." in pattern.split("/"):
            source.at("files", "foreign").wrong(f'{pattern!r}: expected a path in the keystore, e.g. "maps/**"')
    return DeclaredFiles(
        foreign=foreign,
        accepted=frozenset(each.removeprefix("sha256:") for each in several(table.accepted)),
        key_group=table.key_group,
        aliases=several(table.aliases),
        enclaves=tuple((path, source.at("enclaves", path).place) for path in root.enclaves),
    )


def _scope(table: ScopeTable | None, source: Source) -> tuple[str, ...]:
    """The variants of `[scope]`, by what the distributions ship and the middleware runs on."""
    return () if table is None else _chosen(several(table.distro), table.rmw, None, source)


def _chosen(distro: Sequence[str], rmw: Texts | None, profile: Texts | None, source: Source) -> tuple[str, ...]:
    """The variants that are all that is said."""
    try:
        return in_scope(distro, several(rmw), several(profile))
    except UsageError as error:
        source.wrong(error.message.rstrip("."))


def _runs(table: EnclaveTable, source: Source) -> tuple[str, ...]:
    """The variants of which an enclave runs one."""
    if not (table.rmw or table.profile):
        source.wrong("expected what the enclave runs: rmw, profile, or both")
    return _chosen((), table.rmw, table.profile, source)


def read_baseline(path: Path, keystores: Iterable[str | Path]) -> Baseline:
    """The baseline in the file at `path`; raises errors.UsageError as `read_settings` does."""
    file, root, source = read_document(path, keystores, MAX_BASELINE_BYTES, BaselineTable)
    return Baseline(file=file, suppressions=read_accepted(root.accepted, source.at("accepted")))


def _unique(claims: tuple[Claim, ...], declared: Declared) -> tuple[Claim, ...]:
    """The claims; raises errors.UsageError where two have one name, as labels may make them.

    What two labels make has a name of its own in reports, beside those of the claims.
    """
    seen: dict[str, tuple[object, str]] = {claim.id: (claim.id, claim.place) for claim in declared.claims}
    for number, claim in enumerate(claims):
        names: list[tuple[str, object]] = [(claim.id, number)]
        if claim.labels is not None:
            names.append((claim.labels.id, (claim.labels.source, claim.labels.target)))
        for name, what in names:
            other, at = seen.setdefault(name, (what, claim.place))
            if other != what:
                raise UsageError(f"{claim.place}: this makes the property {name!r}, which is at {at} too.")
    return claims
