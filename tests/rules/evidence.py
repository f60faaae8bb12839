"""A small healthy keystore as evidence, and the means to change one thing in it.

Certificates and revocation lists are real and read by the real readers; signed documents state who made the signature,
since rules judge evidence and never bytes. Everything is healthy unless a test says otherwise: no rule finds anything.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection, Iterable, Mapping
from datetime import datetime, timedelta, timezone
from functools import cache
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec.structs import replace

from keystore_audit.findings import Finding, Result
from keystore_audit.keystore.certificate import Certificate, CertificateFile, read_certificates
from keystore_audit.keystore.crl import CrlFile, read_crl
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.document import ONLY_1_1, DomainRange, Readings, Text
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import EnclaveFiles, Layout, LayoutKind, Role
from keystore_audit.keystore.private_key import PrivateKey
from keystore_audit.keystore.smime import Signature, SignedDocument
from keystore_audit.keystore.typed import (
    Criterion,
    DomainRule,
    Governance,
    GovernanceFile,
    Grant,
    Operation,
    Permissions,
    PermissionsFile,
    ProtectionKind,
    Rule,
    TopicRule,
)
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.meaning import Meaning
from keystore_audit.model.question import Doubt
from keystore_audit.profiles import DEFAULT, VARIANTS, Syntax
from keystore_audit.rules import RULES, registry
from keystore_audit.rules.judge import Judgement, judge
from keystore_audit.rules.registry import Context
from tests.keystore import builder
from tests.keystore.builder import Signed, authority, certificate, key, name

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
START = datetime(2020, 1, 1, tzinfo=timezone.utc)
END = datetime(2100, 1, 1, tzinfo=timezone.utc)
DAY = timedelta(days=1)

Change = Callable[[Keystore], Keystore]


# Certificates


@cache
def pem(
    subject: str,
    *,
    label: str | None = None,
    issuer: str = "identityCA",
    issuer_label: str | None = None,
    start: datetime = START,
    end: datetime = END,
    ca: bool | None = None,
    critical: str | None = None,
    serial: int | None = None,
    curve: str = "secp256r1",
) -> bytes:
    """A certificate for the key `label` (its subject), issued by the key `issuer_label` under the name `issuer`.

    `ca`: BasicConstraints; None: CA:TRUE for a subject without a slash, CA:FALSE for an enclave's path.
    """
    extensions = []
    if critical is not None:
        extensions.append((x509.UnrecognizedExtension(x509.ObjectIdentifier(critical), b"\x05\x00"), True))
    made = certificate(
        subject,
        _issuer(issuer, issuer_label or issuer),
        key=key(label or subject, curve),
        ca=not subject.startswith("/") if ca is None else ca,
        length=None,
        extensions=extensions,
        start=start,
        end=end,
        serial=serial if serial is not None else zlib.crc32(repr((subject, label, start, end)).encode()) + 1,
    )
    return made.pem


@cache
def _issuer(subject: str, label: str) -> Signed:
    """Who issues under a name with the key of a label."""
    return authority(subject, key=key(label))


IDENTITY_CA = pem("identityCA", issuer="identityCA")
PERMISSIONS_CA = pem("permissionsCA", issuer="permissionsCA")


def file(path: str, content: bytes | None = b"", **more: Any) -> File:
    """A file that was read."""
    more = {"sha256": f"{path} {content!r}", "mode": 0o600, **more}
    return File(path=path, resolved=path, status=Status.PRESENT, content=content, **more)


def absent(path: str, status: Status = Status.MISSING, detail: str = "there is no such file") -> File:
    """A file that was not read."""
    return File(path=path, resolved=None, status=status, detail=detail)


def certificates(path: str, *pems: bytes) -> CertificateFile:
    """A file of certificates, read by the real reader."""
    return read_certificates(file(path, b"".join(pems)))


def first(path: str, content: bytes) -> Certificate:
    """The first certificate of such a file."""
    found = certificates(path, content).first
    assert found is not None
    return found


def crl(
    path: str,
    *revoked: int,
    issuer: str = "identityCA",
    label: str | None = None,
    this_update: datetime = START,
    next_update: datetime = END,
    delta: bool = False,
    revoked_of: str | None = None,
) -> CrlFile:
    """A revocation list, read by the real reader; `delta`: of changes alone, `revoked_of`: the entries' issuer."""
    others = () if revoked_of is None else ((x509.CertificateIssuer([x509.DirectoryName(name(revoked_of))]), True),)
    entries = [builder.entry(serial, *others) for serial in revoked]
    indicated = [(x509.DeltaCRLIndicator(1), True)] if delta else []
    made = builder.crl(
        _issuer(issuer, label or issuer), entries, start=this_update, end=next_update, extensions=indicated
    )
    return read_crl(file(path, made.public_bytes(Encoding.PEM)))


def joined(*files: CrlFile) -> CrlFile:
    """One file of all their lists."""
    return read_crl(file(files[0].file.place, b"".join(each.file.content or b"" for each in files)))


def private_key(path: str, label: str, **more: Any) -> PrivateKey:
    """The private key of `label` as the reader tells of it."""
    public = first("any", pem("/anybody", label=label)).key
    more = {
        "file": file(path, None),
        "key": public,
        "key_kind": "EC secp256r1",
        "encrypted": False,
        "defects": (),
        **more,
    }
    return PrivateKey(**more)


# Documents


def signature(signer: Certificate, **more: Any) -> Signature:
    """A sound signature by `signer`."""
    more = {
        "issuer_der": signer.issuer_der,
        "serial": signer.serial,
        "digest": "sha256",
        "digest_matches": True,
        "named": (signer,),
        "verified_by": (signer,),
        "signing_time": None,
        **more,
    }
    return Signature(**more)


def signed(
    path: str, *signatures: Signature, defects: tuple[Defect, ...] = (), content: bytes = b"<dds/>\r\n"
) -> SignedDocument:
    """A signed document, by the permissions CA unless signatures are given."""
    made = signatures or (signature(first("public/permissions_ca.cert.pem", PERMISSIONS_CA)),)
    embedded = tuple(certificate for each in made for certificate in each.named)
    return SignedDocument(
        file=file(path), content=content, first_line=10, embedded=embedded, signatures=made, defects=defects
    )


def defect(kind: Kind, path: str, line: int | None = 12, detail: str = "expected one thing, got another") -> Defect:
    """A defect as readers tell of it."""
    return Defect(kind=kind, path=path, line=line, detail=detail)


def text(value: str, line: int | None = 20) -> Text:
    """The text of an element."""
    return Text(text=value, line=line)


def topic_rule(expression: str = "*", **more: Any) -> TopicRule:
    """A topic rule that protects everything."""
    more = {
        "expression": text(expression, 30),
        "enable_discovery_protection": True,
        "enable_liveliness_protection": True,
        "enable_read_access_control": True,
        "enable_write_access_control": True,
        "metadata_protection_kind": ProtectionKind.ENCRYPT,
        "data_protection_kind": ProtectionKind.ENCRYPT,
        "line": 30,
        "lines": {"enable_liveliness_protection": 33, "data_protection_kind": 37},
        **more,
    }
    return TopicRule(**more)


def domain_rule(
    *topic_rules: TopicRule, domains: Iterable[tuple[int | None, int | None]] = ((0, 0),), **more: Any
) -> DomainRule:
    """A domain rule that protects everything, whole messages encrypted."""
    more = {
        "allow_unauthenticated_participants": False,
        "enable_join_access_control": True,
        "discovery_protection_kind": ProtectionKind.ENCRYPT,
        "liveliness_protection_kind": ProtectionKind.ENCRYPT,
        "rtps_protection_kind": ProtectionKind.ENCRYPT,
        "line": 21,
        "lines": {"rtps_protection_kind": 28},
        **more,
    }
    ranges = tuple(DomainRange(low=low, high=high, line=22) for low, high in domains)
    return DomainRule(domains=ranges, topic_rules=topic_rules or (topic_rule(),), **more)


def governance(*domain_rules: DomainRule, path: str = "enclaves/governance.p7s", **more: Any) -> GovernanceFile:
    """A governance document."""
    document = Governance(domain_rules=domain_rules or (domain_rule(),), line=20)
    return GovernanceFile(**{"signed": signed(path), "readings": _readings(document, **more), "defects": (), **more})


def _readings(document: Any, *, defects: Iterable[Defect] = (), **_more: Any) -> Readings[Any]:
    """As files are read: alike by all, the older form by some, and what is out of form by nobody known."""
    if any(each.kind.opaque for each in defects):
        return Readings(by_syntax={})
    old = any(each.kind is Kind.DDS_SECURITY_1_0 for each in defects)
    return Readings(by_syntax=dict.fromkeys(Syntax, document) | (dict.fromkeys(ONLY_1_1, "older") if old else {}))


def criterion(operation: Operation, *topics: str) -> Criterion:
    """A criterion without partitions."""
    return Criterion(
        operation=operation, topics=tuple(text(t, 45) for t in topics), partitions=None, data_tags=False, line=44
    )


def allow(
    publish: Collection[str] = (),
    subscribe: Collection[str] = (),
    *,
    domains: Iterable[tuple[int | None, int | None]] = ((0, 0),),
    allows: bool = True,
) -> Rule:
    """An allow rule; with `allows` False, a deny rule."""
    made = ((Operation.PUBLISH, publish), (Operation.SUBSCRIBE, subscribe))
    return Rule(
        allow=allows,
        domains=tuple(DomainRange(low=low, high=high, line=43) for low, high in domains),
        criteria=tuple(criterion(operation, *topics) for operation, topics in made if topics),
        line=42,
    )


def grant(subject: str, *rules: Rule, **more: Any) -> Grant:
    """A grant for the identity `subject`, a path."""
    more = {
        "name": subject,
        "subject_name": text(f"CN={subject}", 39),
        "not_before": text("2020-01-01T00:00:00", 40),
        "not_after": text("2100-01-01T00:00:00", 41),
        "default_allow": False,
        "default_line": 50,
        "line": 38,
        **more,
    }
    return Grant(rules=rules or (allow(["rt/chatter"], ["rt/chatter"]),), **more)


def permissions(path: str, *grants: Grant, **more: Any) -> PermissionsFile:
    """A permissions document at `path`."""
    document = Permissions(grants=grants, line=37)
    return PermissionsFile(**{"signed": signed(path), "readings": _readings(document, **more), "defects": (), **more})


# Keystores


def enclave(path: str, **more: Any) -> Enclave:
    """A healthy enclave in sros2's layout; readings are replaced by `more`, and files follow the readings."""
    directory = f"enclaves{path}"
    if "certificate" not in more:
        more["certificate"] = certificates(f"{directory}/cert.pem", pem(path))
    readings: dict[str, Any] = {
        "identity_ca": certificates("public/identity_ca.cert.pem", IDENTITY_CA),
        "key": private_key(f"{directory}/key.pem", path),
        "permissions_ca": certificates("public/permissions_ca.cert.pem", PERMISSIONS_CA),
        "governance": governance(),
        "permissions": permissions(f"{directory}/permissions.p7s", grant(path)),
        "crl": None,
    }
    files = more.pop("files", {})
    pkcs11, unsigned = more.pop("pkcs11", {}), more.pop("unsigned", {})
    readings.update(more)
    return Enclave(files=enclave_files(path, directory, readings, files, pkcs11, unsigned), **readings)


def enclave_files(
    path: str,
    directory: str,
    readings: Mapping[str, Any],
    files: Mapping[Role, File],
    pkcs11: Mapping[Role, File],
    unsigned: Mapping[Role, File],
) -> EnclaveFiles:
    """The files behind the readings; those without a reading are missing."""
    by_role = {
        Role.IDENTITY_CA: "identity_ca",
        Role.CERTIFICATE: "certificate",
        Role.KEY: "key",
        Role.PERMISSIONS_CA: "permissions_ca",
        Role.GOVERNANCE: "governance",
        Role.PERMISSIONS: "permissions",
        Role.CRL: "crl",
    }
    found: dict[Role, File] = {}
    for role, reading in by_role.items():
        read = readings[reading]
        ending = "p7s" if role in (Role.GOVERNANCE, Role.PERMISSIONS) else "pem"
        missing = absent(f"{directory}/{role.value}.{ending}")
        found[role] = missing if read is None else read.signed.file if hasattr(read, "signed") else read.file
    found.update(files)
    return EnclaveFiles(path=path, directory=directory, files=found, pkcs11=pkcs11, unsigned=unsigned)


def keystore(*enclaves: Enclave, **layout: Any) -> Keystore:
    """A keystore of these enclaves."""
    layout = {
        "kind": LayoutKind.SROS2,
        "enclaves": tuple(e.files for e in enclaves),
        "authorities": (),
        "authority_keys": (),
        "governance": file("enclaves/governance.p7s"),
        "unsigned_governance": None,
        "directory_links": (),
        "unreadable_directories": (),
        "expected": (),
        **layout,
    }
    return Keystore(
        root="keys",
        layout=Layout(**layout),
        enclaves=enclaves,
        authorities=(),
        authority_keys=(),
        private_keys=(),
        digest="",
    )


def healthy() -> Keystore:
    """/talker and /listener, in which no rule finds anything."""
    return keystore(enclave("/talker"), enclave("/listener"))


def talker(**more: Any) -> Change:
    """The healthy keystore with a talker of its own."""
    return lambda _healthy: keystore(enclave("/talker", **more), enclave("/listener"))


def both(**more: Any) -> Change:
    """The healthy keystore with these readings in both enclaves."""
    return lambda _healthy: keystore(enclave("/talker", **more), enclave("/listener", **more))


def laid_out(**layout: Any) -> Change:
    """The healthy keystore with another layout."""
    return lambda store: replace(store, layout=replace(store.layout, **layout))


# Judging


def meaning(**more: Any) -> Meaning:
    """A meaning without doubts."""
    more = {"systems": (), "usability": {}, "doubts": (), "ungoverned": (), "idle": (), "over_budget": None, **more}
    return Meaning(**more)


def context(store: Keystore | None = None, **more: Any) -> Context:
    """What rules see; `doubts` are those of its meaning."""
    doubts: tuple[Doubt, ...] = more.pop("doubts", ())
    more = {
        "keystore": store if store is not None else healthy(),
        "meaning": meaning(doubts=doubts),
        "accesses": AccessViews((), AT, None),
        "results": (),
        "engines": (),
        "at": AT,
        "expires_within": 30 * DAY,
        "deployed": False,
        "profiles": tuple(VARIANTS[name] for name in DEFAULT),
        **more,
    }
    return Context(**{"fleets": more["profiles"], **more})


def rules_of(*modules: str) -> list[registry.Rule[Any]]:
    """The rules that stand in these modules."""
    return [rule for rule in RULES if rule.check.__module__.rpartition(".")[2] in modules]


def judged(store: Keystore | None = None, **more: Any) -> Judgement:
    """What all rules say of it."""
    return judge(context(store, **more), RULES)


def findings(code: str, judgement: Judgement) -> tuple[Finding, ...]:
    """The findings of one rule."""
    return tuple(finding for finding in judgement.findings if finding.code == code)


def codes(store: Keystore, **more: Any) -> list[str]:
    """The codes of all findings, each once, sorted; INFO notes that every stock keystore has are kept."""
    return sorted({finding.code for finding in judged(store, **more).findings})


def becomes(change: Change, **more: Any) -> list[str]:
    """The codes that one change to the healthy keystore brings about."""
    return codes(change(healthy()), **more)


def open_codes(store: Keystore, **more: Any) -> set[str]:
    """The rules that leave something undecided."""
    return {outcome.rule for outcome in judged(store, **more).outcomes if outcome.outcome is Result.OPEN}
