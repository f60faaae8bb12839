"""KA1: the directory and its files (sros2; rmw_dds_common security.cpp)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind, Role
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.model.names import is_ros_name
from keystore_audit.model.usability import REQUIRED
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Rule, Violation, rule

_SOURCE = "ros2/rmw_dds_common security.cpp (files of an enclave)"
_OTHERS = 0o077
"""Permission bits for group and others."""


def _required(enclave: Enclave, status: Status) -> Iterator[tuple[Role, File]]:
    """Required files of the enclave in this state, unless a .p11 file stands in for them."""
    for role in REQUIRED:
        file = enclave.files.files[role]
        if file.status is status and role not in enclave.files.pkcs11:
            yield role, file


def _file(enclave: Enclave, file: File, message: str, **more: Any) -> Violation:
    return Violation(
        message=message, locations=(Location(path=file.path),), enclave=enclave.path, key=file.path, **more
    )


@rule(
    "KA101",
    "required-file-missing",
    Severity.HIGH,
    on=Enclave,
    clause=_SOURCE,
    remedy="Make the enclave's files again: ros2 security create_enclave KEYSTORE ENCLAVE, then create_permission.",
)
def required_file_missing(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """A file that every run time needs is not there.

    Under Enforce the node does not start; under Permissive it starts unsecured.
    """
    for status in (Status.MISSING, Status.DIRECTORY):
        for role, file in _required(enclave, status):
            message = (
                f"{role.value} is {'a directory' if status is Status.DIRECTORY else 'missing'}: the enclave cannot"
                " start."
            )
            yield _file(enclave, file, message)


@rule(
    "KA102",
    "dangling-link",
    Severity.HIGH,
    on=Enclave,
    clause=_SOURCE,
    remedy="Point the link at the file: links of an enclave lead to public/ and to enclaves/governance.p7s.",
)
def dangling_link(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """A required file is a link that leads nowhere, so the enclave cannot start.

    Copying a part of a keystore does that.
    """
    for status in (Status.DANGLING, Status.LOOP):
        for role, file in _required(enclave, status):
            yield _file(enclave, file, f"{role.value} is a link that leads nowhere: {file.detail}.")


def _unread(code: str, name: str, status: Status, remedy: str, why: str) -> Rule[Enclave]:
    """The rule that no run-time file is in a state in which we do not read it."""

    def check(enclave: Enclave, _context: Context) -> Iterator[Violation]:
        for role, file in (*enclave.files.files.items(), *enclave.files.pkcs11.items()):
            if file.status is status:
                yield _file(enclave, file, f"{role.value} was not read: {file.detail}.", undecided=True)

    check.__doc__ = why
    register: Callable[[Callable[[Enclave, Context], Iterator[Violation]]], Rule[Enclave]] = rule(
        code, name, Severity.HIGH, on=Enclave, clause=_SOURCE, remedy=remedy
    )
    return register(check)


link_leaves_keystore = _unread(
    "KA103",
    "link-leaves-keystore",
    Status.OUTSIDE,
    "Copy the file into the keystore, or link within it.",
    "A run-time file is a link out of the keystore. What it leads to is not part of what is audited and is not read,"
    " though a robot would read it, so the enclave may be able to do anything.",
)

not_a_regular_file = _unread(
    "KA105",
    "not-a-regular-file",
    Status.SPECIAL,
    "Put a regular file in its place.",
    "A run-time file is a pipe, a device or a socket. It is not opened: reading could hang or give other bytes each"
    " time.",
)

file_too_large = _unread(
    "KA106",
    "file-too-large",
    Status.TOO_LARGE,
    "Find out what the file is; a keystore's files have some kilobytes.",
    "A run-time file is over 4 MB and is not read, though a robot might read it.",
)


@rule(
    "KA104",
    "directory-link-not-followed",
    Severity.HIGH,
    on=Keystore,
    clause="design section 4 (links to directories are never followed)",
    remedy="Replace the link by a directory, or audit its target on its own.",
)
def directory_link_not_followed(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """A link leads to a directory in which enclaves may lie.

    It is never followed, so what is behind it may be able to do anything.
    """
    for file in keystore.layout.directory_links:
        yield Violation(
            message=f"A link to a directory was not followed: {file.detail}.",
            locations=(Location(path=file.path),),
            undecided=True,
            key=file.path,
        )


@rule(
    "KA107",
    "unreadable",
    Severity.HIGH,
    on=Keystore,
    clause="keystore-audit: what cannot be read counts as able to do anything",
    remedy="Run the audit as a user who may read the keystore.",
)
def unreadable(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """A file or directory could not be read."""
    for file in keystore.layout.unreadable_directories:
        yield Violation(
            message=f"The directory could not be read: {file.detail}.",
            locations=(Location(path=file.path),),
            undecided=True,
            key=file.path,
        )
    for enclave in keystore.enclaves:
        for role, file in (*enclave.files.files.items(), *enclave.files.pkcs11.items()):
            if file.status is Status.UNREADABLE:
                yield _file(enclave, file, f"{role.value} could not be read: {file.detail}.", undecided=True)


@rule(
    "KA108",
    "private-key-readable-by-others",
    Severity.MEDIUM,
    on=Enclave,
    clause="DDS-Security 1.1, 9.3.1 (private keys are kept secret); CWE-732",
    remedy="chmod 600 key.pem (sros2 writes private keys with mode 644)",
)
def private_key_readable_by_others(enclave: Enclave, context: Context) -> Iterator[Violation]:
    """Other users of the machine can read the private key and be the enclave. High on a robot (--deployed)."""
    key = enclave.key
    if key is not None and key.file.mode is not None and key.file.mode & _OTHERS:
        severity = Severity.HIGH if context.deployed else None
        message = f"The private key has mode {key.file.mode & 0o777:o} (expected 600): other users can read it."
        yield Violation(
            message=message,
            locations=(Location(path=key.file.place),),
            enclave=enclave.path,
            severity=severity,
            key="mode",
        )


@rule(
    "KA109",
    "ca-private-key-in-tree",
    Severity.INFO,
    on=Keystore,
    clause="ROS 2 design, ROS 2 security enclaves (private/ is not deployed); ros2/ros2_documentation#3318",
    remedy="Keep CA keys off the robot: deploy enclaves/ and public/ only.",
)
def ca_private_key_in_tree(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A CA's private key lies in the tree: whoever has it makes any identity or signs any right.

    A note where keystores are made; critical in a tree that goes on a robot (--deployed).
    """
    for key in keystore.authority_keys:
        yield Violation(
            message="The private key of a CA is in the tree"
            + (", which goes on a robot." if context.deployed else "."),
            locations=(Location(path=key.file.place),),
            severity=Severity.CRITICAL if context.deployed else None,
            key="ca key",
        )


@rule(
    "KA110",
    "unsigned-document-differs",
    Severity.MEDIUM,
    on=Keystore,
    clause="DDS-Security 1.1, 9.4.1.2 and 9.4.1.3 (the signed document counts)",
    remedy="Sign the XML again if it is what is meant, else write it anew from the signed one.",
)
def unsigned_document_differs(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """The XML beside a signed document says something else: what is reviewed is not what runs.

    Compared after turning CRLF into LF, since S/MIME changes line ends.
    """
    pairs: list[tuple[str | None, File | None, SignedDocument | None]] = []
    for enclave in keystore.enclaves:
        signed = {
            Role.GOVERNANCE: enclave.governance.signed if enclave.governance else None,
            Role.PERMISSIONS: enclave.permissions.signed if enclave.permissions else None,
        }
        pairs += [(enclave.path, file, signed.get(role)) for role, file in enclave.files.unsigned.items()]
    shared = keystore.layout.governance
    if shared is not None:
        carried = (e.governance.signed for e in keystore.enclaves if e.governance)
        document = next((s for s in carried if s.file.place == shared.place), None)
        pairs.append((None, keystore.layout.unsigned_governance, document))
    seen: set[str] = set()
    for path, file, document in pairs:
        if file is None or file.content is None or document is None or document.content is None:
            continue
        if file.place not in seen and _lines(file.content) != _lines(document.content):
            seen.add(file.place)
            yield Violation(
                message=f"{file.place} differs from what is signed in {document.file.place}.",
                locations=(Location(path=file.place), Location(path=document.file.place, message="what counts")),
                enclave=path,
                key="differs",
            )


def _lines(content: bytes) -> bytes:
    return content.replace(b"\r\n", b"\n").rstrip(b"\n")


@rule(
    "KA111",
    "pkcs11-reference",
    Severity.MEDIUM,
    on=Enclave,
    clause=_SOURCE + "; DDS-Security 1.1, 9.3.1 (pkcs11: URI)",
    remedy="Audit where the token is, or use .pem files.",
)
def pkcs11_reference(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """A .p11 file refers to a token. Fast DDS takes it before the .pem file; what it holds cannot be read here."""
    for role, file in enclave.files.pkcs11.items():
        yield _file(enclave, file, f"{role.value} is on a PKCS#11 token, which was not read.", undecided=True)


@rule(
    "KA112",
    "incomplete-keystore",
    Severity.MEDIUM,
    on=Keystore,
    clause="ros2/sros2 keystore layout (public/, private/, enclaves/)",
    remedy="Run ros2 security create_keystore again, or restore the missing parts.",
)
def incomplete_keystore(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Parts of the keystore are missing, as after a create_keystore that died half-way."""
    if keystore.layout.kind is LayoutKind.PARTIAL:
        missing = "; ".join(keystore.layout.expected) or "a part"
        yield Violation(
            message=f"The keystore is incomplete: {missing}.", locations=(Location(path="."),), key="partial"
        )


@rule(
    "KA113",
    "enclave-name-not-ros",
    Severity.MEDIUM,
    on=Enclave,
    clause="ROS 2 design, topic and service names; rcl validate_enclave_name",
    remedy="Rename the enclave: letters, digits and underscores, not beginning with a digit.",
)
def enclave_name_not_ros(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """The enclave's path is no valid name, so no node can ask for it; the directory may be there to mislead."""
    if enclave.path != "/" and not is_ros_name(enclave.path):
        yield Violation(
            message=f"{enclave.path!r} is no valid enclave name: no node can use it.",
            locations=(Location(path=enclave.files.directory),),
            enclave=enclave.path,
            key="name",
        )


@rule(
    "KA114",
    "enclave-names-differ-by-case",
    Severity.LOW,
    on=Keystore,
    clause="ros2/sros2 keystore layout (an enclave is a directory)",
    remedy="Rename one of the enclaves.",
)
def enclave_names_differ_by_case(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """Two enclaves differ only in case: on some file systems they are one directory."""
    names: dict[str, list[Enclave]] = {}
    for enclave in keystore.enclaves:
        names.setdefault(enclave.files.directory.casefold(), []).append(enclave)
    for group in names.values():
        if len(group) > 1:
            yield Violation(
                message=f"Enclaves differ only in case: {', '.join(e.path for e in group)}.",
                locations=tuple(Location(path=e.files.directory) for e in group),
                key=group[0].files.directory.casefold(),
            )


@rule(
    "KA115",
    "deprecated-layout",
    Severity.LOW,
    on=Keystore,
    clause="REP 2000 (end of life of Ardent to Eloquent)",
    remedy="Make the keystore again with a supported distribution; Foxy and later do not find enclaves in this layout.",
)
def deprecated_layout(keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """The layout is that of a distribution which is no longer supported: Ardent to Eloquent."""
    wrote = {LayoutKind.FLAT: "Crystal, Dashing or Eloquent", LayoutKind.ARDENT: "Ardent or Bouncy"}
    if keystore.layout.kind in wrote:
        yield Violation(
            message=f"The layout is that of {wrote[keystore.layout.kind]}, which are no longer supported.",
            locations=(Location(path="."),),
            key=keystore.layout.kind.value,
        )


@rule(
    "KA116",
    "ca-key-readable-by-others",
    Severity.MEDIUM,
    on=Keystore,
    clause="CWE-732",
    remedy="chmod 600 on the CA's private key",
)
def ca_key_readable_by_others(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Other users of the machine can read a CA's private key and make any identity or sign any right.

    High in a tree that goes on a robot (--deployed).
    """
    for key in keystore.authority_keys:
        if key.file.mode is not None and key.file.mode & _OTHERS:
            yield Violation(
                message=(
                    f"The CA's private key has mode {key.file.mode & 0o777:o} (expected 600): other users can read it."
                ),
                locations=(Location(path=key.file.place),),
                severity=Severity.HIGH if context.deployed else None,
                key="mode",
            )


LAYOUT: tuple[Rule[Any], ...] = (
    required_file_missing,
    dangling_link,
    link_leaves_keystore,
    directory_link_not_followed,
    not_a_regular_file,
    file_too_large,
    unreadable,
    private_key_readable_by_others,
    ca_private_key_in_tree,
    unsigned_document_differs,
    pkcs11_reference,
    incomplete_keystore,
    enclave_name_not_ros,
    enclave_names_differ_by_case,
    deprecated_layout,
    ca_key_readable_by_others,
)
