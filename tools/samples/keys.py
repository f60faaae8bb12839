"""Private keys that are the same at every build, so that the committed samples can be compared byte for byte.

A key that anybody can derive from its label protects nothing: this is for samples and tests only.
"""

from __future__ import annotations

import hashlib
from functools import cache

from asn1crypto.algos import EncryptionAlgorithm, Pbkdf2Salt  # type: ignore[import-untyped]
from asn1crypto.core import OctetString  # type: ignore[import-untyped]
from asn1crypto.keys import EncryptedPrivateKeyInfo  # type: ignore[import-untyped]
from asn1crypto.pem import armor  # type: ignore[import-untyped]
from cryptography.hazmat.primitives import padding
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat
from msgspec import Struct

_CURVES: dict[str, tuple[ec.EllipticCurve, int]] = {
    # The order of each group (SEC 2 version 2, 2.4.2, 2.5.1 and 2.3.2): a private key is 1 .. order - 1.
    "P-256": (ec.SECP256R1(), 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551),
    "P-384": (
        ec.SECP384R1(),
        0xFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFFC7634D81F4372DDF581A0DB248B0A77AECEC196ACCC52973,
    ),
    "P-224": (ec.SECP224R1(), 0xFFFFFFFFFFFFFFFFFFFFFFFFFFFF16A2E0B8F03E13DD29455C5C2A3D),
}


class Key(Struct, frozen=True, kw_only=True):
    """An EC key pair named by `label`; the same label and curve always give the same key."""

    label: str
    curve: str = "P-256"

    def private(self) -> ec.EllipticCurvePrivateKey:
        """The key itself."""
        return _derive(self.label, self.curve)

    def public_der(self) -> bytes:
        """SubjectPublicKeyInfo in DER."""
        return self.private().public_key().public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)

    def pem(self) -> bytes:
        """PKCS#8 without encryption, as sros2 writes `key.pem`."""
        return self.private().private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())

    def encrypted_pem(self, password: str) -> bytes:
        """PKCS#8 under PBES2 (RFC 8018, 6.2), as `openssl genpkey -aes-256-cbc` writes it."""
        salt = hashlib.sha256(b"salt " + self.label.encode()).digest()[:8]
        iv = hashlib.sha256(b"iv " + self.label.encode()).digest()[:16]
        secret = hashlib.pbkdf2_hmac("sha256", password.encode(), salt, 2048, 32)
        plain = self.private().private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption())
        padder = padding.PKCS7(128).padder()
        encryptor = Cipher(algorithms.AES(secret), modes.CBC(iv)).encryptor()
        data = encryptor.update(padder.update(plain) + padder.finalize()) + encryptor.finalize()
        pbkdf2 = {
            "algorithm": "pbkdf2",
            "parameters": {
                "salt": Pbkdf2Salt(name="specified", value=OctetString(salt)),
                "iteration_count": 2048,
                "prf": {"algorithm": "sha256"},
            },
        }
        scheme = {"algorithm": "aes256_cbc", "parameters": iv}
        algorithm = EncryptionAlgorithm(
            {"algorithm": "pbes2", "parameters": {"key_derivation_func": pbkdf2, "encryption_scheme": scheme}}
        )
        info = EncryptedPrivateKeyInfo({"encryption_algorithm": algorithm, "encrypted_data": data})
        return bytes(armor("ENCRYPTED PRIVATE KEY", info.dump()))


@cache
def _derive(label: str, curve: str) -> ec.EllipticCurvePrivateKey:
    group, order = _CURVES[curve]
    digest = hashlib.sha512(f"keystore-audit sample key {curve} {label}".encode()).digest()
    return ec.derive_private_key(int.from_bytes(digest, "big") % (order - 1) + 1, group)
