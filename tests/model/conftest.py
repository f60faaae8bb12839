"""What the tests of the model share: the C library's own fnmatch."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from keystore_audit.profiles import Matcher
from tests.oracles.fnmatch import libraries

Fnmatch = Callable[[str, str, Matcher], bool]


@pytest.fixture(scope="session")
def libc_fnmatch() -> Fnmatch:
    """Whether a text matches a name as glibc has it, ASCII only."""
    function = libraries.libc_fnmatch()

    def matches(text: str, name: str, matcher: Matcher) -> bool:
        return bool(function(text.encode("ascii"), name.encode("ascii"), libraries.FLAGS[matcher]) == 0)

    return matches
