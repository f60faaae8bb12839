"""KA1: the directory and its files, as sros2 writes them and rmw_dds_common's security.cpp looks for them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Act, Location, Severity, decision, outside
from keystore_audit.grouped import grouped
from keystore_audit.intent.intent import is_path
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind, Role
from keystore_audit.profiles import facts
from keystore_audit.rules.files import RUN_TIME_FILES, about, file_name, in_state, is_linked
from keystore_audit.rules.registry import MAX_QUOTED, Context, Violation, listed, paths, quoted, rule, sole
from keystore_audit.rules.remedies import CREATE_ENCLAVE, LINK_AGAIN
from keystore_audit.rules.subjects import DocumentUse, GovernanceUse
from keystore_audit.text import counted, shorten

READ_ALL: Final = outside("Run the audit as a user who may read the whole keystore.")
_UNREAD = "keystore-audit, docs/model.md: what is not read counts as able to do anything"

_BRING_IN: Final = decision(
    "Audit the whole keystore, if this is one enclave of it. Else copy the file into the keystore, or let the link end "
    "within it."
)


@rule(
    "KA103",
    Severity.HIGH,
    _UNREAD,
    _BRING_IN,
)
def link_leaves_keystore(enclave: Enclave) -> Iterator[Violation]:
    """A run-time file is a link out of the keystore.

    The target was not read, but a robot reads it: the enclave may be able to do anything.
    """
    for file in in_state(enclave.files.for_run_time, Status.OUTSIDE):
        remedy = LINK_AGAIN if is_linked(enclave, file) else None
        yield replace(about(enclave, file, f"{file_name(file)} {file.detail}.", undecided=True), remedy=remedy)


@rule(
    "KA120",
    Severity.MEDIUM,
    RUN_TIME_FILES,
    decision("Use a relative link that stays inside the keystore, as sros2 does."),
)
def link_holds_here_alone(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A link to a file of the keystore is an absolute path, or leads out of the keystore and back.

    It works only while the keystore stays in this place. In a copy, as on a robot, it leads nowhere, so the enclave
    does not start, or to a file that was not audited. High on a robot (--deployed). If this is the robot and the
    keystore is in its place, nothing is wrong; that cannot be seen.
    """
    own = {file.path: (file, enclave) for enclave in keystore.enclaves for file in enclave.files.for_run_time}
    shared = {file.path: (file, None) for file in keystore.layout.authorities}
    told = set[str]()
    for path, (file, enclave) in {**own, **shared}.items():
        if file.status is not Status.PRESENT or file.leaves is None or file.leaves[0] in told:
            continue
        place, target = file.leaves
        told.add(place)
        of = enclave if place == path else None  # else a link that several may go over
        yield Violation(
            f"{place} links to {shorten(target, MAX_QUOTED)}: that is {file.place} only while the keystore "
            "lies here; in a copy it is another file or none.",
            (Location(place),),
            enclave=of.path if of else None,
            severity=Severity.HIGH if context.deployed else None,
            key=target,
            remedy=LINK_AGAIN if of is not None and is_linked(of, file) else None,
        )


@rule(
    "KA104",
    Severity.HIGH,
    _UNREAD,
    decision("Name the link's target directory with `--root DIR`, or replace the link by its content."),
)
def directory_link_not_followed(keystore: Keystore) -> Iterator[Violation]:
    """A link at a place where enclaves may be leads out of the keystore.

    A robot follows it, but this audit does not. It counts as a directory, unless a run time reads it as an enclave's
    file. Links within the keystore, or into what `--root` names, are followed. Two paths to one folder are two enclaves
    of one identity, unless settings call one an alias.
    """
    for file in keystore.layout.directory_links:
        yield Violation(
            f"A link was not followed ({file.detail}): enclaves may lie behind it.",
            (Location(file.path),),
            undecided=True,
        )


@rule(
    "KA105",
    Severity.HIGH,
    _UNREAD,
    decision("Replace it by a regular file."),
    stops=True,
)
def not_a_regular_file(enclave: Enclave) -> Iterator[Violation]:
    """A run-time file is a pipe, a device or a socket.

    It is not opened: reading could hang, or give different bytes to each reader.
    """
    for file in in_state(enclave.files.for_run_time, Status.SPECIAL):
        yield about(enclave, file, f"{file_name(file)} was not read: {file.detail}.", undecided=True)


@rule(
    "KA106",
    Severity.HIGH,
    _UNREAD,
    decision("Find out what the file is; keystore files have a few kilobytes."),
)
def file_too_large(enclave: Enclave) -> Iterator[Violation]:
    """A run-time file is over 4 MB, or all files together are over their limit. A robot may still read it."""
    for file in in_state(enclave.files.for_run_time, Status.TOO_LARGE):
        yield about(enclave, file, f"{file_name(file)} {file.detail}.", undecided=True)


@rule(
    "KA107",
    Severity.HIGH,
    _UNREAD,
    READ_ALL,
)
def unreadable(keystore: Keystore) -> Iterator[Violation]:
    """A run-time file or a directory could not be read: permission was denied, or the file system failed.

    For other files, see KA121.
    """
    for directory in keystore.layout.unreadable_directories:
        yield Violation(
            f"The directory could not be read ({directory.detail}): enclaves may lie in it.",
            (Location(directory.path),),
            undecided=True,
        )
    for enclave in keystore.enclaves:
        for file in in_state(enclave.files.for_run_time, Status.UNREADABLE):
            yield about(enclave, file, f"{file_name(file)} was not read: {file.detail}.", undecided=True)


@rule(
    "KA110",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.2 and 9.4.1.3 (the signed document counts); measured: the .xml is never read",
    decision(
        "Sign the .xml if it says what is meant. Else replace it by the signed text: `openssl smime "
        "-verify -noverify -text -in FILE.p7s` prints it.",
        Act.SIGN,
    ),
    applies=lambda use, _context: use.signed.content is not None and use.genuine,
)
def unsigned_document_differs(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """The .xml beside a signed document says something else: what is reviewed is not what runs.

    Line ends do not count. Whether the meaning differs is not judged. For a document that the permissions CA did not
    sign, see KA3.
    """
    role = Role.GOVERNANCE if isinstance(use, GovernanceUse) else Role.PERMISSIONS
    layout = context.keystore.layout
    beside: dict[str, tuple[File, str | None]] = {}
    for enclave in use.enclaves:
        if role in enclave.files.unsigned:
            file = enclave.files.unsigned[role]
            beside.setdefault(file.place, (file, enclave.path))
    shared = layout.governance is not None and layout.governance.place == use.signed.file.place
    if role is Role.GOVERNANCE and shared and layout.unsigned_governance is not None:
        beside.setdefault(layout.unsigned_governance.place, (layout.unsigned_governance, sole(use.enclaves)))
    for file, path in beside.values():
        first = _first_difference(file.content, use.signed.content)
        if first is not None:
            yield Violation(
                f"{file_name(file)} is not what {use.signed.file.place} says: they differ from line {first} of "
                "the document on, and only the signed one counts.",
                (
                    Location(file.place, first),
                    use.at(use.signed.line(first), "what counts"),
                ),
                enclave=path,
            )


@rule(
    "KA122",
    Severity.INFO,
    "ROS 2 design, ROS 2 security enclaves (what run times read is signed); measured: the .xml is never read",
    decision("Keep governance.xml and permissions.xml where documents are signed; robots need only the .p7s."),
)
def unsigned_document_in_tree(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """governance.xml or permissions.xml, from which the signed documents are made, lies in the tree.

    A note where keystores are made, low on a robot (--deployed). No run time reads them, and they may differ from what
    is signed (KA110).
    """
    own = (file for enclave in keystore.enclaves for file in enclave.files.unsigned.values())
    found = sorted({file.place for file in (*own, keystore.layout.unsigned_governance) if file is not None})
    if found:
        where = "a tree that goes on a robot" if context.deployed else "the tree"
        yield Violation(
            f"{counted(len(found), 'unsigned document')} in {where}: {listed(found)}. No run time reads .xml.",
            [Location(path) for path in found],
            severity=Severity.LOW if context.deployed else None,
        )


def _first_difference(unsigned: bytes | None, signed: bytes | None) -> int | None:
    """The first line, from 1, in which the two differ apart from line ends and blank lines at the end."""
    if unsigned is None or signed is None:
        return None
    ours, theirs = (text.replace(b"\r\n", b"\n").rstrip(b"\n").split(b"\n") for text in (unsigned, signed))
    both = enumerate(zip_longest(ours, theirs), start=1)
    return next((number for number, (our, their) in both if our != their), None)


@rule(
    "KA111",
    Severity.MEDIUM,
    f"{RUN_TIME_FILES}; DDS-Security 1.1, 9.3.1 (pkcs11 URIs)",
    outside("Compare the token's content on the robot with what the keystore should hold, or use .pem files."),
)
def pkcs11_reference(enclave: Enclave) -> Iterator[Violation]:
    """A .p11 file refers to a token.

    Fast DDS reads it before the .pem file, and the token's content cannot be read here. Cyclone DDS reads the .pem
    file.
    """
    for role, file in enclave.files.pkcs11.items():
        yield Violation(
            f"{facts.READS_PKCS11} {file_name(file)} in place of {role.value}.pem, and the token's "
            "content could not be read here.",
            (Location(file.path),),
            profiles=facts.PKCS11_FIRST,
            undecided=True,
        )


@rule(
    "KA112",
    Severity.MEDIUM,
    "ros2/sros2, keystore layout (public/, private/, enclaves/)",
    outside(
        "Restore what is missing from the original keystore; `ros2 security create_keystore` would make new "
        "authorities."
    ),
)
def incomplete_keystore(keystore: Keystore) -> Iterator[Violation]:
    """Parts of the keystore are missing though it has enclaves, as after an interrupted creation or half a copy.

    The private keys of the authorities do not count: they do not belong on a robot.
    """
    if keystore.layout.expected:
        yield Violation(
            f"The keystore is incomplete: it lacks {'; '.join(keystore.layout.expected)}.",
            (Location("."),),
            key="\n".join(keystore.layout.expected),
        )


_MAX_NAME: Final = 255
"""rcl's limit of a fully qualified enclave name, RCL_ENCLAVE_NAME_MAX_LENGTH (rcl/validate_enclave_name.h)."""


@rule(
    "KA113",
    Severity.MEDIUM,
    "rcl, rcl_validate_enclave_name; ROS 2 design, topic and service names",
    decision(
        "Create the enclave again, with a name of letters, digits and underscores that does not begin with a digit."
    ),
)
def enclave_name_not_ros(enclave: Enclave) -> Iterator[Violation]:
    """The directory's name is no ROS 2 name, so no node can ask for this enclave by it.

    It may be a typing error, or meant to mislead. ROS_SECURITY_ENCLAVE_OVERRIDE is not validated, and reaches it.
    Whoever has its files can use it.
    """
    if not is_path(enclave.path) or len(enclave.path) > _MAX_NAME:
        yield Violation(
            f"{quoted(enclave.path)} is no enclave name: no node can ask for it. Expected are letters, digits "
            f"and underscores, no digit first, at most {_MAX_NAME} in all.",
            (Location(enclave.files.directory),),
        )


@rule(
    "KA114",
    Severity.LOW,
    "ros2/sros2, keystore layout (an enclave is a directory)",
    decision("Rename one of the enclaves."),
)
def enclave_names_differ_by_case(keystore: Keystore) -> Iterator[Violation]:
    """Enclaves differ only in case: on a file system that ignores case they are one directory."""
    for alike in grouped(keystore.enclaves, lambda enclave: enclave.files.directory.casefold()).values():
        if len(alike) > 1:
            yield Violation(
                f"The names of {paths(alike)} differ only in case.",
                tuple(Location(enclave.files.directory) for enclave in alike),
            )


@rule(
    "KA115",
    Severity.LOW,
    "REP 2000 (Ardent to Eloquent are past their end of life)",
    decision(
        "Create the keystore again with a supported distribution: `ros2 security create_keystore KEYSTORE`, "
        f"and for every enclave {CREATE_ENCLAVE}. Or give a copy the layout since Foxy: public/, private/, "
        "enclaves/, and links in every enclave."
    ),
)
def deprecated_layout(keystore: Keystore) -> Iterator[Violation]:
    """The layout is that of an unsupported distribution: no run time since Foxy finds enclaves in it."""
    wrote = {LayoutKind.FLAT: "Crystal, Dashing and Eloquent", LayoutKind.ARDENT: "Ardent and Bouncy"}
    distributions = wrote.get(keystore.layout.kind)
    if distributions is not None:
        yield Violation(
            f"The layout is that of {distributions} (expected public/ and enclaves/, since Foxy): supported "
            f"distributions do not find {listed(enclave.path for enclave in keystore.enclaves)} in it.",
            (Location("."),),
            key="\n".join([keystore.layout.kind.value, *(enclave.path for enclave in keystore.enclaves)]),
        )
