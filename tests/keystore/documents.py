"""Governance and permissions for the tests of their readers, and what it takes to hand them over."""

from __future__ import annotations

from pathlib import Path

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
