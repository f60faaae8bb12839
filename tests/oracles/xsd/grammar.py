"""What is valid, decided a third time: DDS-Security's tables as regular expressions over the names of child elements.

Neither the schemas nor the generators are used, so that a schema that takes too much or too little is found wherever
the tests run, the published schemas being elsewhere.
"""

from __future__ import annotations

import re
from calendar import monthrange
from collections.abc import Mapping
from typing import Final

from keystore_audit.keystore.document import Grammar
from tests.strategies.documents import Tree

_BLANKS: Final = " \t\r\n"
_BASIC: Final = "NONE|SIGN|ENCRYPT"
_ORIGIN: Final = f"{_BASIC}|SIGN_WITH_ORIGIN_AUTHENTICATION|ENCRYPT_WITH_ORIGIN_AUTHENTICATION"
_KINDS: Final = "discovery_protection_kind liveliness_protection_kind rtps_protection_kind "

_DOMAINS: Final = {"domains": "(id |id_range )+", "id_range": "min |max |min max "}
_GOVERNANCE: Final = {
    **_DOMAINS,
    "dds": "domain_access_rules ",
    "domain_access_rules": "(domain_rule )+",
    "domain_rule": f"domains allow_unauthenticated_participants enable_join_access_control {_KINDS}topic_access_rules ",
    "topic_access_rules": "(topic_rule )+",
    "topic_rule": "topic_expression enable_discovery_protection enable_liveliness_protection "
    "enable_read_access_control enable_write_access_control metadata_protection_kind data_protection_kind ",
}
_PERMISSIONS: Final = {
    **_DOMAINS,
    "dds": "permissions ",
    "permissions": "(grant )+",
    "grant": "subject_name validity (allow_rule |deny_rule )*default ",
    "validity": "not_before not_after ",
    **dict.fromkeys(("allow_rule", "deny_rule"), "domains (publish )*(subscribe )*(relay )*"),
    # Topics, and at most one of each other, in any order.
    **dict.fromkeys(
        ("publish", "subscribe", "relay"),
        r"(?=.*topics )(?!(.*partitions ){2}|(.*data_tags ){2}|(.*topics ){2})(topics |partitions |data_tags )+",
    ),
    "topics": "(topic )+",
    "partitions": "(partition )+",
    "data_tags": "(tag )+",
    "tag": "(name value )+",
}
_CONTENT: Final[Mapping[tuple[Grammar, str], Mapping[str, str]]] = {
    (Grammar.GOVERNANCE, "1.1"): _GOVERNANCE,
    (Grammar.GOVERNANCE, "1.0"): {
        **_GOVERNANCE,
        "topic_rule": _GOVERNANCE["topic_rule"].replace("enable_liveliness_protection ", ""),
    },
    (Grammar.PERMISSIONS, "1.1"): _PERMISSIONS,
    (Grammar.PERMISSIONS, "1.0"): {
        **_PERMISSIONS,
        **dict.fromkeys(("allow_rule", "deny_rule"), "domains (publish |subscribe |relay )*"),
    },
}
_STRINGS: Final = ("topic_expression", "subject_name", "topic", "partition", "name", "value")
_VALUES: Final = {
    **dict.fromkeys(("id", "min", "max"), r"\+?[0-9]+|-0+"),
    **dict.fromkeys(("allow_unauthenticated_participants", "enable_join_access_control"), "true|false|0|1"),
    **dict.fromkeys((f"enable_{what}_protection" for what in ("discovery", "liveliness")), "true|false|0|1"),
    **dict.fromkeys((f"enable_{what}_access_control" for what in ("read", "write")), "true|false|0|1"),
    **dict.fromkeys((*_KINDS.split(), "metadata_protection_kind"), _ORIGIN),
    "data_protection_kind": _BASIC,
    "default": "ALLOW|DENY",
}
_DATE_TIME: Final = re.compile(
    r"-?([1-9][0-9]{4,}|[0-9]{4})-([0-9]{2})-([0-9]{2})T([0-9]{2}):([0-9]{2}):([0-9]{2})(\.[0-9]+)?"
    r"(Z|[+-](0[0-9]|1[0-3]):[0-5][0-9]|[+-]14:00)?"
)
_INSTANCE_ATTRIBUTE: Final = "{http://www.w3.org/2001/XMLSchema-instance}noNamespaceSchemaLocation"


def is_valid(tree: Tree, grammar: Grammar, version: str) -> bool:
    """Whether DDS-Security's tables allow the document."""
    return tree.tag == "dds" and _element(tree, _CONTENT[grammar, version])


def _element(tree: Tree, content: Mapping[str, str]) -> bool:
    names = {name for name, _value in tree.attributes} - {_INSTANCE_ATTRIBUTE}
    if names != ({"name"} if tree.tag == "grant" else set()):
        return False
    if tree.tag not in content:
        return not tree.children and _value(tree)
    children = "".join(f"{child.tag} " for child in tree.children)
    return (
        not tree.text.strip(_BLANKS)
        and re.fullmatch(content[tree.tag], children) is not None
        and all(_element(child, content) for child in tree.children)
    )


def _value(tree: Tree) -> bool:
    if tree.tag in _STRINGS:
        return True
    if tree.tag in ("not_before", "not_after"):
        return _date_time(tree.text)
    pattern = _VALUES.get(tree.tag)
    # Enumerations are restrictions of xs:string, whose blanks count; those around numbers and booleans do not.
    text = tree.text if tree.tag.endswith("_kind") or tree.tag == "default" else tree.text.strip(_BLANKS)
    return pattern is not None and re.fullmatch(pattern, text) is not None


def _date_time(text: str) -> bool:
    """XML Schema part 2, 3.2.7; without blanks around, which libxml2 refuses (differences.toml)."""
    found = _DATE_TIME.fullmatch(text)
    if found is None:
        return False
    year, month, day, hour, minute, second = map(int, found.groups()[:6])
    if year == 0 or not 1 <= month <= 12 or minute > 59 or second > 59:
        return False
    # The calendar repeats every 400 years.
    days = monthrange(2000 + year % 400, month)[1]
    end_of_day = hour == 24 and minute == second == 0 and not (found[7] or "").strip(".0")
    return 1 <= day <= days and (hour < 24 or end_of_day)
