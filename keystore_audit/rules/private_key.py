"""KA1 and KA2: private keys, and keys whose private half others have. Only facts about them, never a byte."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from collections.abc import Set as AbstractSet
from typing import Final

from keystore_audit.findings import Act, Location, Remedy, Severity, decision, mechanical
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.files import UNREAD_BUT_THERE, File
from keystore_audit.keystore.key_quality import (
    Material,
    Place,
    material_of_keystore,
    published_keys,
    weaknesses,
)
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.private_key import PrivateKey
from keystore_audit.model.inventory import beside_enclaves
from keystore_audit.rules.files import renaming
from keystore_audit.rules.registry import Context, Violation, defective, listed, located, of_kinds, quoted, rule
from keystore_audit.rules.remedies import ISSUE_AGAIN

_OTHERS: Final = 0o077
"""Permission bits of group and others."""

_NEW_CA: Final = {Role.PERMISSIONS_CA: Act.NEW_PERMISSIONS_CA, Role.IDENTITY_CA: Act.NEW_IDENTITY_CA}
"""What makes another authority in a role."""


def authority_anew(roles: Collection[Role], text: str) -> Remedy | None:
    """How to replace an authority with these roles, after what `text` says; None: it has none."""
    acts = [act for role, act in _NEW_CA.items() if role in roles]
    return decision(text, *acts) if acts else None


_READ_BY_GROUP: Final = 0o040


def _open_to_others(file: File, group: int | None = None) -> bool:
    """Whether other users may read it than those of the `group`. Unknown where there are no modes: nothing is said."""
    allowed = _READ_BY_GROUP if group is not None and file.group == group else 0
    return file.mode is not None and bool(file.mode & _OTHERS & ~allowed)


def _readable(file: File, whose: str, context: Context) -> Violation:
    mode = f"{(file.mode or 0) & 0o777:04o}"
    return Violation(
        f"The private key of {whose} has mode {mode} (expected 0600): other users may read it.",
        (Location(file.place),),
        severity=None if context.deployed else Severity.INFO,
        key=mode,
    )


@rule(
    "KA108",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 (the private key is the identity); CWE-732",
    mechanical("", Act.CLOSE_KEY),
    applies=lambda enclave, _context: enclave.key is not None and enclave.key.file.mode is not None,
)
def private_key_readable_by_others(enclave: Enclave, context: Context) -> Iterator[Violation]:
    """Other users of the machine may read the private key, and then act as the enclave.

    sros2 writes keys with mode 0644. A note where keystores are made, since version control holds no such modes; high
    on a robot (--deployed). The group that settings name (`key_group`) may read it. Not checked: folders above it,
    owners, access control lists.
    """
    if enclave.key is not None and _open_to_others(enclave.key.file, context.keystore.declared.key_group):
        yield _readable(enclave.key.file, enclave.path, context)


@rule(
    "KA109",
    Severity.INFO,
    "ROS 2 design, ROS 2 security enclaves (private/ does not leave the machine where keystores are made)",
    decision("Ship only enclaves/ and public/, and keep private/ where identities are issued."),
)
def ca_private_key_in_tree(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """The private key of an authority lies in the tree: whoever has it issues identities or signs rights.

    A note where keystores are made, critical on a robot (--deployed). Always critical in an enclave's key.pem, even as
    a second key. If enclaves carry it in another file, see KA118. Copies outside the tree are not seen.
    """
    subjects = _authorities(keystore)
    known = {key.file.place: key.key for key in keystore.authority_keys}
    told = {file.place for file in _keys_on_robots(keystore, context)}
    for file in keystore.layout.authority_keys:
        if file.status in UNREAD_BUT_THERE and file.place not in told:
            subject = subjects.get(known.get(file.place) or "")
            whose = f"of {quoted(subject)}" if subject is not None else "of an authority"
            where = "a tree that goes on a robot" if context.deployed else "the tree; keep it off robots"
            yield Violation(
                f"The private key {whose} is in {where}.",
                (Location(file.place),),
                severity=Severity.CRITICAL if context.deployed else None,
                key=whose,
            )
    for enclave in keystore.enclaves:
        for key, line in _keys_of(enclave):
            if key is not None and key in subjects and enclave.key is not None:
                yield Violation(
                    f"{enclave.path} has the private key of the authority {quoted(subjects[key])}: it can "
                    "issue any identity or sign any right.",
                    (Location(enclave.key.file.place, line),),
                    enclave=enclave.path,
                    severity=Severity.CRITICAL,
                    key=subjects[key],
                    remedy=_authority_anew({key}, keystore, f"Give {enclave.path} its own key."),
                )


def _keys_of(enclave: Enclave) -> Iterator[tuple[str | None, int | None]]:
    """The private keys in the enclave's key.pem, with the lines of those behind the first."""
    if enclave.key is not None:
        lines: dict[str | None, int | None] = {enclave.key.key: None}
        for other in enclave.key.others:
            lines.setdefault(other.key, other.line)
        yield from lines.items()


_TAKE_OUT: Final = (
    "Remove the key from the file, and make a new one where it belongs: whoever had the file has the key. Issue and "
    "sign again what the old key issued and signed."
)


@rule(
    "KA118",
    Severity.CRITICAL,
    "ROS 2 design, ROS 2 security enclaves (a private key belongs to one enclave or to private/); CWE-522",
    decision(_TAKE_OUT),
)
def private_key_where_robots_have_it(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A private key is in a file that enclaves carry or that lies beside them, and is not an enclave's key.pem.

    `openssl req -x509 -keyout ca.pem -out ca.pem` writes such a file; as a CA file it goes on every robot. Nobody needs
    a key there. If a certificate of the keystore has it, the finding names the holder, for the first 64 such files. A
    second key in key.pem counts; on a robot (--deployed), so does a key in any other file, as in a backup. For files
    with authorities' names, see KA109. Keys are seen in PEM anywhere in a file, and in DER; a text that only quotes a
    key's first line holds none.
    """
    holders = _holders(keystore)
    held = {key.file.place: key for key in (*keystore.authority_keys, *keystore.further_keys)}
    rename = renaming(keystore)
    for file in _keys_on_robots(keystore, context):
        key = held.get(file.place)
        own = rename(file.place, Role.KEY)
        anew = _authority_anew({*key.keys}, keystore, "Remove the key from the file.") if key else None
        whose = _whose(key, holders) if key else ""
        yield Violation(
            f"A private key is in {file.place}, which goes on robots{whose}.",
            (Location(file.place),),
            key=f"{file.place} {file.sha256}{whose}",
            remedy=decision(f"{own} Else: {_TAKE_OUT}") if own and anew is None else anew,
        )
    for enclave in keystore.enclaves:
        if enclave.key is not None:
            yield from _second_keys(enclave.path, enclave.key, holders)


def _keys_on_robots(keystore: Keystore, context: Context) -> Iterator[File]:
    """The files with private keys that enclaves carry or that lie beside them, but for each one's own key.pem."""
    own = {enclave.key.file.place for enclave in keystore.enclaves if enclave.key is not None}
    beside = beside_enclaves(keystore)
    authorities = {file.place for file in keystore.layout.authority_keys}
    for file in keystore.private_keys:
        if (beside(file.place) or (context.deployed and file.place not in authorities)) and file.place not in own:
            yield file


def _authority_anew(keys: AbstractSet[str | None], keystore: Keystore, first: str) -> Remedy | None:
    """How to replace the authority that has one of these keys, in each of its roles, after what is done `first`.

    None: no authority has one.
    """
    trusted = {
        role: {certificate.key for enclave in keystore.enclaves for certificate in enclave.trusts(role)}
        for role in _NEW_CA
    }
    return authority_anew(
        [role for role in trusted if trusted[role] & keys],
        f"{first} Replace the authority's key: whoever had the file has it.",
    )


def _authorities(keystore: Keystore) -> dict[str, str]:
    """By key, the subject of each authority that an enclave trusts."""
    found: dict[str, str] = {}
    for enclave in keystore.enclaves:
        for role in _NEW_CA:
            for certificate in enclave.trusts(role):
                found.setdefault(certificate.key, certificate.subject)
    return found


def _second_keys(enclave: str, key: PrivateKey, holders: Mapping[str | None, str]) -> Iterator[Violation]:
    keys = {other.line: other.key for other in key.others}
    for defect in of_kinds(key.defects, Kind.SECOND_KEY):
        second = keys.get(defect.line or 0)
        whose = f", that of {holders[second]}" if second in holders else ""
        yield Violation(
            f"{enclave} has a second private key{whose}: {defect.detail}.",
            (located(defect),),
            enclave=enclave,
            key=f"second {defect.path} {second}{whose}",
        )


def _whose(key: PrivateKey, holders: Mapping[str | None, str]) -> str:
    """`: that of the authority 'CN=CA'`, or several holders; nothing where none is known."""
    named = dict.fromkeys(holders[each] for each in key.keys if each in holders)
    return f": {'that' if len(named) == 1 else 'those'} of {listed(named)}" if named else ""


def _holders(keystore: Keystore) -> dict[str | None, str]:
    """By key, the authority or enclave whose it is, in words; nobody has None, a key that could not be read."""
    found: dict[str | None, str] = {
        key: f"the authority {quoted(subject)}" for key, subject in _authorities(keystore).items()
    }
    for enclave in keystore.enclaves:
        if enclave.identity is not None:
            found.setdefault(enclave.identity.key, enclave.path)
    return found


@rule(
    "KA116",
    Severity.HIGH,
    "CWE-732",
    mechanical("", Act.CLOSE_KEY),
)
def ca_key_readable_by_others(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Other users of the machine may read an authority's private key, and then issue identities or sign rights.

    A note where keystores are made, high on a robot (--deployed). A key in the wrong place (KA118) counts too: to
    accept its place is not to accept who may read it. Not checked: folders above it, owners, access control lists.
    """
    for file in keystore.layout.authority_keys:
        if _open_to_others(file):
            yield _readable(file, "an authority", context)


@rule(
    "KA209",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 (dds.sec.auth.private_key is the certificate's); measured",
    ISSUE_AGAIN,
    applies=lambda enclave, _context: enclave.key is not None and enclave.key.key is not None,
    stops=True,
)
def key_does_not_match_certificate(enclave: Enclave) -> Iterator[Violation]:
    """key.pem belongs to another certificate than cert.pem.

    Fast DDS refuses the participant; Cyclone DDS starts it and never completes a handshake (measured).
    """
    first = enclave.identity
    key = enclave.key
    if first is not None and key is not None and key.key is not None and key.key != first.key:
        yield Violation(
            f"The private key of {enclave.path} ({key.key_kind}) is not that of its certificate "
            f"({first.key_kind}, {quoted(first.subject)}): no handshake succeeds.",
            (
                Location(key.file.place),
                located(first, "the certificate"),
            ),
        )


@rule(
    "KA210",
    Severity.HIGH,
    "RFC 5958; RFC 7468, 10",
    ISSUE_AGAIN,
    applies=lambda enclave, _context: enclave.key is not None,
    stops=True,
)
def private_key_unreadable(enclave: Enclave) -> Iterator[Violation]:
    """The private key is in a form that we do not read, so it is unknown whether the enclave can start.

    A build of OpenSSL with other providers may read it.
    """
    defects = enclave.key.defects if enclave.key else ()
    yield from defective(
        of_kinds(defects, Kind.KEY_UNREADABLE), "whether the enclave can start is unknown.", undecided=True
    )


@rule(
    "KA211",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 (dds.sec.auth.password); measured: ROS 2 passes none",
    decision(
        "Remove the password: `openssl pkey -in key.pem -out new.pem`, then replace key.pem by new.pem (mode 0600)."
    ),
    applies=lambda enclave, _context: enclave.key is not None,
    stops=True,
)
def private_key_encrypted(enclave: Enclave) -> Iterator[Violation]:
    """The private key needs a password, and ROS 2 passes none to the implementation, so the enclave cannot start."""
    if enclave.key is not None and enclave.key.encrypted:
        defects = list(of_kinds(enclave.key.defects, Kind.KEY_ENCRYPTED))
        found = listed(dict.fromkeys(each.detail for each in defects))
        yield Violation(
            f"{enclave.path} cannot start: its private key needs a password{f' ({found})' if found else ''}.",
            (Location(enclave.key.file.place, defects[0].line if defects else None),),
        )


_ANEW: Final = decision(
    "Replace every such key, with a random generator that you trust, and let nothing accept the old one. Authorities "
    "come first: issue and sign again all that they issued and signed. For an enclave, delete cert.pem and key.pem, "
    "and use the script of `keystore-audit explain KA101 --for KEYSTORE`."
)


@rule(
    "KA230",
    Severity.CRITICAL,
    "NIST SP 800-57 Part 1, 5.6 and 6.2; FIPS 186-5, A.1 to A.3; CWE-330, CWE-323, CWE-321",
    _ANEW,
)
def private_key_others_have(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Anybody can have the private half of a key, and act as that identity or authority.

    Checked are the keys of all certificates that were read, and all ECDSA signatures. Those of the run's other
    keystores are included. Found are signatures by one key over different content that share r, if a key here made
    them. (The key of an authority was computed from two public .p7s files.) Found are EC scalars within 2^8 of zero,
    and points that are negatives of each other. Found is RSA with an exponent below 65537, a prime factor below 2^16,
    or primes that Fermat's method finds in 100 steps. So is RSA with a factor that another key of the run has, or with
    the fingerprint of ROCA (Nemec and others, CCS 2017).

    No report holds a private value. Keys of keystore-audit's samples are published: info where keystores are made,
    critical on a robot (--deployed). Not found are Debian's weak keys of 2008, and keys that were made badly in another
    way.
    """
    own, others = material_of_keystore(keystore), context.beside.shared.material if context.beside else Material()
    keys = {each.key for each in own.keys}
    for weakness in weaknesses(Material(keys=own.keys + others.keys, signed=own.signed + others.signed)):
        here = [place for place in weakness.places if place.root == keystore.root]
        if keys.isdisjoint(weakness.keys) and not here:
            continue
        yield Violation(
            f"A key {weakness.fact}.",
            _locations(weakness.places, keystore.root),
            undecided=weakness.undecided,
            key=f"{weakness.fact} {' '.join(sorted(weakness.keys))}",
        )
    published = [each for each in own.keys if each.key in published_keys()]
    if published:
        keys_here = "1 key here, which was" if len(published) == 1 else f"{len(published)} keys here, which were"
        robot = "" if context.deployed else " On a robot nothing else here would count (critical with --deployed)."
        yield Violation(
            f"Anybody has the private half of {keys_here} published with a sample.{robot}",
            _locations((each.place for each in published), keystore.root),
            severity=None if context.deployed else Severity.INFO,
            key=f"published {' '.join(sorted(each.key for each in published))}",
        )


def _locations(found: Iterable[Place], root: str) -> list[Location]:
    """Here first; those of other keystores by where they lie."""
    ordered = sorted(found, key=lambda place: (place.root != root, place.root, place.path, place.line or 0))
    return [
        Location(place.path, place.line)
        if place.root == root
        else Location(f"{place.root.rstrip('/')}/{place.path}", place.line, beside=True)
        for place in ordered
    ]
