"""The system's OpenSSL library on certification paths: the calls with which DDS implementations judge an identity."""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Sequence
from datetime import datetime
from enum import IntFlag

from msgspec import Struct

from tests.conftest import libcrypto


class Flag(IntFlag):
    """X509_V_FLAG_* (openssl/x509_vfy.h)."""

    NONE = 0
    CRL_CHECK = 0x4
    POLICY_CHECK = 0x80
    CHECK_SS_SIGNATURE = 0x4000


class Caller(Struct, frozen=True):
    """How an implementation asks (facts: dds-semantics 1.2).

    `whole_file`: the store holds every certificate and revocation list of the identity CA file, else the first
    certificate. `reads_crl`: `crl.pem` goes into the store and turns on CRL_CHECK, which checks the leaf alone.
    """

    name: str
    flags: Flag
    whole_file: bool
    reads_crl: bool


CALLERS = (
    Caller("Fast DDS", Flag.CHECK_SS_SIGNATURE | Flag.POLICY_CHECK, whole_file=True, reads_crl=True),
    Caller("Cyclone DDS", Flag.NONE, whole_file=False, reads_crl=True),
    Caller("OpenDDS", Flag.NONE, whole_file=False, reads_crl=False),
)


class Paths:
    """X509_verify_cert, X509_check_issued, X509_verify and X509_CRL_verify over DER."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        self._parsed: dict[tuple[str, bytes], ctypes.c_void_p] = {}
        for function in (
            *("d2i_X509", "d2i_X509_CRL", "X509_STORE_new", "X509_STORE_CTX_new", "X509_STORE_CTX_get0_param"),
            *("X509_get_pubkey", "X509_get_subject_name", "X509_get_issuer_name", "X509_CRL_get_issuer"),
            "X509_verify_cert_error_string",
        ):
            getattr(library, function).restype = ctypes.c_void_p
        library.X509_verify_cert_error_string.restype = ctypes.c_char_p

    def certificate(self, der: bytes) -> ctypes.c_void_p | None:
        """Parsed once and kept; None where OpenSSL cannot read it."""
        return self._read("d2i_X509", der)

    def revocation_list(self, der: bytes) -> ctypes.c_void_p | None:
        """Parsed once and kept; None where OpenSSL cannot read it."""
        return self._read("d2i_X509_CRL", der)

    def accepts(self, caller: Caller, authorities: Sequence[bytes], leaf: bytes, at: datetime, *crls: bytes) -> str:
        """Return "" if the implementation accepts the identity, else why not."""
        library = self._library
        store = ctypes.c_void_p(library.X509_STORE_new())
        flags = caller.flags
        for der in authorities if caller.whole_file else authorities[:1]:
            library.X509_STORE_add_cert(store, self.certificate(der))
        for der in crls if caller.reads_crl else ():
            flags |= Flag.CRL_CHECK
            library.X509_STORE_add_crl(store, self.revocation_list(der))
        library.X509_STORE_set_flags(store, ctypes.c_ulong(flags))
        context = ctypes.c_void_p(library.X509_STORE_CTX_new())
        library.X509_STORE_CTX_init(context, store, self.certificate(leaf), None)
        parameters = ctypes.c_void_p(library.X509_STORE_CTX_get0_param(context))
        library.X509_VERIFY_PARAM_set_time(parameters, ctypes.c_long(int(at.timestamp())))
        accepted = library.X509_verify_cert(context) == 1
        error = library.X509_STORE_CTX_get_error(context)
        library.X509_STORE_CTX_free(context)
        library.X509_STORE_free(store)
        library.ERR_clear_error()
        why: bytes = library.X509_verify_cert_error_string(ctypes.c_long(error))
        assert accepted == (error == 0)
        return "" if accepted else why.decode()

    def issued(self, issuer: bytes, subject: bytes) -> bool:
        """Whether names and key identifiers fit and the signature verifies: X509_check_issued but for keyUsage."""
        library = self._library
        one, other = self.certificate(issuer), self.certificate(subject)
        found: int = library.X509_check_issued(one, other)
        # X509_V_OK, and X509_V_ERR_KEYUSAGE_NO_CERTSIGN, which is asked after names and key identifiers.
        if found not in (0, 32):
            return False
        key = ctypes.c_void_p(library.X509_get_pubkey(one))
        verified = bool(key) and library.X509_verify(other, key) == 1
        library.EVP_PKEY_free(key)
        library.ERR_clear_error()
        return verified

    def signed_list(self, issuer: bytes, revocations: bytes) -> bool:
        """Whether the issuer's key made the list's signature."""
        library = self._library
        key = ctypes.c_void_p(library.X509_get_pubkey(self.certificate(issuer)))
        verified = bool(key) and library.X509_CRL_verify(self.revocation_list(revocations), key) == 1
        library.EVP_PKEY_free(key)
        library.ERR_clear_error()
        return verified

    def names_issuer(self, issuer: bytes, revocations: bytes) -> bool:
        """Whether the list's issuer is the subject of the certificate, as X509_NAME_cmp compares."""
        subject = ctypes.c_void_p(self._library.X509_get_subject_name(self.certificate(issuer)))
        named = ctypes.c_void_p(self._library.X509_CRL_get_issuer(self.revocation_list(revocations)))
        return bool(self._library.X509_NAME_cmp(subject, named) == 0)

    def _read(self, function: str, der: bytes) -> ctypes.c_void_p | None:
        if (function, der) not in self._parsed:
            pointer = ctypes.c_char_p(der)
            found = getattr(self._library, function)(None, ctypes.byref(pointer), ctypes.c_long(len(der)))
            self._library.ERR_clear_error()
            self._parsed[function, der] = ctypes.c_void_p(found)
        parsed = self._parsed[function, der]
        return None if parsed.value is None else parsed


def load() -> Paths:
    """Load the library, or skip; in CI that is a failure."""
    return Paths(libcrypto())
