"""What the checker knows of implementations: the declared rows of the table of profiles, and nothing else of it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from keystore_audit.certificate.errors import CannotTell

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
    partitions: Literal["of-the-criterion", "of-the-criterion-denied-in-default-one", "of-the-first-rule"]
    requires_grant: bool
    subjects: Literal[
        "exact", "pieces-in-order", "attributes-in-any-order", "pieces-within", "pieces-within-blanks-off"
    ]
    trusts_declarations: bool


class _Understood(Row, frozen=True, forbid_unknown_fields=True):
    """With those of which all that are understood come to the same."""

    matcher: Literal["posix", "posix-noescape", "simple-brackets"]
    joins_out_of_date: bool
    any_governance_rule: bool
    authenticates_origin: bool


def row(name: str) -> Row:
    """The row of this name. Raises CannotTell for a peculiarity, or a value of one, that the checker does not know."""
    table = _table()
    values = _values(table["implementation"], name)
    told = {quirk: values[quirk] for quirk in table["quirk"].keys() - _IDLE.split()}
    try:
        found = msgspec.convert(told, _Understood)
    except msgspec.ValidationError as error:
        raise CannotTell(f"the checker does not know what {name} does: {error}") from error
    if found.joins_out_of_date or found.any_governance_rule or not found.authenticates_origin:
        raise CannotTell(f"the checker does not know what {name} does")
    return msgspec.convert(found, Row, from_attributes=True)


@cache
def _table() -> Any:
    return msgspec.toml.decode((Path(__file__).parent.parent / "profiles" / "quirks.toml").read_bytes())


def _values(table: dict[str, dict[str, Any]], name: str) -> dict[str, Any]:
    """With what the row leaves to the one that it is like."""
    own = table[name]
    return {**_values(table, own["like"]), **own} if "like" in own else own
