"""Governance and permissions documents: each function takes only what differs from what sros2 makes.

A document is put together of texts, so that a test that wants something odd passes it in the place of any part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from xml.sax.saxutils import escape

from keystore_audit.keystore.smime import SignedDocument
from tests.keystore.builder import GOVERNANCE, present
from tests.keystore.builder import PERMISSIONS as _PERMISSIONS

SHARED = Path(__file__).resolve().parents[3] / "shared"
"""The workplace's folder of facts and reference data, which a user's clone does not have."""

FIRST_LINE = 9
"""Where the XML of a stock message begins."""

PERMISSIONS = _PERMISSIONS.format(name="/talker").encode()

EVERYTHING_ALLOWED = b"""<dds><permissions>
  <grant name="g">
    <subject_name>CN=/g</subject_name>
    <validity><not_before>2024-01-01T00:00:00Z</not_before><not_after>2034-01-01T00:00:00.5+01:00</not_after></validity>
    <deny_rule>
      <domains><id_range><min>1</min></id_range><id>7</id></domains>
      <publish><partitions><partition></partition><partition>p</partition></partitions><topics><topic>t</topic></topics></publish>
      <subscribe>
        <data_tags><tag><name>n</name><value>v</value></tag></data_tags><topics><topic>a</topic><topic>b</topic></topics>
      </subscribe>
      <relay><topics><topic>t</topic></topics></relay>
    </deny_rule>
    <allow_rule><domains><id_range><max>3</max></id_range></domains></allow_rule>
    <default>ALLOW</default>
  </grant>
  <grant name="">
    <subject_name></subject_name>
    <validity><not_before>2024-01-01T00:00:00</not_before><not_after>2034-01-01T00:00:00</not_after></validity>
    <default>DENY</default>
  </grant>
</permissions></dds>
"""
LIVELINESS = b"          <enable_liveliness_protection>true</enable_liveliness_protection>\n"
ARDENT_GOVERNANCE = GOVERNANCE.replace(b"20170901", b"20160303").replace(LIVELINESS, b"")
CRYSTAL_PERMISSIONS = PERMISSIONS.replace(
    b"<publish>",
    b"<subscribe><partitions><partition></partition></partitions><topics><topic>x</topic></topics></subscribe>\n<publish>",
)


_DDS = '<?xml version="1.0" encoding="UTF-8"?>\n<dds>{}</dds>\n'
DOMAIN_0 = "<id>0</id>"
Domain = int | tuple[int | None, int | None]
"""An id, or a range by its bounds."""

_TOPIC_RULE = {
    "discovery": "enable_discovery_protection",
    "liveliness": "enable_liveliness_protection",
    "read": "enable_read_access_control",
    "write": "enable_write_access_control",
    "metadata": "metadata_protection_kind",
    "data": "data_protection_kind",
}
_DOMAIN_RULE = {
    "unauthenticated": "allow_unauthenticated_participants",
    "join": "enable_join_access_control",
    "discovery": "discovery_protection_kind",
    "liveliness": "liveliness_protection_kind",
    "rtps": "rtps_protection_kind",
}
_STOCK = {"allow_unauthenticated_participants": False, "rtps_protection_kind": "SIGN"}


def element(name: str, *content: str | int) -> str:
    """An element of such content, which is XML."""
    return f"<{name}>{''.join(map(str, content))}</{name}>"


def _values(elements: Mapping[str, str], changed: Mapping[str, str | bool]) -> str:
    """Those of sros2's governance but for what is changed, in the order that the schema wants."""
    assert changed.keys() <= elements.keys(), changed
    stock = {name: _STOCK.get(tag, "ENCRYPT" if tag.endswith("kind") else True) for name, tag in elements.items()}
    told = ((elements[name], value) for name, value in {**stock, **changed}.items())
    return "".join(element(tag, str(value).lower() if isinstance(value, bool) else value) for tag, value in told)


def ids(*domains: Domain) -> str:
    """A set of domains: ids, and ranges with the bounds that are not None."""
    found = ""
    for each in domains:
        if isinstance(each, int):
            found += element("id", each)
        else:
            bounds = zip(("min", "max"), each, strict=True)
            found += element("id_range", *(element(name, bound) for name, bound in bounds if bound is not None))
    return found


def topic_rule(expression: str = "*", **changed: str | bool) -> str:
    """Of a governance. `changed`: discovery, liveliness, read, write, metadata or data."""
    return element("topic_rule", element("topic_expression", expression), _values(_TOPIC_RULE, changed))


def domain_rule(*topic_rules: str, domains: str = DOMAIN_0, **changed: str | bool) -> str:
    """Of a governance. `changed`: unauthenticated, join, discovery, liveliness or rtps."""
    rules = element("topic_access_rules", *(topic_rules or (topic_rule(),)))
    return element("domain_rule", element("domains", domains), _values(_DOMAIN_RULE, changed), rules)


def governance(*domain_rules: str) -> str:
    """A whole document; without domain rules, the stock one."""
    return _DDS.format(element("domain_access_rules", *(domain_rules or (domain_rule(),))))


def criterion(kind: str, *topics: str, partitions: Sequence[str] | None = ()) -> str:
    """A `publish`, `subscribe` or `relay`; Without partitions no such element. Names are texts, not XML."""
    listed = element("topics", *(element("topic", escape(topic)) for topic in topics))
    if partitions:
        listed += element("partitions", *(element("partition", escape(each)) for each in partitions))
    return element(kind, listed)


pub, sub = (partial(criterion, kind) for kind in ("publish", "subscribe"))


def pubsub(*topics: str, partitions: Sequence[str] | None = ()) -> str:
    """Criteria of writers and of readers."""
    return pub(*topics, partitions=partitions) + sub(*topics, partitions=partitions)


def rule(*criteria: str, allow: bool = True, domains: str = DOMAIN_0) -> str:
    """Of a grant."""
    return element("allow_rule" if allow else "deny_rule", element("domains", domains), *criteria)


allow, deny = (partial(rule, allow=allows) for allows in (True, False))


def grant(
    path: str,
    *rules: str,
    subject: str | None = None,
    start: str = "2024-01-01T00:00:00",
    end: str = "2034-01-01T00:00:00",
    default: str | None = "DENY",
    name: str | None = "g",
) -> str:
    """For the enclave of this path; `default` and `name` None leave them out, `subject` is XML."""
    head = "<grant>" if name is None else f'<grant name="{name}">'
    validity = element("validity", element("not_before", start), element("not_after", end))
    last = "" if default is None else element("default", default)
    return (
        head
        + element("subject_name", f"CN={path}" if subject is None else subject)
        + validity
        + "".join(rules)
        + last
        + "</grant>"
    )


def permissions(*grants: str) -> str:
    """A whole document."""
    return _DDS.format(element("permissions", *grants))


def signed(content: bytes | None, first_line: int | None = FIRST_LINE) -> SignedDocument:
    """A document whose envelope was read: `content` is its signed text."""
    return SignedDocument(
        file=present(b"", "enclaves/permissions.p7s"),
        content=content,
        first_line=first_line,
        embedded=(),
        signatures=(),
        defects=(),
    )
