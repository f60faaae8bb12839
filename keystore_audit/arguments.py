"""Arguments of the Python interface: what is of another type, or out of range, is one kind of error."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping
from datetime import datetime, timedelta
from typing import Any, Final
from zoneinfo import ZoneInfo

from keystore_audit.errors import UsageError
from keystore_audit.findings import Severity
from keystore_audit.options import FIRST_YEAR, LAST_DOMAIN, LAST_YEAR, MAX_DAYS, MAX_SECONDS

Check = Callable[[Any], bool]


def _is(*types: type) -> Check:
    return lambda given: isinstance(given, types) and (bool in types or not isinstance(given, bool))


def _or_none(check: Check) -> Check:
    return lambda given: given is None or check(given)


def _each(check: Check) -> Check:
    """A collection, which a text is not."""

    def several(given: Any) -> bool:
        listed = isinstance(given, Collection) and not isinstance(given, str | bytes | os.PathLike | Mapping)
        return listed and all(map(check, given))

    return several


def _texts(given: Any) -> bool:
    return isinstance(given, Mapping) and all(isinstance(each, str) for pair in given.items() for each in pair)


def _file(given: Any) -> bool:
    """A path. Raises UsageError for one that no file can have, which would stop whoever reads it."""
    if not isinstance(given, str | os.PathLike):
        return False
    try:
        possible = b"\0" not in os.fsencode(given)
    except UnicodeEncodeError:
        possible = False
    if not possible:
        raise UsageError("A path holds a NUL character or half of a surrogate pair: no file can have it.")
    return True


def _positive(given: Any) -> bool:
    return isinstance(given, int | float) and not isinstance(given, bool) and math.isfinite(given) and given > 0


_TEXT = _is(str)
_FLAG = _is(bool)

_EXPECTED: Final[Mapping[str, tuple[Check, str]]] = {
    "path": (_file, "a path"),
    "at": (_or_none(_is(datetime)), "a datetime or None"),
    "profiles": (_each(_TEXT), "a sequence of names"),
    "domain": (_or_none(_is(int)), "an int or None"),
    "time_zone": (_or_none(_is(str, ZoneInfo)), "a name, a ZoneInfo or None"),
    "engine": (_TEXT, "a name"),
    "offline": (_FLAG, "a bool"),
    "alloy_jar": (_or_none(_file), "a path or None"),
    "timeout": (_positive, "seconds, more than 0"),
    "fail_on": (_or_none(_is(Severity)), "a Severity or None"),
    "expires_within": (_is(timedelta), "a timedelta"),
    "deployed": (_FLAG, "a bool"),
    "select": (_each(_TEXT), "a sequence of codes"),
    "ignore": (_each(_TEXT), "a sequence of codes"),
    "expect_identity_ca": (_each(_file), "a sequence of fingerprints and paths"),
    "expect_permissions_ca": (_each(_file), "a sequence of fingerprints and paths"),
    "settings": (_or_none(_file), "a path or None"),
    "baseline": (_or_none(_file), "a path or None"),
    "policy": (_or_none(_file), "a path or None"),
    "policy_include": (_or_none(_file), "a path or None"),
    "environment": (_or_none(_file), "a path or None"),
    "graphs": (_each(_file), "a sequence of paths"),
    "roots": (_each(_file), "a sequence of paths"),
    "launches": (_each(_file), "a sequence of paths"),
    "launch_arguments": (_or_none(_texts), "a mapping of texts to texts, or None"),
    "alloy_properties": (_each(_file), "a sequence of paths"),
    "pictures": (_FLAG, "a bool"),
}


def check_arguments(given: Mapping[str, Any]) -> None:
    """Raises UsageError for the first argument that is not what it has to be; a text is no sequence of names.

    The values are not told: who calls knows them.
    """
    for name, (is_right, expected) in _EXPECTED.items():
        if name in given and not is_right(given[name]):
            raise UsageError(f"{name}: expected {expected}, found one of type {type(given[name]).__name__}.")


def check_ranges(at: datetime | None, timeout: float, expires_within: timedelta, domain: int | None) -> None:
    """Raises UsageError for what is out of the range that the command line allows."""
    if at is not None and not FIRST_YEAR <= at.year <= LAST_YEAR:
        raise UsageError(f"The instant {at} is not between the years {FIRST_YEAR} and {LAST_YEAR}.")
    if timeout > MAX_SECONDS:
        raise UsageError(f"A timeout of {timeout:g} seconds is too long: {MAX_SECONDS:g} at most.")
    if not timedelta(0) <= expires_within <= timedelta(days=MAX_DAYS):
        raise UsageError(f"A notice of {expires_within} is not between 0 and {MAX_DAYS} days.")
    if domain is not None and not 0 <= domain <= LAST_DOMAIN:
        raise UsageError(f"{domain} is no domain: there are 0 to {LAST_DOMAIN}.")
