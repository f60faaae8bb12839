"""Compares distinguished names of certificates as X.509 verifiers do."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final

from cryptography import x509

_BLANKS: Final = re.compile(r"[ \t\n\v\f\r]+")
_LOWER: Final = {upper: upper + 0x20 for upper in range(ord("A"), ord("Z") + 1)}


def same_name(first: x509.Name, second: x509.Name) -> bool:
    """Whether OpenSSL's X509_NAME_cmp finds the names equal (crypto/x509/x_name.c, x509_name_canon).

    Neither the case of ASCII letters, nor blanks around or their number between words, nor the type of
    string counts.
    """
    return _canonical(first) == _canonical(second)


@lru_cache(maxsize=4096)
def _canonical(name: x509.Name) -> tuple[frozenset[tuple[str, str | bytes]], ...]:
    return tuple(
        frozenset((attribute.oid.dotted_string, _canonical_value(attribute.value)) for attribute in rdn)
        for rdn in name.rdns
    )


def _canonical_value(value: str | bytes) -> str | bytes:
    if isinstance(value, bytes):
        return value
    return _BLANKS.sub(" ", value).strip(" ").translate(_LOWER)
