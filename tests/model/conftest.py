"""What the tests of the model share: the C library's own fnmatch."""

from __future__ import annotations

import ctypes
import os
import platform
from collections.abc import Callable

import pytest

from keystore_audit.model.expression import Matcher

FLAGS = {Matcher.POSIX: 0, Matcher.POSIX_NOESCAPE: 0x02}  # glibc's FNM_NOESCAPE

Fnmatch = Callable[[str, str, Matcher], bool]


@pytest.fixture(scope="session")
def libc_fnmatch() -> Fnmatch:
    """Whether a text matches a name as glibc has it. Python starts C programs in the locale of the user: ASCII only."""
    if platform.libc_ver()[0] != "glibc":
        if os.environ.get("CI", "").lower() not in {"", "0", "false"}:
            pytest.fail("no glibc here, and CI has to ask its fnmatch")
        pytest.skip("no glibc here")
    function = ctypes.CDLL(None).fnmatch
    function.argtypes = (ctypes.c_char_p, ctypes.c_char_p, ctypes.c_int)

    def matches(text: str, name: str, matcher: Matcher) -> bool:
        return bool(function(text.encode("ascii"), name.encode("ascii"), FLAGS[matcher]) == 0)

    return matches
