"""Matchers that we did not write, asked directly: libc's fnmatch, and the wild_match of ACE, which OpenDDS calls."""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Callable, Sequence
from functools import lru_cache

from keystore_audit.model.matching.expression import Pattern
from keystore_audit.profiles import Matcher
from tests.conftest import lacking

Column = Sequence[bool]
"""Whether a pattern matches each of some names."""

FLAGS = {Matcher.POSIX: 0, Matcher.POSIX_NOESCAPE: 0x02}  # glibc's FNM_NOESCAPE
_ACE = ("libACE-7.0.8.so", "libACE.so")
_WILD_MATCH = "_ZN3ACE10wild_matchEPKcS1_bb"  # bool ACE::wild_match(char const *, char const *, bool, bool)


@lru_cache(maxsize=1)
def libc_fnmatch() -> Callable[[bytes, bytes, int], int]:
    """Python starts C programs in the locale of the user: for ASCII that is as in the C locale."""
    if platform.libc_ver()[0] != "glibc":
        lacking("glibc")
    function = ctypes.CDLL(None).fnmatch
    function.argtypes = (ctypes.c_char_p, ctypes.c_char_p, ctypes.c_int)
    return function  # type: ignore[no-any-return]


@lru_cache(maxsize=1)
def _wild_match() -> Callable[[bytes, object, bool, bool], bool]:
    for name in _ACE:
        try:
            function = ctypes.CDLL(name)[_WILD_MATCH]
        except (OSError, AttributeError):
            continue
        function.argtypes = (ctypes.c_char_p, ctypes.c_char_p, ctypes.c_bool, ctypes.c_bool)
        function.restype = ctypes.c_bool
        return function
    return lacking("ACE (Debian: libace-7.0.8)")


def ask(pattern: Pattern, names: Sequence[str]) -> Column:
    """What the library of the pattern's matcher says; all of it ASCII. Cyclone DDS's is asked in `plugin`."""
    text = pattern.text.encode("ascii")
    octets = [name.encode("ascii") for name in names]
    if pattern.matcher is Matcher.SINGLE_TRY:
        wild_match = _wild_match()
        elsewhere = ctypes.create_string_buffer(text)  # ACE takes strings at one address for equal, and Python has few
        return [wild_match(name, elsewhere, True, True) for name in octets]
    fnmatch, flags = libc_fnmatch(), FLAGS[pattern.matcher]
    return [fnmatch(text, name, flags) == 0 for name in octets]


def ask_all(patterns: Sequence[Pattern], names: Sequence[str]) -> list[Column]:
    return [ask(pattern, names) for pattern in patterns]
