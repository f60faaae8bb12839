"""The system's OpenSSL library as an oracle: the very functions with which the run times read PEM files."""

from __future__ import annotations

import ctypes
import ctypes.util

from tests.conftest import libcrypto


class Libcrypto:
    """PEM_read_bio_X509, PEM_read_bio_PrivateKey and PEM_read_bio_X509_CRL over bytes."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        for function in (
            "BIO_new_mem_buf",
            "PEM_read_bio_X509",
            "PEM_read_bio_PrivateKey",
            "PEM_read_bio_X509_CRL",
            "X509_get_issuer_name",
            "X509_get_subject_name",
        ):
            getattr(library, function).restype = ctypes.c_void_p

    def certificate(self, pem: bytes) -> bytes | None:
        """Return the DER of the first certificate that OpenSSL reads, None if it refuses."""
        return self._read("PEM_read_bio_X509", "i2d_X509", "X509_free", pem)

    def public_half(self, pem: bytes) -> bytes | None:
        """Return the SubjectPublicKeyInfo of the private key that OpenSSL reads, None if it refuses."""
        return self._read("PEM_read_bio_PrivateKey", "i2d_PUBKEY", "EVP_PKEY_free", pem)

    def crl(self, pem: bytes) -> bytes | None:
        """Return the DER of the first revocation list that OpenSSL reads, None if it refuses."""
        return self._read("PEM_read_bio_X509_CRL", "i2d_X509_CRL", "X509_CRL_free", pem)

    def same_name(self, first: bytes, second: bytes) -> bool:
        """Return whether X509_NAME_cmp finds two DER names equal."""
        parsed = []
        for der in (first, second):
            self._library.d2i_X509_NAME.restype = ctypes.c_void_p
            pointer = ctypes.c_char_p(der)
            name = self._library.d2i_X509_NAME(None, ctypes.byref(pointer), ctypes.c_long(len(der)))
            assert name, "no name"
            parsed.append(ctypes.c_void_p(name))
        equal = bool(self._library.X509_NAME_cmp(*parsed) == 0)
        for name in parsed:
            self._library.X509_NAME_free(name)
        return equal

    def _read(self, read: str, write: str, free: str, pem: bytes) -> bytes | None:
        library = self._library
        buffer = ctypes.create_string_buffer(pem, len(pem))
        bio = ctypes.c_void_p(library.BIO_new_mem_buf(buffer, len(pem)))
        # An empty password, so that nothing is asked for on the terminal.
        found = ctypes.c_void_p(getattr(library, read)(bio, None, None, ctypes.c_char_p(b"")))
        library.BIO_free(bio)
        library.ERR_clear_error()
        if not found:
            return None
        out = ctypes.c_void_p()
        length = getattr(library, write)(found, ctypes.byref(out))
        der = ctypes.string_at(out, length) if length > 0 else None
        if out:
            library.CRYPTO_free(out, None, 0)
        getattr(library, free)(found)
        return der


def load() -> Libcrypto:
    """Load it, or skip; where CI is set a missing oracle is a failure."""
    return Libcrypto(libcrypto())
