"""KA1: the files that every run time needs, who may write them, and what else lies in the keystore."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Act, Location, Remedy, Severity, decision, mechanical
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.participants.refusals import REQUIRED, UNGOVERNED, UNGRANTED, UNLOADED
from keystore_audit.profiles import VARIANTS, implementations
from keystore_audit.rules.registry import Context, Violation, listed, rule
from keystore_audit.rules.remedies import (
    ALLOW_DOMAINS,
    COVER_DOMAIN,
    CREATE_ENCLAVE,
    CREATE_PERMISSION,
    ISSUE_AGAIN,
    LINK_AGAIN,
    LINKED,
    RENEW_AUTHORITY,
    linked_in,
)
from keystore_audit.rules.subjects import Refusal
from keystore_audit.text import PLAIN_PATH, counted

RUN_TIME_FILES: Final = "ros2/rmw_dds_common, security.cpp: the files that an enclave must have"

_MAKE_AGAIN: Final = decision(f"Create what is missing: {CREATE_ENCLAVE}.")


_FOR_WANT_OF: Final = {  # create_enclave would make it, and put permissions that allow everything over those there are
    **dict.fromkeys(LINKED, LINK_AGAIN),
    Role.PERMISSIONS: mechanical(
        f"Review and sign permissions.xml, if there is one. Else write a policy: {CREATE_PERMISSION}.",
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
    return Violation(message, (Location(file.path),), enclave=enclave.path, undecided=undecided)


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
        return decision("Restore governance.p7s, or sign governance.xml.", Act.EDIT_GOVERNANCE)
    return _FOR_WANT_OF[role] if there else _MAKE_AGAIN


def is_linked(enclave: Enclave, file: File) -> bool:
    """Whether sros2 has a link in the file's place."""
    files = enclave.files.files
    return any(files[role].path == file.path for role in linked_in(enclave))


def renaming(keystore: Keystore) -> Callable[[str, Role], str]:
    """What to do first with a file in an enclave's folder that may be the one that it lacks in this role.

    Such files are `talker.crt`, `Cert.pem`, `permission.p7s`. Nothing where the enclave lacks nothing, or where a shell
    would read the name otherwise.
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
    RUN_TIME_FILES,
    decision(
        "Create only the missing file, as its finding says: `ros2 security create_enclave` would overwrite "
        "permissions with ones that allow everything. If there is nothing but a key: "
        f"{CREATE_ENCLAVE}."
    ),
    explains=tuple(_RESTS_ON.values()),
    stops=True,
)
def required_file_missing(enclave: Enclave) -> Iterator[Violation]:
    """A file that every run time needs is missing.

    Under Enforce the enclave's nodes do not start; under any other strategy they start without security.
    """
    for file in in_state(_required(enclave), Status.MISSING, Status.DIRECTORY):
        got = "a directory" if file.status is Status.DIRECTORY else "nothing"
        message = f"{enclave.path} cannot start: expected a file {file_name(file)}, there is {got}."
        yield replace(_absent(enclave, file, message), remedy=_how_to_make(enclave, file))


@rule(
    "KA102",
    Severity.HIGH,
    RUN_TIME_FILES,
    decision("Restore the file that the link names; a copy needs public/ and enclaves/governance.p7s.", Act.LINK),
    explains=tuple(_RESTS_ON.values()),
    stops=True,
)
def dangling_link(enclave: Enclave) -> Iterator[Violation]:
    """A run-time file is a link that leads nowhere: its target is missing, or the links go in a circle.

    A revocation list behind such a link revokes nothing, and nobody is told.
    """
    for file in in_state(_required(enclave), Status.DANGLING, Status.LOOP):
        message = f"{enclave.path} cannot start: {file_name(file)} is a link that leads nowhere ({file.detail})."
        yield replace(_absent(enclave, file, message), remedy=_how_to_make(enclave, file))
    for crl in in_state([enclave.files.files[Role.CRL]], Status.DANGLING, Status.LOOP):
        yield about(enclave, crl, f"{file_name(crl)} is a link that leads nowhere ({crl.detail}): nothing is revoked.")


@rule(
    "KA121",
    Severity.LOW,
    "ros2/sros2, keystore layouts; ros2/rmw_dds_common, security.cpp (the files that a run time reads); CWE-538",
    decision(
        "Fix what other findings say of the files, then remove them. If one has to be there, declare it in the "
        'settings: its path (`[files] foreign = ["maps/**"]`), or the hash of what was not read '
        '(`accepted = ["sha256:..."]`).'
    ),
)
def foreign_file(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """The keystore holds files or directories that neither sros2 nor the DDS-Security plugins know by place and name.

    No run time needs them, and whoever has the robot has them. They are read whatever their names: documents,
    certificates and keys in them count (KA660, KA663, KA668, KA118). What was not read may hold others: too large, not
    readable, no text, or base64 that nobody decodes. Verdicts assume that it does not, and no statement passes.
    Patterns in settings remove files from this finding, never from the reading. High on a robot (--deployed).
    """
    declared = keystore.declared
    found = [
        each
        for each in keystore.foreign
        if each.file.sha256 not in declared.accepted and not declared.names(each.file.path)
    ]
    if found:
        tops = {each.top: each.top if each.top == each.file.path else f"{each.top}/" for each in found}
        unread = [each for each in found if each.unread]
        said = f" {counted(len(unread), 'of them was', 'of them were')} not read." if unread else ""
        if any(".git" in each.file.path.split("/") for each in found):
            said += " The git history in .git may hold keys that were removed long ago."
        yield Violation(
            f"{counted(len(found), 'foreign file')} in the keystore: {listed(tops.values())}.{said}",
            [Location(path) for path in tops],
            severity=Severity.HIGH if context.deployed else None,
            key="\n".join(each.file.path for each in found),
        )


_GROUP: Final = 0o020
_EVERYBODY: Final = 0o002
_STICKY: Final = 0o1000

_AUTHORITIES: Final = (Role.IDENTITY_CA, Role.PERMISSIONS_CA)


def _written_by_others(file: File) -> bool:
    """Whether others than the owner may write it. Unknown where there are no modes: then nothing is said."""
    mode = file.mode or 0
    return bool(mode & _EVERYBODY or (mode & _GROUP and file.shared_group))


@rule(
    "KA119",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 and 9.4.1 (the CA certificates decide who is trusted); CWE-732",
    mechanical("Compare the files with what was issued: somebody may have changed them.", Act.CLOSE),
)
def writable_by_others(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Users other than the owner may write CA certificates, files of enclaves, or folders on the way to them.

    Whoever replaces both CA certificates can impersonate anyone. An older signed file can be put back, and a changed
    cert.p11 or key.p11 names something else on the token: one step less severe. High on a robot (--deployed), else
    medium, as in the checkout of a pipeline. CA certificates, folders, signed files and token addresses are a finding
    each.

    A file's group counts unless it is the owner's own: then the two have one number (0664 is usual there). A group with
    another number counts even if its user is alone in it, which no keystore can know. In a sticky folder others can add
    files but replace none, so it counts only if it is an enclave's. There they can add a crl.pem, or a `.p11`, which
    Fast DDS reads before the `.pem`. Not checked: group members, owners, access control lists, and folders above the
    keystore.
    """
    enclaves = keystore.layout.enclaves
    authorities = {
        file.place: file
        for file in (
            *keystore.layout.authorities,
            *(by[role] for each in enclaves for by in (each.files, each.pkcs11) for role in _AUTHORITIES if role in by),
        )
    }
    signed = {
        file.place: file
        for each in enclaves
        for role, file in each.files.items()
        if file.place not in authorities and role is not Role.KEY  # KA108 has that one
    }
    addresses = [file for each in enclaves for file in each.pkcs11.values() if file.place not in authorities]
    severity, less = (Severity.HIGH, Severity.MEDIUM) if context.deployed else (Severity.MEDIUM, Severity.LOW)
    trusted = "whoever replaces one issues identities or signs rights that the enclaves trust"
    own = {each.directory for each in enclaves}
    folders = [each for each in keystore.layout.folders if each.place in own or not (each.mode or 0) & _STICKY]
    yield from _found(authorities.values(), ("CA certificate", "CA certificates"), trusted, severity)
    replaced = "whoever can write in one can replace what it leads to, even CA certificates"
    yield from _found(folders, ("folder", "folders"), replaced, severity)
    again = "whoever kept an older one signed by its authority can put it back"
    yield from _found(signed.values(), ("signed file", "signed files"), again, less)
    another = "whoever can write one can make its enclave use another key or certificate of the token"
    yield from _found(addresses, ("PKCS #11 address", "PKCS #11 addresses"), another, less)


def _found(files: Iterable[File], called: tuple[str, str], so: str, severity: Severity) -> Iterator[Violation]:
    modes = {file.place: f"{(file.mode or 0) & 0o7777:04o}" for file in files if _written_by_others(file)}
    if modes:
        shown = listed(f"{place} ({mode})" for place, mode in modes.items())
        yield Violation(
            f"Users other than the owner may write {counted(len(modes), *called)}: {shown}; {so}.",
            [Location(place) for place in modes],
            severity=severity,
            key="\n".join(f"{place} {mode}" for place, mode in sorted(modes.items())),
        )


@rule(
    "KA117",
    Severity.HIGH,
    "DDS-Security 1.1, 8.2.1 and 9.4.3 (a participant is created only with valid credentials); measured",
    decision(
        "Replace what the message names by what every implementation accepts: keys on prime256v1, signatures "
        "over SHA-256, and one self-signed certificate in each CA file."
    ),
)
def enclave_does_not_start(refusal: Refusal) -> Iterator[Violation]:
    """An implementation creates no participant for the enclave, and no finding of high severity says why.

    Such a robot is no pass, even if other rules call the reason medium. The report's table of enclaves has the reasons.
    """
    for reasons, names in refusal.profiles.items():
        who = implementations(VARIANTS[name] for name in names)
        yield Violation(
            f"{refusal.enclave.path} does not start under {who}: {'; '.join(reasons)}.",
            (Location(refusal.enclave.files.directory),),
            enclave=refusal.enclave.path,
            profiles=names,
            key="\0".join(reasons),
            remedy=next((_BY_REASON[begins] for begins in _BY_REASON if _all_begin(reasons, begins)), None),
        )


_BY_REASON: Final = {UNGOVERNED: COVER_DOMAIN, (UNGRANTED,): ALLOW_DOMAINS, UNLOADED: RENEW_AUTHORITY}


def _all_begin(reasons: Sequence[str], begins: tuple[str, ...]) -> bool:
    return all(reason.startswith(begins) for reason in reasons)
