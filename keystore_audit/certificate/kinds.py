"""What the checker knows of implementations: the declared rows of the table of profiles, and nothing else of it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, Final

import msgspec

from keystore_audit.certificate.errors import CannotTell

_UNDERSTOOD: Final[dict[str, tuple[object, ...]]] = {
    "pins_signer": (True, False),
    "skips_grants_out_of_date": (True, False),
    "joins_out_of_date": (False,),
    "binds_domains": (True, False),
    "matcher": ("posix", "posix-noescape", "simple-brackets"),
    "matches_octets": (True, False),
    "honours_default": (True, False),
    "partitions": ("of-the-criterion", "of-the-criterion-denied-in-default-one", "of-the-first-rule"),
    "requires_grant": (True, False),
    "any_governance_rule": (False,),
    "authenticates_origin": (True,),
    "subjects": (
        *("exact", "pieces-in-order", "attributes-in-any-order"),
        *("pieces-within", "pieces-within-blanks-off"),
    ),
    "trusts_declarations": (True, False),
}
"""By peculiarity the values that are understood."""

_IDLE: Final = """
topic_check relay syntax open_ranges dates joins revocation highest_domain refuses_unauthenticated_with_rtps
starts_ungoverned most_sent reads_names_as_expressions topic_names splits_partitions first_authority_only needs_root
checks_root_signature checks_permissions_ca strict_authorities ca_algorithms identity_algorithms identity_keys
compares_key compares_permissions_ca
"""
"""Peculiarities that take rights away, or say nothing, in the plain forms that the checker reads."""


class Row(msgspec.Struct, frozen=True):
    """One implementation: the values of those peculiarities that matter (profiles/quirks.toml says what they mean)."""

    pins_signer: bool
    skips_grants_out_of_date: bool
    binds_domains: bool
    matches_octets: bool
    honours_default: bool
    partitions: str
    requires_grant: bool
    subjects: str
    trusts_declarations: bool


def row(name: str) -> Row:
    """The row of this name. Raises CannotTell for a peculiarity, or a value of one, that the checker does not know."""
    table = _table()
    values = _values(table["implementation"], name)
    for quirk in table["quirk"].keys() - _IDLE.split():
        if values[quirk] not in _UNDERSTOOD.get(quirk, ()):
            raise CannotTell(f"{name}: the checker does not know {quirk} = {values[quirk]!r}")
    return msgspec.convert(values, Row)


@cache
def _table() -> Any:
    return msgspec.toml.decode((Path(__file__).parent.parent / "profiles" / "quirks.toml").read_bytes())


def _values(table: dict[str, dict[str, Any]], name: str) -> dict[str, Any]:
    """With what the row leaves to the one that it is like."""
    own = table[name]
    return {**_values(table, own["like"]), **own} if "like" in own else own
