"""An identity at large counts wherever its certificate and its key stand, and what could not be read may be one."""

from __future__ import annotations

import base64
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
    pkcs7,
    pkcs12,
)

from keystore_audit.circumstances import Circumstances
from keystore_audit.flow import FlowQuestion, find_flow
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.keystore.root import MAX_FILE_BYTES
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.profiles import resolve
from keystore_audit.properties import Status
from tests.model.comparing import AT, authority
from tests.model.test_at_large import ADMIN, Files, added, identity, understood, written

KEY = load_pem_private_key(ADMIN.key_pem, None)
DER = ADMIN.certificate.public_bytes(Encoding.DER)
BAG = pkcs7.serialize_certificates([ADMIN.certificate], Encoding.DER)
STRANGE = DER.replace(b"\xa0\x03\x02\x01\x02", b"\xa0\x03\x02\x01\x09", 1)
"""Of a version that there is not."""
LINES = ADMIN.pem.splitlines(keepends=True)
ODD = (sum(len(line.strip().rstrip(b"=")) for line in LINES[1:-1]) - 1) % 4 or 4
UNDERLINED = b"".join([*LINES[:2], b"_" * ODD, LINES[2][ODD:], *LINES[3:]])
"""Other characters instead of some, so that one of base64 is too many."""
TRUSTED = ADMIN.pem.replace(b" CERTIFICATE", b" TRUSTED CERTIFICATE")
LARGE = b"# \n" * (MAX_FILE_BYTES // 3 + 1)
WITH_PASSWORD = BestAvailableEncryption(b"secret")


def key_as(encoding: Encoding, form: PrivateFormat, *, locked: bool = False) -> bytes:
    return KEY.private_bytes(encoding, form, WITH_PASSWORD if locked else NoEncryption())


KEY_LINE = ADMIN.key_pem.splitlines()[1]
LOCKED = key_as(Encoding.PEM, PrivateFormat.PKCS8, locked=True)
CONTAINER = pkcs12.serialize_key_and_certificates(None, KEY, ADMIN.certificate, None, WITH_PASSWORD)  # type: ignore[arg-type]


def armour(label: str, der: bytes) -> bytes:
    return f"-----BEGIN {label}-----\n{base64.encodebytes(der).decode()}-----END {label}-----\n".encode()


def way(root: Path) -> Status:
    """Whether anything gets from /talker to /motor if nobody attacks."""
    question = FlowQuestion(source="/talker", target="/motor", attackers=(Attacker.HONEST,))
    return find_flow(root, question, Circumstances(profiles=resolve(()), at=AT)).status


@pytest.mark.parametrize(
    "certificates",
    [
        {"backup/cert.der": DER},
        {"backup/cert.der": DER + b"\n"},
        {"backup/chain.p7b": armour("PKCS7", BAG)},
        {"backup/trusted.pem": TRUSTED},
        {"backup/secret.yaml": b"tls.crt: |\n" + b"".join(b"  " + line for line in LINES)},
        {"backup/secret.json": b'{"cert": "' + ADMIN.pem.replace(b"\n", b"\\n") + b'"}'},
        {"public/ghost_ca.cert.pem": ADMIN.pem},
        {"enclaves/talker/permissions.xml": ADMIN.pem},
        {"enclaves/talker/key.pem": identity("/talker", "/talker").key_pem + ADMIN.pem},
        {"enclaves/talker/cert.pem": identity("/talker", "/talker").pem + ADMIN.pem},
        {"enclaves/talker/identity_ca.cert.pem": authority("identityCA").pem + ADMIN.pem},
    ],
)
def test_its_certificate_may_stand_anywhere(certificates: Files, tmp_path: Path) -> None:
    assert way(written(tmp_path / "a", certificates)) is Status.HOLDS
    assert way(written(tmp_path / "b", {**certificates, "backup/key.pem": ADMIN.key_pem})) is Status.VIOLATED


@pytest.mark.parametrize(
    "key",
    [
        key_as(Encoding.DER, PrivateFormat.PKCS8),
        key_as(Encoding.DER, PrivateFormat.TraditionalOpenSSL),
        key_as(Encoding.PEM, PrivateFormat.TraditionalOpenSSL),
        identity("/other", "other").key_pem + ADMIN.key_pem,
        LOCKED + ADMIN.key_pem,
        b"  > " + ADMIN.key_pem.replace(b"\n", b"\n  > "),
    ],
)
def test_so_may_its_key(key: bytes, tmp_path: Path) -> None:
    for of, status in ((ADMIN, Status.VIOLATED), (identity("/admin", "somebody"), Status.HOLDS)):
        root = tmp_path / str(status)
        locked = key.startswith(LOCKED) and of is not ADMIN
        expected = Status.UNKNOWN if locked else status
        assert way(written(root, {"backup/cert.pem": of.pem, "backup/held": key})) is expected


@pytest.mark.parametrize(
    "files",
    [
        {"backup/cert.pem": ADMIN.pem, "backup/key.pem": LOCKED},
        {
            "backup/cert.pem": ADMIN.pem,
            "backup/key": key_as(Encoding.PEM, PrivateFormat.TraditionalOpenSSL, locked=True),
        },
        {"backup/cert.pem": ADMIN.pem, "backup/key": LARGE + ADMIN.key_pem},
        {"backup/cert.pem": ADMIN.pem, "enclaves/talker/key.pem": identity("/talker", "/talker").key_pem + LOCKED},
        {"backup/cert.pem": LARGE + ADMIN.pem, "backup/key.pem": ADMIN.key_pem},
        {"backup/cert.pem": armour("CERTIFICATE", STRANGE), "backup/key.pem": ADMIN.key_pem},
        {"backup/cert.patch": b"".join(b"+" + line for line in LINES), "backup/key.pem": ADMIN.key_pem},
        {"backup/cert.txt": b"".join(b"1: " + line for line in LINES), "backup/key.pem": ADMIN.key_pem},
        {"backup/cert.json": ADMIN.pem.replace(b"\n", b"\\u000a"), "backup/key.pem": ADMIN.key_pem},
        {"backup/cert.txt": LINES[0] + b" 7\n".join(LINES[1:]), "backup/key.pem": ADMIN.key_pem},
        {
            "backup/cert.txt": LINES[0] + b"".join(LINES[1:-1]) + b"# note: whole\n" + LINES[-1],
            "backup/key.pem": ADMIN.key_pem,
        },
        {"backup/cert.txt": UNDERLINED, "backup/key.pem": ADMIN.key_pem},
    ],
)
def test_what_could_not_be_read_may_be_one(files: Files, tmp_path: Path) -> None:
    root = written(tmp_path, files)
    assert way(root) is Status.UNKNOWN
    found = {system.may: bool(added(system)) for system in understood(root)}
    assert found == {True: True, False: False}


@pytest.mark.parametrize(
    "files",
    [
        {"backup/key.pem": LOCKED},
        {"backup/cert.pem": identity("/admin", "admin", authority("other")).pem, "backup/key.pem": LOCKED},
        {"backup/cert.pem": identity("/nobody", "admin").pem, "backup/key.pem": LOCKED},
        {"backup/cert.pem": ADMIN.pem, "private/ca.key.pem": LOCKED},
        {"backup/cert.pem": ADMIN.pem, "backup/large": LARGE},
        {"backup/ca.pem": authority("identityCA").pem, "private/ca.key.pem": authority("identityCA").key_pem},
        {"backup/ca.pem": authority("permissionsCA").pem, "backup/key.pem": LOCKED},
        {"backup/README": b"-----BEGIN CERTIFICATE-----\nMIIB...\n-----END CERTIFICATE-----\n"},
        *(
            {"backup/README": LINES[0] + written + LINES[-1], "backup/key.pem": ADMIN.key_pem}
            for written in (
                *(LINES[1][:length] + b"...\n" for length in (61, 62, 63, 64)),
                LINES[1] + b"[the rest of the certificate is left out here for clarity]\n",
                b"".join(LINES[1:-2]) + b"  # ... and so on\n",
                LINES[1] + b"(shortened: the rest is in cert.pem)\n",
                LINES[1] + b"# note: shortened\n...\n",
                LINES[1][:60] + b"... # note: shortened\n",
                b"# note: shortened\n" + LINES[1] + b"...\n",
            )
        ),
        {
            "backup/README": b"tls.crt: LS0tLS1CRUdJTiBDRVJUSUZJQ0FURS0tLS0tCk1JSUI...\n",
            "backup/key.pem": ADMIN.key_pem,
        },
        {"backup/README": b"tls.key: LS0tLS1CRUdJTiBQUklWQVRFIEtFWS0tLS0tCg==\n", "backup/cert.pem": ADMIN.pem},
        {"backup/README": base64.b64encode(DER)[:64] + b"...\n", "backup/key.pem": ADMIN.key_pem},
        {"backup/README": b"Look for -----BEGIN CERTIFICATE-----, in the first or a later line of the file."},
        *(
            {
                "backup/README": b"-----BEGIN PRIVATE KEY-----\n%s...\n-----END PRIVATE KEY-----\n" % beginning,
                "backup/cert.pem": ADMIN.pem,
            }
            for beginning in (b"", b"MIIEv", b"# note: it is long\nMIIEv", KEY_LINE, KEY_LINE + b"\n# note: ")
        ),
    ],
)
def test_what_is_none_leaves_no_doubt(files: Files, tmp_path: Path) -> None:
    """Also the key of an authority, with a password, where its place says so."""
    assert way(written(tmp_path, files)) is Status.HOLDS


INDENTED = b"  " + ADMIN.key_pem.replace(b"\n", b"\n  ")


@pytest.mark.parametrize(
    "key",
    [
        identity("/talker", "/talker").key_pem + INDENTED,
        INDENTED + identity("/talker", "/talker").key_pem,
        key_as(Encoding.DER, PrivateFormat.PKCS8),
    ],
)
def test_its_key_may_stand_in_that_of_an_enclave(key: bytes, tmp_path: Path) -> None:
    """Where no run time reads it, or the enclave has none that can be read."""
    root = written(tmp_path, {"backup/cert.pem": ADMIN.pem, "enclaves/talker/key.pem": key})
    assert [each.key for each in read_keystore(root).identities.found] == ["enclaves/talker/key.pem"]


@pytest.mark.parametrize(
    "files",
    [
        {"backup/admin.p12": CONTAINER},
        {"backup/cert.pem": ADMIN.pem, "backup/key.yaml": b"tls.key: " + base64.b64encode(ADMIN.key_pem)},
        {"backup/cert.pem": ADMIN.pem.decode().encode("utf-16-le"), "backup/key.pem": ADMIN.key_pem},
        {"backup/admin": CONTAINER + bytes(MAX_FILE_BYTES)},
        {"backup/cert.pem": ADMIN.pem, "backup/key": key_as(Encoding.DER, PrivateFormat.PKCS8, locked=True)},
        {"backup/chain.p7b": BAG, "backup/key.pem": ADMIN.key_pem},
        {"backup/cert.txt": b"".join(LINES[1:-1]), "backup/key.pem": ADMIN.key_pem},
        {"backup/secret.yaml": b"tls.crt: " + base64.b64encode(ADMIN.pem), "backup/key.pem": ADMIN.key_pem},
        {"backup/both": DER + key_as(Encoding.DER, PrivateFormat.PKCS8)},
    ],
)
def test_what_was_not_read_is_assumed_to_hold_none(files: Files, tmp_path: Path) -> None:
    root = written(tmp_path, files)
    assert way(root) is Status.HOLDS
    assert len(read_keystore(root).unread_foreign) == 1


@pytest.mark.parametrize("limit", ["unmanaged.MAX_ARMOURED", "private_key.MAX_HELD_KEYS"])
def test_what_is_too_much_to_look_at_may_be_one(limit: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = identity("/other", "other")
    keys = {"backup/keys.pem": other.key_pem + identity("/third", "third").key_pem}
    root = written(tmp_path, {"backup/certs.pem": other.pem + ADMIN.pem, **keys})
    assert way(root) is Status.HOLDS
    monkeypatch.setattr(f"keystore_audit.keystore.{limit}", 1)
    assert way(root) is Status.UNKNOWN
