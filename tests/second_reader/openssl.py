"""libcrypto through ctypes, for the second reader: certificates, keys, chains and signed messages.

One process asks thousands of times, so that everything is remembered by content. Dates are never checked: a reader
says when something is valid, not whether it is now. Nothing here knows keystore_audit.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import hashlib
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime, timezone
from functools import cache, lru_cache
from typing import Any

from msgspec import Struct

_NO_CHECK_TIME = 0x200000
_PARTIAL_CHAIN = 0x80000
_CHECK_SS_SIGNATURE = 0x4000
_TEXT, _NOVERIFY, _NOINTERN = 0x1, 0x20, 0x10
_SMIME_SIGN = 4
_UNKNOWN_CRITICAL = 0x200
_RFC2253_PLAIN = 0x1110317 & ~0x4
"""XN_FLAG_RFC2253 without ASN1_STRFLGS_ESC_MSB: letters beyond ASCII stay letters."""
_RFC2253 = 0x1110317
_NO_START_LINE = 108
_PRIVATE_KEY = re.compile(rb"-----BEGIN ([A-Z0-9 ]*PRIVATE KEY)-----.*?-----END \1-----", re.DOTALL)


class _Tm(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_int) for name in ("sec", "min", "hour", "mday", "mon", "year", "wday", "yday", "isdst")
    ] + [("gmtoff", ctypes.c_long), ("zone", ctypes.c_char_p)]


_POINTERS = (
    "BIO_new",
    "BIO_s_mem",
    "BIO_new_mem_buf",
    "PEM_read_bio_X509",
    "PEM_read_bio_PrivateKey",
    "PEM_read_bio_X509_CRL",
    "d2i_X509",
    "d2i_AutoPrivateKey",
    "d2i_PKCS8_PRIV_KEY_INFO_bio",
    "X509_get_pubkey",
    "X509_get_subject_name",
    "X509_get0_notBefore",
    "X509_get0_notAfter",
    "X509_STORE_new",
    "X509_STORE_CTX_new",
    "OPENSSL_sk_new_null",
    "OPENSSL_sk_value",
    "SMIME_read_PKCS7",
    "SMIME_read_CMS",
    "CMS_get1_certs",
    "PKCS7_get0_signers",
    "X509_NAME_oneline",
)


@lru_cache(maxsize=1)
def _load() -> ctypes.CDLL:
    library = ctypes.CDLL(ctypes.util.find_library("crypto"))
    for name in _POINTERS:
        getattr(library, name).restype = ctypes.c_void_p
    library.ERR_peek_last_error.restype = ctypes.c_ulong
    library.X509_get_extension_flags.restype = ctypes.c_uint32
    return library


def _pointer(value: int | None) -> ctypes.c_void_p:
    return ctypes.c_void_p(value)


class Certificate(Struct, frozen=True, eq=False):
    """A certificate, one object for each DER. `key`: the SHA-256 of the SubjectPublicKeyInfo.

    `may_issue`: X509_check_ca admits it, and no unknown critical extension. `may_sign`: fit for S/MIME signing.
    """

    handle: ctypes.c_void_p
    sha256: str
    subject: str
    escaped: str
    oneline: str
    key: str
    not_before: datetime
    not_after: datetime
    may_issue: bool
    may_sign: bool
    names_itself: bool


class Message(Struct, frozen=True):
    """A signed message: `embedded` certificates, in order."""

    content: bytes
    embedded: tuple[Certificate, ...]


@contextmanager
def _memory(content: bytes) -> Iterator[ctypes.c_void_p]:
    library = _load()
    buffer = ctypes.create_string_buffer(content, len(content))
    bio = _pointer(library.BIO_new_mem_buf(buffer, len(content)))
    try:
        yield bio
    finally:
        library.BIO_free(bio)
        library.ERR_clear_error()


def _der(write: str, handle: ctypes.c_void_p) -> bytes:
    library = _load()
    out = ctypes.c_void_p()
    length = getattr(library, write)(handle, ctypes.byref(out))
    der = ctypes.string_at(out, length)
    library.CRYPTO_free(out, None, 0)
    return der


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _printed(name: ctypes.c_void_p, flags: int) -> str:
    library = _load()
    bio = _pointer(library.BIO_new(_pointer(library.BIO_s_mem())))
    library.X509_NAME_print_ex(bio, name, 0, ctypes.c_ulong(flags))
    buffer = ctypes.create_string_buffer(65_536)
    length = library.BIO_read(bio, buffer, len(buffer))
    library.BIO_free(bio)
    return buffer.raw[: max(length, 0)].decode("utf-8", "surrogateescape")


def _date(time: ctypes.c_void_p) -> datetime:
    tm = _Tm()
    _load().ASN1_TIME_to_tm(time, ctypes.byref(tm))
    return datetime(tm.year + 1900, tm.mon + 1, tm.mday, tm.hour, tm.min, min(tm.sec, 59), tzinfo=timezone.utc)


_known: dict[str, Certificate] = {}


def _certificate(handle: ctypes.c_void_p) -> Certificate:
    sha256 = _sha256(_der("i2d_X509", handle))
    if sha256 in _known:
        return _known[sha256]
    library = _load()
    name = _pointer(library.X509_get_subject_name(handle))
    key = _pointer(library.X509_get_pubkey(handle))
    public = _sha256(_der("i2d_PUBKEY", key)) if key else f"unreadable {sha256}"
    purpose = library.X509_check_purpose(handle, _SMIME_SIGN, 0)
    critical = library.X509_get_extension_flags(handle) & _UNKNOWN_CRITICAL
    buffer = ctypes.create_string_buffer(65_536)
    library.X509_NAME_oneline(name, buffer, len(buffer))
    _known[sha256] = Certificate(
        handle=handle,
        sha256=sha256,
        subject=_printed(name, _RFC2253_PLAIN),
        escaped=_printed(name, _RFC2253),
        oneline=buffer.value.decode("utf-8", "surrogateescape"),
        key=public,
        not_before=_date(_pointer(library.X509_get0_notBefore(handle))),
        not_after=_date(_pointer(library.X509_get0_notAfter(handle))),
        may_issue=bool(library.X509_check_ca(handle)) and not critical,
        may_sign=purpose == 1,
        names_itself=library.X509_check_issued(handle, handle) == 0,
    )
    return _known[sha256]


@cache
def certificates_in(content: bytes) -> tuple[Certificate, ...]:
    """Every certificate of a file, in order: of PEM each block that can be read, of DER the one."""
    library, found = _load(), []
    if content[:1] == b"\x30":
        start = ctypes.c_char_p(content)
        handle = _pointer(library.d2i_X509(None, ctypes.byref(start), ctypes.c_long(len(content))))
        return (_certificate(handle),) if handle else ()
    if b"CERTIFICATE-----" not in content:
        return ()
    with _memory(content) as bio:
        while True:
            library.ERR_clear_error()
            handle = _pointer(library.PEM_read_bio_X509(bio, None, None, None))
            if handle:
                found.append(_certificate(handle))
            elif library.ERR_peek_last_error() & 0x7FFFFF == _NO_START_LINE or library.ERR_peek_last_error() == 0:
                return tuple(found)


@cache
def keys_in(content: bytes) -> frozenset[str]:
    """The public halves of the private keys that can be read without a password."""
    library, found = _load(), set()
    if content[:1] == b"\x30":
        start = ctypes.c_char_p(content)
        handle = _pointer(library.d2i_AutoPrivateKey(None, ctypes.byref(start), ctypes.c_long(len(content))))
        return frozenset({_sha256(_der("i2d_PUBKEY", handle))} if handle else ())
    for block in _PRIVATE_KEY.finditer(content):
        with _memory(block[0] + b"\n") as bio:
            handle = _pointer(library.PEM_read_bio_PrivateKey(bio, None, None, ctypes.c_char_p(b"")))
        if handle:
            found.add(_sha256(_der("i2d_PUBKEY", handle)))
            library.EVP_PKEY_free(handle)
    return frozenset(found)


@cache
def issued(issuer: Certificate, certificate: Certificate) -> bool:
    """Whether X509_check_issued and X509_verify say that one issued the other."""
    library = _load()
    if library.X509_check_issued(issuer.handle, certificate.handle) not in (0, 32):  # 32: keyUsage, judged elsewhere
        return False
    key = _pointer(library.X509_get_pubkey(issuer.handle))
    good = bool(key) and library.X509_verify(certificate.handle, key) == 1
    library.EVP_PKEY_free(key)
    library.ERR_clear_error()
    return good


def _stack(certificates: Sequence[Certificate]) -> ctypes.c_void_p:
    library = _load()
    stack = _pointer(library.OPENSSL_sk_new_null())
    for each in certificates:
        library.OPENSSL_sk_push(stack, each.handle)
    return stack


@contextmanager
def _store(trusted: Sequence[Certificate], flags: int) -> Iterator[ctypes.c_void_p]:
    library = _load()
    store = _pointer(library.X509_STORE_new())
    for each in trusted:
        library.X509_STORE_add_cert(store, each.handle)
    library.X509_STORE_set_flags(store, ctypes.c_ulong(_NO_CHECK_TIME | flags))
    try:
        yield store
    finally:
        library.X509_STORE_free(store)
        library.ERR_clear_error()


@cache
def chains(
    certificate: Certificate,
    trusted: tuple[Certificate, ...],
    untrusted: tuple[Certificate, ...] = (),
    *,
    partial: bool = False,
    checks_root: bool = False,
    signing: bool = False,
) -> bool:
    """Whether X509_verify_cert finds a way to what is trusted: to a root of it or, if `partial`, to any of it.

    `signing`: one over which S/MIME messages may be signed.
    """
    library = _load()
    flags = _PARTIAL_CHAIN * partial | _CHECK_SS_SIGNATURE * checks_root
    with _store(trusted, flags) as store:
        context = _pointer(library.X509_STORE_CTX_new())
        stack = _stack(untrusted)
        library.X509_STORE_CTX_init(context, store, certificate.handle, stack)
        if signing:
            library.X509_STORE_CTX_set_default(context, ctypes.c_char_p(b"smime_sign"))
        good = library.X509_verify_cert(context) == 1
        library.X509_STORE_CTX_free(context)
        library.OPENSSL_sk_free(stack)
    return good


@cache
def message_in(content: bytes) -> Message | None:
    """The S/MIME message that a file is, None where SMIME_read_PKCS7 reads none."""
    library = _load()
    with _memory(content) as bio:
        inner = ctypes.c_void_p()
        p7 = _pointer(library.SMIME_read_PKCS7(bio, ctypes.byref(inner)))
        if inner:
            library.BIO_free(inner)
        if not p7:
            return None
        library.PKCS7_free(p7)
    with _memory(content) as bio:
        inner = ctypes.c_void_p()
        cms = _pointer(library.SMIME_read_CMS(bio, ctypes.byref(inner)))
        if inner:
            library.BIO_free(inner)
        if not cms:
            return Message(content, ())
        stack = _pointer(library.CMS_get1_certs(cms))
        embedded = tuple(_members(stack)) if stack else ()
        library.CMS_ContentInfo_free(cms)
    return Message(content, embedded)


def _members(stack: ctypes.c_void_p) -> Iterator[Certificate]:
    library = _load()
    for number in range(library.OPENSSL_sk_num(stack)):
        handle = _pointer(library.OPENSSL_sk_value(stack, number))
        library.X509_up_ref(handle)
        yield _certificate(handle)


def _verified(content: bytes, stack: ctypes.c_void_p | None, store: ctypes.c_void_p | None, flags: int) -> bytes | None:
    library = _load()
    with _memory(content) as bio:
        inner = ctypes.c_void_p()
        p7 = _pointer(library.SMIME_read_PKCS7(bio, ctypes.byref(inner)))
        if not p7:
            return None
        out = _pointer(library.BIO_new(_pointer(library.BIO_s_mem())))
        good = library.PKCS7_verify(p7, stack, store, inner or None, out, flags) == 1
        text: Any = None
        if good:
            start = ctypes.c_void_p()
            length = library.BIO_ctrl(out, 3, ctypes.c_long(0), ctypes.byref(start))
            text = ctypes.string_at(start, length) if length > 0 else b""
        library.BIO_free(out)
        if inner:
            library.BIO_free(inner)
        library.PKCS7_free(p7)
        return text


@cache
def pinned_content(content: bytes, authorities: tuple[Certificate, ...]) -> bytes | None:
    """What implementations read that want the permissions CA's own signature; None where they refuse."""
    stack = _stack(authorities)
    text = _verified(content, stack, None, _TEXT | _NOVERIFY | _NOINTERN)
    _load().OPENSSL_sk_free(stack)
    return text


@cache
def chained_content(content: bytes, authorities: tuple[Certificate, ...]) -> bytes | None:
    """What implementations read that take whatever signer of the message chains to the permissions CA."""
    with _store(authorities, 0) as store:
        return _verified(content, None, store, _TEXT)


@cache
def signers_in(content: bytes, known: tuple[Certificate, ...]) -> tuple[Certificate, ...]:
    """Whom the signer identifiers of a message name, among `known` certificates and its own."""
    library = _load()
    with _memory(content) as bio:
        inner = ctypes.c_void_p()
        p7 = _pointer(library.SMIME_read_PKCS7(bio, ctypes.byref(inner)))
        stack = _stack(known)
        found = _pointer(library.PKCS7_get0_signers(p7, stack, 0)) if p7 else None
        signers = tuple(_members(found)) if found else ()
        library.OPENSSL_sk_free(stack)
        if inner:
            library.BIO_free(inner)
        library.PKCS7_free(p7)
    return signers


@cache
def signed_content(content: bytes, known: tuple[Certificate, ...]) -> bytes | None:
    """What a message says if its signatures hold under `known` certificates and its own; whoever these are."""
    stack = _stack(known)
    text = _verified(content, stack, None, _TEXT | _NOVERIFY)
    _load().OPENSSL_sk_free(stack)
    return text
