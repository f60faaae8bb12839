"""The processes whose files lie in a folder, and whose keystore's certificates they name.

Everything in the folder is as hostile as a keystore: bounded, regular files, none outside. A path in a file is that of
the robot, so what it names is found in the keystore by the end of the path.
"""

from __future__ import annotations

import os
import posixpath
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Final, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import NothingToAudit
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.source import reason
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.files import EntryKind, File, Status
from keystore_audit.keystore.issuer import Issue, issued_by
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.walk import below, walk
from keystore_audit.profiles import facts
from keystore_audit.text import percent_path
from keystore_audit.truth import Truth, any_of
from keystore_audit.zenoh.configuration import SECURED, Configuration, Endpoint, Mode, Refusal, read_configuration

_READ: Final = (".json5", ".json")
_NOT_READ: Final = (".yaml", ".yml", ".toml")
MAX_PROCESSES: Final = 200
"""Files of one folder: every two processes may be linked."""
MAX_EXPRESSIONS: Final = 20_000
"""Key expressions of rules in one folder: 100 processes with a hundred rights, each in two rules."""
_KEYS: Final = ("EC secp256r1", "EC secp384r1", "Ed25519")
_KEYS_REFUSED: Final = ("EC secp521r1", "RSA 1024")
CONNECTING: Final = "1.3.6.1.5.5.7.3.2"  # id-kp-clientAuth: RFC 5280, 4.2.1.12
LISTENING: Final = "1.3.6.1.5.5.7.3.1"  # id-kp-serverAuth: the same


T = TypeVar("T")


class Process(Struct, frozen=True, kw_only=True, eq=False):
    """What starts with one file. `owner`: the enclave whose certificate it names; None where that is none here."""

    file: GivenFile
    says: Configuration
    owner: Enclave | None
    certificate: Certificate | None
    holds_key: bool
    """Whether the file may hold a private key, wherever in it."""

    @property
    def path(self) -> str:
        """The path of the file, as the user named the folder."""
        return self.file.path

    @property
    def name(self) -> str:
        """The enclave's path; of a router, and where the certificate is of no enclave, the file's."""
        return self.owner.path if self.owner is not None and is_session(self) else self.path

    def at(self, line: int | None, message: str = "") -> Location:
        """A place in the file."""
        return Location(self.path, line, message=message, beside=True)

    @property
    def known_as(self) -> str | None:
        """What others call it that authenticate it: the first common name of its certificate (measured)."""
        return common_name(self.certificate) if self.certificate is not None else None


def common_name(certificate: Certificate) -> str | None:
    """The first common name of a certificate's subject; None where it has none."""
    from cryptography.x509.oid import NameOID

    names = certificate.subject_name.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else None


class Network(Struct, frozen=True, kw_only=True, eq=False):
    """What lies in the folder. `unread`: places of which nothing is known, and why."""

    path: str
    processes: tuple[Process, ...]
    unread: tuple[tuple[Location, str], ...]
    at: datetime
    named: NamedFiles

    @property
    def started(self) -> tuple[Process, ...]:
        """Those that start: a file that is refused ends its process."""
        return tuple(each for each in self.processes if each.says.starts)

    @property
    def doubts(self) -> tuple[tuple[Location, str], ...]:
        """Why more may be possible than the files say."""
        return (*self.unread, *((each.at(line), why) for each in self.started for line, why in self.unclear(each)))

    def unclear(self, process: Process) -> Iterator[tuple[int | None, str]]:
        """What of a process is unknown, by itself and by the keystore."""
        yield from process.says.unclear
        secured = [each for each in (*process.says.listens, *process.says.connects) if each.protocol in ("tls", "quic")]
        for name in ("root_ca_certificate", "listen_certificate", "connect_certificate"):
            for endpoint in secured:
                said, line = process.says.tls(endpoint, name)
                if isinstance(said, str) and self.named.certificates_at(said) is None:
                    yield line, f"{name} is no file of the keystore"
                    break

    def roots(self, process: Process, endpoint: Endpoint | None) -> tuple[Certificate, ...] | None:
        """Whom it trusts on a link, beside public authorities; None where that cannot be told."""
        said, _line = process.says.tls(endpoint, "root_ca_certificate")
        if said is None:
            return ()
        found = self.named.certificates_at(said) if isinstance(said, str) else None
        return found.certificates if found is not None and not found.defects else None

    def trusts(
        self, process: Process, endpoint: Endpoint | None, certificate: Certificate | None, purpose: str
    ) -> Truth:
        """Whether it takes a link with the owner of the certificate, who is there to connect or to listen.

        Dates of the root do not count, and a link may outlive the certificate unless the process ends it (measured).
        """
        roots = self.roots(process, endpoint)
        if roots is None or certificate is None:
            return Truth.UNKNOWN
        usable, _why = usability(certificate, self.at, purpose)
        if usable is Truth.NO:
            lasting = process.says.tls(endpoint, "close_link_on_expiration")[0] is not True
            return Truth.UNKNOWN if lasting and self.at > certificate.not_after else Truth.NO
        issues = {issued_by(certificate, root) for root in roots}
        issued = any_of(
            Truth.YES if issue is Issue.ISSUED else Truth.UNKNOWN if issue is Issue.UNSUPPORTED else Truth.NO
            for issue in issues
        )
        return usable if issued is Truth.YES else issued


def usability(certificate: Certificate, at: datetime, *purposes: str) -> tuple[Truth, str]:
    """Whether links can be had with the certificate (aware UTC) for these purposes, and why not (all measured)."""
    if not certificate.not_before <= at <= certificate.not_after:
        return Truth.NO, "it is not valid now"
    if certificate.is_ca:
        return Truth.NO, "it is that of a CA (CA:TRUE)"
    usage = certificate.extended_key_usage
    if usage is not None and not usage.issuperset(purposes):
        return Truth.NO, "its extended key usage does not allow it"
    kind = certificate.key_kind
    if kind in _KEYS_REFUSED:
        return Truth.NO, f"its key is {kind}"
    if common_name(certificate) is None:
        return Truth.UNKNOWN, "it has no common name, and some releases take none such"
    rsa = kind.startswith("RSA ") and kind[4:].isdecimal() and int(kind[4:]) >= 2048
    return (Truth.YES, "") if rsa or kind in _KEYS else (Truth.UNKNOWN, f"nothing is known of its key, {kind}")


class NamedFiles:
    """The files of a keystore as configurations name them."""

    def __init__(self, keystore: Keystore) -> None:
        self._certificates: dict[str, CertificateFile] = {}
        self.owners: dict[str, Enclave] = {}
        self._keys: dict[str, Enclave | None] = {file.path: None for file in keystore.layout.authority_keys}
        for file in keystore.authorities:
            named = [each.path for each in keystore.layout.authorities if each.place == file.file.place]
            self._certificates |= dict.fromkeys((file.file.path, file.file.place, *named), file)
        for enclave in keystore.enclaves:
            files = enclave.files.files
            self._keys[files[Role.KEY].path] = enclave
            for role, read in ((Role.IDENTITY_CA, enclave.identity_ca), (Role.CERTIFICATE, enclave.certificate)):
                if read is not None:
                    self._certificates[files[role].path] = read
            if enclave.certificate is not None and enclave.identity is not None:
                self.owners.setdefault(enclave.identity.sha256, enclave)

    def certificates_at(self, path: str) -> CertificateFile | None:
        """The certificates that a path of the robot names; None where the keystore has no such file."""
        return _by_end(self._certificates, path)

    def key_of(self, path: str) -> tuple[bool, Enclave | None]:
        """Whether a path names a private key of the keystore, and whose it is: None that of an authority."""
        found = _by_end({name: (True, enclave) for name, enclave in self._keys.items()}, path)
        return found if found is not None else (False, None)


def _by_end(known: Mapping[str, T], path: str) -> T | None:
    """What has the longest end of the path, of a folder and a name at least."""
    parts = path.split("/")
    for begin in range(max(1, len(parts) - 1)):
        found = known.get("/".join(parts[begin:]))
        if found is not None:
            return found
    return None


def read_network(path: Path, keystore: Keystore, at: datetime) -> Network:
    """Read all files of configurations below the folder. Raises NothingToAudit where there are none."""
    given = os.fspath(path)
    processes: list[Process] = []
    unread: list[tuple[Location, str]] = []
    named = NamedFiles(keystore)
    try:
        with Root.open(path) as root:
            for folder, listing in walk(root, lambda _path, _end: False):
                if listing.directory.status is not Status.DIRECTORY:
                    unread.append((_place(given, percent_path(folder)), reason(listing.directory)))
                for entry in listing.entries:
                    ending = os.path.splitext(os.fsdecode(entry.name))[1].lower()
                    if entry.kind is EntryKind.DIRECTORY or ending not in (*_READ, *_NOT_READ):
                        continue
                    file = root.file(below(folder, entry.name))
                    place = _place(given, file.path)
                    if len(processes) >= MAX_PROCESSES or sum(map(_expressions, processes)) > MAX_EXPRESSIONS:
                        unread.append((place, "it is one of too many files, or there are too many rules before it"))
                    elif ending in _NOT_READ or file.status is not Status.PRESENT or file.content is None:
                        unread.append((place, f"{ending[1:]} is not read" if ending in _NOT_READ else reason(file)))
                    else:
                        processes.append(_process(file, file.content, place.path, named))
    except NothingToAudit:
        raise NothingToAudit(f"{given} is no directory that can be read; {facts.EXPECTED_FILES}.") from None
    if not processes and not unread:
        raise NothingToAudit(f"{given} holds no .json5 or .json file; {facts.EXPECTED_FILES}.")
    return Network(path=given, processes=tuple(processes), unread=tuple(unread), at=at, named=named)


def _expressions(process: Process) -> int:
    return sum(len(rule.keys) for rule in process.says.rules)


def _place(given: str, path: str) -> Location:
    return Location(posixpath.join(percent_path(given), path), beside=True)


def _process(file: File, content: bytes, path: str, named: NamedFiles) -> Process:
    try:
        says = read_configuration(content.decode("utf-8"))
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        says = Configuration(refusals=(Refusal(line=line, reason="this is not UTF-8"),))
    says = replace(says, refusals=(*says.refusals, *_unfit_keys(says, named)))
    certificate = _certificate(says, named)
    return Process(
        file=GivenFile.of(path, content),
        says=says,
        owner=named.owners.get(certificate.sha256) if certificate is not None else None,
        certificate=certificate,
        holds_key=file.holds_private_key,
    )


def _unfit_keys(says: Configuration, named: NamedFiles) -> Iterator[Refusal]:
    """Private keys of others than the listening certificate; with one, a process does not start (measured)."""
    for end in (each for each in says.listens if each.protocol in SECURED):
        (shown, _line), (said, line) = says.tls(end, "listen_certificate"), says.tls(end, "listen_private_key")
        found = named.certificates_at(shown) if isinstance(shown, str) else None
        there, owner = named.key_of(said) if isinstance(said, str) else (False, None)
        certificate = found.first if found is not None else None
        if there and certificate is not None and owner is not named.owners.get(certificate.sha256):
            yield Refusal(line=line or 1, reason="listen_private_key is not the key of listen_certificate")


def _certificate(says: Configuration, named: NamedFiles) -> Certificate | None:
    """The certificate that the file names first, for connecting or for listening."""
    for endpoint in (None, *says.listens, *says.connects):
        for name in ("connect_certificate", "listen_certificate"):
            said, _line = says.tls(endpoint, name)
            found = named.certificates_at(said) if isinstance(said, str) else None
            if found is not None and found.first is not None:
                return found.first
    return None


def is_session(process: Process) -> bool:
    """Whether nodes of ROS 2 run in it: routers have none."""
    return process.says.mode is not Mode.ROUTER
