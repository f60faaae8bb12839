"""KA230: keys whose private half others have or can compute, each fault made with real keys beside good ones."""

from __future__ import annotations

import base64
import json
import re
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature, encode_dss_signature

from keystore_audit.keystore import weak_numbers
from keystore_audit.keystore.cms import SignerInfo, read_signed_data
from keystore_audit.keystore.key_quality import (
    Material,
    Place,
    PublicKey,
    Signed,
    published_keys,
    weaknesses,
)
from tests.cli.keystores import answer, document_of, grant_of, rule
from tests.keystore.builder import (
    GOVERNANCE,
    PrivateKey,
    authority,
    certificate,
    evidence,
    signed_document,
)
from tests.keystore.builder import Signed as Issued
from tools import published_keys as tool

AT = "2026-11-21T12:00:00Z"
ORDER = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
"""Of P-256 (SEC 2 version 2, 2.4.2)."""

P256 = ec.SECP256R1()


# Faults


def prime(bits: int) -> int:
    """A prime of OpenSSL's making, half of a modulus."""
    return rsa.generate_private_key(65537, 2 * bits).private_numbers().p


def following(number: int) -> int:
    """The next prime."""
    number += 1 + number % 2
    while any(pow(base, number - 1, number) != 1 for base in (2, 3, 5, 7)):
        number += 2
    return number


def rsa_of(p: int, q: int, e: int = 65537) -> rsa.RSAPrivateKey:
    d = rsa.rsa_recover_private_exponent(e, p, q)
    parts = (rsa.rsa_crt_dmp1(d, p), rsa.rsa_crt_dmq1(d, q), rsa.rsa_crt_iqmp(p, q))
    public = rsa.RSAPublicNumbers(e, p * q)
    return rsa.RSAPrivateNumbers(p, q, d, *parts, public).private_key(unsafe_skip_rsa_key_validation=True)


def roca_prime(bits: int) -> int:
    """k * M + (65537^a mod M), as Infineon's library made them."""
    m = 1
    for each in (2, *(n for n in range(3, 168, 2) if all(n % d for d in range(3, n, 2)))):
        m *= each
    while True:
        found = (secrets.randbits(bits - m.bit_length()) | 1 << bits - m.bit_length() - 1) * m + pow(
            65537, secrets.randbits(64), m
        )
        if all(pow(base, found - 1, found) == 1 for base in (2, 3, 5)):
            return found


def exponent_of_three() -> rsa.RSAPrivateKey:
    return rsa.generate_private_key(3, 2048)


def close_primes() -> rsa.RSAPrivateKey:
    p = prime(1024)
    return rsa_of(p, following(p + secrets.randbits(500)))


def scalar(value: int) -> ec.EllipticCurvePrivateKey:
    return ec.derive_private_key(value % ORDER, P256)


KEYS: dict[str, tuple[Callable[[], PrivateKey], str]] = {
    "a small scalar": (lambda: scalar(173), "private scalar"),
    "a scalar below the order": (lambda: scalar(-7), "private scalar"),
    "an exponent of 3": (exponent_of_three, "exponent 3, expected 65537"),
    "close primes": (close_primes, "Fermat's method"),
    "a small factor": (lambda: rsa_of(65_521, prime(1024)), "prime below 65,536"),
    "ROCA": (lambda: rsa_of(roca_prime(1024), roca_prime(1024)), "ROCA"),
}
GOOD: dict[str, Callable[[], PrivateKey]] = {
    "a scalar beyond the bound": lambda: scalar(1 << 40),
    "a scalar of chance": lambda: ec.generate_private_key(P256),
    "RSA of OpenSSL": lambda: rsa.generate_private_key(65537, 2048),
    "primes that differ in their upper half": lambda: rsa_of(prime(1024), prime(1024)),
}


# Keystores


def keystore(
    root: Path,
    talker: Issued | None = None,
    *,
    identity: Issued | None = None,
    permissions: Issued | None = None,
    sign: Callable[[bytes, Issued], bytes] = signed_document,
) -> Path:
    """/talker and /listener under two authorities."""
    identity, permissions = identity or authority("identityCA"), permissions or authority("permissionsCA")
    governance = signed_document(GOVERNANCE, permissions)
    for path, given in (("/talker", talker), ("/listener", None)):
        own = given or certificate(path, identity)
        folder = root / "enclaves" / path.strip("/")
        folder.mkdir(parents=True)
        for file, content in {
            "cert.pem": own.pem,
            "key.pem": own.key_pem,
            "identity_ca.cert.pem": identity.pem,
            "permissions_ca.cert.pem": permissions.pem,
            "permissions.p7s": sign(document_of(grant_of(path, rule((f"rt{path}",)))), permissions),
            "governance.p7s": governance,
        }.items():
            (folder / file).write_bytes(content)
    return root


def found(*roots: Path, options: tuple[str, ...] = ()) -> list[list[dict[str, Any]]]:
    """The findings of KA230 of each keystore."""
    _code, out = answer("audit", *roots, "--engine", "native", "--at", AT, "-f", "json", *options)
    document = json.loads(out)
    reports = document.get("reports", [document])
    return [[each for each in report["findings"] if each["code"] == "KA230"] for report in reports]


@pytest.mark.parametrize("what", KEYS)
def test_a_bad_key_is_critical(what: str, tmp_path: Path) -> None:
    make, says = KEYS[what]
    identity, key = authority("identityCA"), make()
    own = certificate("/talker", identity, key=key)
    ((one,),) = found(keystore(tmp_path / "k", own, identity=identity))
    assert one["severity"] == "critical"
    assert says in one["message"]
    assert one["locations"][0]["path"] == "enclaves/talker/cert.pem"
    numbers = key.private_numbers()  # type: ignore[union-attr]
    secret = numbers.private_value if isinstance(key, ec.EllipticCurvePrivateKey) else numbers.p  # type: ignore[union-attr]
    assert not re.search(rf"\b{secret}\b", json.dumps(one))


@pytest.mark.parametrize("what", GOOD)
def test_a_good_key_is_not_found(what: str, tmp_path: Path) -> None:
    identity = authority("identityCA")
    assert found(keystore(tmp_path / "k", certificate("/talker", identity, key=GOOD[what]()), identity=identity)) == [
        []
    ]


# Keys beside each other, in one keystore and in a fleet


def pairs() -> dict[str, tuple[PrivateKey, PrivateKey, str]]:
    p, value = prime(1024), secrets.randbits(250)
    return {
        "shares a prime factor": (rsa_of(p, prime(1024)), rsa_of(p, prime(1024)), "RSA"),
        "is the negative of another": (scalar(value), scalar(-value), "EC"),
    }


def test_two_keys_that_tell_of_each_other_are_found_in_one_keystore_and_in_a_fleet(tmp_path: Path) -> None:
    for number, (says, (one, other, _kind)) in enumerate(pairs().items()):
        identity = authority("identityCA", key=other)
        both = keystore(tmp_path / f"both{number}", certificate("/talker", identity, key=one), identity=identity)
        ((finding,),) = found(both)
        assert says in finding["message"]
        assert {place["path"] for place in finding["locations"]} == {
            "enclaves/talker/cert.pem",
            "enclaves/listener/identity_ca.cert.pem",
        } or len(finding["locations"]) == 2
        left, right, third = (tmp_path / f"{side}{number}" for side in ("left", "right", "third"))
        for root, key in ((left, one), (right, other), (third, ec.generate_private_key(P256))):
            mine = authority("identityCA")
            keystore(root, certificate("/talker", mine, key=key), identity=mine)
        assert found(left) == found(right) == [[]], "each for itself is as good as any"
        ours, theirs, nothing = found(left, right, third)
        for found_there, elsewhere in ((ours, right), (theirs, left)):
            (told,) = found_there
            assert says in told["message"]
            assert told["locations"][0]["path"] == "enclaves/talker/cert.pem"
            assert told["locations"][1]["path"] == f"{elsewhere}/enclaves/talker/cert.pem"
        assert nothing == []


# Signatures that share r


def made_with(key: ec.EllipticCurvePrivateKey, nonce: int, hashed: bytes) -> bytes:
    """An ECDSA signature by the book (FIPS 186-5, 6.4.1)."""
    r = scalar(nonce).public_key().public_numbers().x % ORDER
    s = pow(nonce, -1, ORDER) * (int.from_bytes(hashed, "big") + r * key.private_numbers().private_value) % ORDER
    return encode_dss_signature(r, s)


BASE64 = re.compile(rb"(?:[A-Za-z0-9+/=]{60,}\r?\n)+[A-Za-z0-9+/=]*")
"""The signature of a document."""


def signer_of(p7s: bytes) -> tuple[bytes, SignerInfo, bytes]:
    """The signature's DER, what it says of its signer, and the digest of what is signed."""
    der = base64.b64decode(BASE64.findall(p7s)[-1])
    (info,) = read_signed_data(der).signers
    hashing = hashes.Hash(hashes.SHA256())
    hashing.update(info.signed or b"")
    return der, info, hashing.finalize()


def signer_with(nonce: int) -> Callable[[bytes, Issued], bytes]:
    """As `signed_document`, with this nonce: the signature of openssl is exchanged for one of the same length."""

    def sign(content: bytes, signer: Issued) -> bytes:
        while True:
            document = signed_document(content, signer)
            der, info, hashed = signer_of(document)
            own = made_with(signer.key, nonce, hashed)  # type: ignore[arg-type]
            if len(own) == len(info.signature):
                changed = base64.encodebytes(der.replace(info.signature, own)).strip()
                return document.replace(BASE64.findall(document)[-1], changed)

    return sign


def values(p7s: bytes) -> tuple[int, int, int]:
    """r, s and the digest, as whoever finds the file sees them."""
    _der, info, hashed = signer_of(p7s)
    return (*decode_dss_signature(info.signature), int.from_bytes(hashed, "big"))


def test_two_documents_signed_with_one_nonce_give_the_key_of_the_authority_away(tmp_path: Path) -> None:
    permissions = authority("permissionsCA")
    root = keystore(tmp_path / "k", permissions=permissions, sign=signer_with(secrets.randbits(250)))
    ((one,),) = found(root)
    assert one["severity"] == "critical"
    assert "ECDSA signatures over different content with one nonce" in one["message"]
    assert {place["path"] for place in one["locations"]} == {
        f"enclaves/{name}/permissions.p7s" for name in ("talker", "listener")
    }
    (r, s, digest), (r2, s2, digest2) = (
        values((root / f"enclaves/{name}/permissions.p7s").read_bytes()) for name in ("talker", "listener")
    )
    assert r == r2
    nonce = (digest - digest2) * pow(s - s2, -1, ORDER) % ORDER
    private = (s * nonce - digest) * pow(r, -1, ORDER) % ORDER
    assert scalar(private).public_key() == permissions.key.public_key(), "the finding is true"
    assert str(private) not in json.dumps(one)
    assert f"{private:x}" not in json.dumps(one)
    assert found(keystore(tmp_path / "good", permissions=permissions)) == [[]]


def test_and_so_do_documents_on_two_robots_and_before_and_after_a_change(tmp_path: Path) -> None:
    identity, permissions = authority("identityCA"), authority("permissionsCA")
    nonce = signer_with(secrets.randbits(250))
    roots = []
    for name, signs in (("left", "/talker"), ("right", "/listener")):

        def sign(content: bytes, signer: Issued, signs: str = signs) -> bytes:
            return (nonce if f"CN={signs}<".encode() in content else signed_document)(content, signer)

        roots.append(keystore(tmp_path / name, identity=identity, permissions=permissions, sign=sign))
    assert [found(root) for root in roots] == [[[]], [[]]]
    for (one,), other in zip(found(*roots), reversed(roots), strict=True):
        assert "with one nonce" in one["message"]
        assert one["locations"][1]["path"].startswith(f"{other}/enclaves/")
    code, out = answer("diff", *roots, "--at", AT, "-f", "json")
    (change,) = (each for each in json.loads(out)["changes"] if each["kind"] == "weak-key")
    assert (code, change["direction"], change["layer"]) == (1, "gained", "trust")
    assert "with one nonce" in change["what"]
    same = json.loads(answer("diff", roots[0], roots[0], "--at", AT, "-f", "json")[1])
    assert same["changes"] == []


def test_a_signature_that_nobody_here_made_and_a_copy_are_no_sign() -> None:
    """Only what verifies counts: r can be copied by anybody."""
    key = ec.generate_private_key(P256)
    digests = [secrets.token_bytes(32) for _ in range(2)]
    nonce = secrets.randbits(250)
    mine = [decode_dss_signature(made_with(key, nonce, digest)) for digest in digests]
    numbers = key.public_key().public_numbers()
    place = Place(root="k", path="p", line=None)
    public = PublicKey(key="0", curve="secp256r1", numbers=(numbers.x, numbers.y), place=place)

    def told(*signed: tuple[int, int, bytes]) -> list[str]:
        made = tuple(Signed(r=r, s=s, hashed=hashed, place=place) for r, s, hashed in signed)
        return [each.fact for each in weaknesses(Material(keys=(public,), signed=made))]

    (r, s), (_r, s2) = mine
    assert len(told((r, s, digests[0]), (r, s2, digests[1]))) == 1
    assert told((r, s, digests[0]), (r, s, digests[0])) == []
    assert told((r, s, digests[0]), (r, s2 + 1, digests[1])) == []
    assert told((r, s, digests[0]), (r + 1, s2, digests[1])) == []
    # the same point's negative has the same r
    assert len(told((r, s, digests[0]), (r, ORDER - s2, digests[1]))) == 1


def test_more_than_can_be_tried_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("keystore_audit.keystore.key_quality.MAX_VERIFIED", 3)
    place = Place(root="k", path="p", line=None)
    numbers = [ec.generate_private_key(P256).public_key().public_numbers() for _ in range(3)]
    keys = tuple(
        PublicKey(key=str(n), curve="secp256r1", numbers=(each.x, each.y), place=place)
        for n, each in enumerate(numbers)
    )
    signed = tuple(Signed(r=5, s=6, hashed=secrets.token_bytes(32), place=place) for _ in range(2))
    assert [each.undecided for each in weaknesses(Material(keys=keys, signed=signed))] == [True]


# Published keys


def test_the_list_of_published_keys_is_complete() -> None:
    """Else run tools/published_keys.py."""
    expected = set().union(*map(tool.keys_of, tool.samples()))
    assert published_keys() == expected
    for name in ("stock/talker_listener", "healthy/turtlesim"):
        pem = next((tool.SAMPLES / name).rglob("cert.pem")).read_bytes()
        assert evidence(Issued(ec.generate_private_key(P256), x509.load_pem_x509_certificate(pem))).key in expected


def test_a_sample_is_what_it_says_until_it_goes_on_a_robot(tmp_path: Path) -> None:
    sample = tool.SAMPLES / "stock/talker_listener"
    ((note,),) = found(sample)
    assert note["severity"] == "info"
    ((serious,),) = found(sample, options=("--deployed",))
    assert serious["severity"] == "critical"
    assert note["message"].startswith(f"{serious['message']} On a robot")
    assert found(keystore(tmp_path / "own"), options=("--deployed",)) == [[]]


# Numbers


def test_common_factors_are_those_that_each_pair_has() -> None:
    primes = [following(secrets.randbits(96) | 1 << 95) for _ in range(24)]
    moduli = [primes[2 * n] * primes[2 * n + 1] for n in range(8)]
    shared = [primes[16] * primes[17], primes[17] * primes[18], primes[18] * primes[19], primes[0] * primes[1] ** 2]
    groups = weak_numbers.with_common_factors([*moduli, *shared])
    assert {each for group in groups for each in group} == {*shared, moduli[0]}
    assert weak_numbers.with_common_factors(moduli) == []
