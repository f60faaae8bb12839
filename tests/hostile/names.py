"""Facts 4.5: names of the attacker's choosing that are meant for whatever shows the report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final
from xml.sax.saxutils import escape

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID

from tests.hostile.store import CERT, P7S, PERMISSIONS_OF_VICTIM, Store, case
from tests.keystore.builder import authority, certificate, crl, signed_document

NAMES: Final = {
    "a window title": "/a\x1b]0;owned\x07",
    "a screen that is cleared": "/a\x1b[2J\x1b[H\x1b[32mPASS",
    "a C1 control sequence": "/a\x9b31mred\x9c",
    "a clipboard": "/a\x1b]52;c;cm0gLXJm\x07",
    "a carriage return": "/a\r\x1b[KPASS  exit code 0",
    "line ends": "/a\nPASS  ./keys: 0 critical\n\n",
    "a Unicode line end": "/a\u2028PASS\u2029\u0085",
    "a right-to-left override": "/a\u202egnp.exe\u202c",
    "bidi isolates": "/a\u2066b\u2067c\u2069",
    "zero-width characters": "/a\u200b\u200d\ufeff\u2060b",
    "backspaces": "/attacker" + "\x08" * 9 + "/victim",
    "rich markup": "[bold red]x[/bold red][link=file:///etc/passwd]y[/link]\\",
    "HTML": "</script><script>alert(1)</script><img src=x onerror=a>",
    "Markdown": "](http://x) ![x](javascript:1) | `a` | **b** <b>",
    "a spreadsheet formula": "=cmd|' /C calc'!A0",
    "a comment of Alloy": "*/ no sig x { } run {} // no sig x {",
    "a JSON string that ends": '"}],"verdict":"pass","x":["\\u0022',
    "a format string": "%s%n{0.__class__}${jndi:ldap://x}$(id)`id`",
    "tags of an invisible plane": "/a\U000e0041\U000e0042",
    "a name of 12 kB": "/" + "x\u0301" * 4_000,
}
MARK: Final = "INJECTED"


def called(name: str) -> x509.Name:
    """A subject without a limit: RFC 5280 has one of 64 characters, which nobody has to keep."""
    kinds = (NameOID.COMMON_NAME, NameOID.ORGANIZATION_NAME)
    return x509.Name([x509.NameAttribute(kind, f"{MARK}{name}", _validate=False) for kind in kinds])


def in_certificate(name: str) -> Callable[[Store], None]:
    """The certificate's subject, which nobody's grant names then; X.509 has no character that it forbids."""

    return lambda store: store.identify(certificate(called(name), store.base.identity))


def in_grant(name: str) -> Callable[[Store], None]:
    """Name, subject and topics of the grant, as far as XML can hold them."""
    printable = "".join(each for each in name if each >= " " or each in "\t\n")
    value = escape(f"{MARK}{printable}".strip(), {'"': "&quot;", "\n": "&#10;"}).encode("utf-8", "replace")

    def spoil(store: Store) -> None:
        text = PERMISSIONS_OF_VICTIM.replace(b'grant name="/victim"', b'grant name="' + value + b'"')
        text = text.replace(b"rt/chatter", value)
        store.permit(text.replace(b"CN=/victim", b"CN=" + value))

    return spoil


def in_authority(name: str) -> Callable[[Store], None]:
    """An authority of the attacker's that signs the document, and a list that is its too."""

    def spoil(store: Store) -> None:
        other = authority(called(name))
        store.put("permissions.p7s", signed_document(PERMISSIONS_OF_VICTIM, other))
        store.put("crl.pem", crl(other).public_bytes(Encoding.PEM))

    return spoil


UNREAD: Final = frozenset(
    # Not the one meaning that a document must have.
    {"a C1 control sequence", "line ends", "a right-to-left override", "bidi isolates", "zero-width characters"}
    | {"a Unicode line end", "tags of an invisible plane"}
)

SUBJECTS: Final = tuple(
    case(f"a subject with {what}", in_certificate(name), "KA503", CERT, line=1, exit=1) for what, name in NAMES.items()
)
GRANTS: Final = tuple(
    case(f"a grant with {what}", in_grant(name), exit=4 if what in UNREAD else 1) for what, name in NAMES.items()
)
AUTHORITIES: Final = tuple(
    case(f"an authority with {what}", in_authority(name), "KA301", P7S, line=1, exit=1, bystander_changes=True)
    for what, name in NAMES.items()
)
CASES: Final = SUBJECTS + GRANTS + AUTHORITIES
