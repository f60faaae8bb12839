"""KA1: files that every run time needs, and that are not there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.participants.sight import REQUIRED
from keystore_audit.remedy import Act, Remedy, decision, mechanical
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import CREATE_ENCLAVE, CREATE_PERMISSION, ISSUE_AGAIN, LINK_AGAIN, LINKED, linked_in
from keystore_audit.text import PLAIN_PATH

RUN_TIME_FILES: Final = "ros2/rmw_dds_common, security.cpp: the files that an enclave must have"

_MAKE_AGAIN: Final = decision(f"Make what is missing: {CREATE_ENCLAVE}.")


_FOR_WANT_OF: Final = {  # create_enclave would make it, and put permissions that allow everything over those there are
    **dict.fromkeys(LINKED, LINK_AGAIN),
    Role.PERMISSIONS: mechanical(
        f"Where permissions.xml is there, read it and sign it. Else write a policy: {CREATE_PERMISSION}.",
        Act.SIGN,
    ),
    Role.CERTIFICATE: ISSUE_AGAIN,
    Role.KEY: ISSUE_AGAIN,
}

_RESTS_ON: Final = {  # the property that is violated without the file: nobody vouches, or nobody signed
    Role.IDENTITY_CA: "identities-chain-to-the-identity-ca",
    Role.PERMISSIONS_CA: "documents-signed-by-the-permissions-ca",
}


def about(enclave: Enclave, file: File, message: str, *, undecided: bool = False) -> Violation:
    """A violation about one file of an enclave."""
    return Violation(message=message, locations=(Location(path=file.path),), enclave=enclave.path, undecided=undecided)


def _absent(enclave: Enclave, file: File, message: str) -> Violation:
    files = enclave.files.files
    explains = frozenset(told for role, told in _RESTS_ON.items() if files[role].path == file.path)
    return replace(about(enclave, file, message), explains=explains)


def _how_to_make(enclave: Enclave, missing: File) -> Remedy:
    """What makes the one file that is missing, or the enclave where nothing of it is there but a key."""
    files = enclave.files.files
    role = next(role for role in REQUIRED if files[role].path == missing.path)
    there = any(files[each].status is Status.PRESENT for each in REQUIRED if each is not Role.KEY)
    if role is Role.GOVERNANCE and enclave.path == "/":  # what the others link to
        return decision("Restore it, or sign governance.xml.", Act.EDIT_GOVERNANCE)
    return _FOR_WANT_OF[role] if there else _MAKE_AGAIN


def is_linked(enclave: Enclave, file: File) -> bool:
    """Whether sros2 has a link in the file's place."""
    files = enclave.files.files
    return any(files[role].path == file.path for role in linked_in(enclave))


def renaming(keystore: Keystore) -> Callable[[str, Role], str]:
    """What to do first with a file that lies in the folder of an enclave and may be what it lacks in this role:
    `talker.crt`, `Cert.pem`, `permission.p7s`. Nothing where the enclave lacks nothing, or a shell would read the name
    otherwise.
    """
    enclaves = {enclave.files.directory: enclave for enclave in keystore.enclaves}

    def remedy(path: str, role: Role) -> str:
        enclave = enclaves.get(path.rpartition("/")[0] or ".")
        if enclave is None or enclave.files.files[role].status is not Status.MISSING or not PLAIN_PATH.fullmatch(path):
            return ""
        wanted = enclave.files.files[role].path
        return f"If it is the {wanted.rpartition('/')[2]} that {enclave.path} lacks (KA101), give it that name."

    return remedy


def in_state(files: Iterable[File], *statuses: Status) -> tuple[File, ...]:
    """Those of the files that are in one of these states, each path once."""
    return tuple({file.path: file for file in files if file.status in statuses}.values())


def _required(enclave: Enclave) -> Iterator[File]:
    """Required files; a `.p11` file may stand in for the `.pem`."""
    return (enclave.files.files[role] for role in REQUIRED if role not in enclave.files.pkcs11)


def file_name(file: File) -> str:
    """The file's name without its directory."""
    return file.path.rpartition("/")[2]


@rule(
    "KA101",
    Severity.HIGH,
    clause=RUN_TIME_FILES,
    remedy=decision(
        "Make the one file that is missing, as its finding says: `ros2 security create_enclave` would write "
        "permissions that allow everything over those there are. Where there is nothing but a key: "
        f"{CREATE_ENCLAVE}."
    ),
    explains=tuple(_RESTS_ON.values()),
    stops=True,
)
def required_file_missing(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """A file that every run time needs is not there.

    Under Enforce the enclave's nodes do not start; under any other strategy they start without security. The check
    cannot know which strategy the robot uses.
    """
    for file in in_state(_required(enclave), Status.MISSING, Status.DIRECTORY):
        got = "a directory" if file.status is Status.DIRECTORY else "nothing"
        message = f"{enclave.path} cannot start: expected a file {file_name(file)}, there is {got}."
        yield replace(_absent(enclave, file, message), remedy=_how_to_make(enclave, file))


@rule(
    "KA102",
    Severity.HIGH,
    clause=RUN_TIME_FILES,
    remedy=decision(
        "Restore the file that the link names (public/ and enclaves/governance.p7s belong to a copy).", Act.LINK
    ),
    explains=tuple(_RESTS_ON.values()),
    stops=True,
)
def dangling_link(enclave: Enclave, _context: Context) -> Iterator[Violation]:
    """A run-time file is a link that leads nowhere: its target is missing, or the links go in a circle.

    Copying a part of a keystore does that. A revocation list that is such a link revokes nothing, and nobody is told.
    """
    for file in in_state(_required(enclave), Status.DANGLING, Status.LOOP):
        message = f"{enclave.path} cannot start: {file_name(file)} is a link that leads nowhere ({file.detail})."
        yield replace(_absent(enclave, file, message), remedy=_how_to_make(enclave, file))
    for crl in in_state([enclave.files.files[Role.CRL]], Status.DANGLING, Status.LOOP):
        yield about(enclave, crl, f"{file_name(crl)} is a link that leads nowhere ({crl.detail}): nothing is revoked.")
