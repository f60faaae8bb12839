"""A fact that a reader noticed while reading: what was expected, what was there, and where."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from msgspec import Struct


class Kind(str, Enum):
    """What is out of order. `rules/` gives each kind its code, severity and remedy."""

    # certificates, keys, revocation lists
    CERTIFICATE_UNREADABLE = "certificate-unreadable"
    CERTIFICATE_FILE_EXTRA = "certificate-file-extra"
    KEY_UNREADABLE = "key-unreadable"
    SECOND_KEY = "second-key"
    KEY_ENCRYPTED = "key-encrypted"
    CRL_UNREADABLE = "crl-unreadable"
    # S/MIME envelope
    NOT_SMIME = "not-smime"
    MIME_MALFORMED = "mime-malformed"
    NO_TEXT_PLAIN = "no-text-plain"
    UNSIGNED_TEXT = "unsigned-text"
    OPAQUE_MESSAGE = "opaque-message"
    # CMS signature
    CMS_MALFORMED = "cms-malformed"
    CMS_NOT_DER = "cms-not-der"
    TWO_CONTENTS = "two-contents"
    NO_SIGNER = "no-signer"
    SEVERAL_SIGNERS = "several-signers"
    NO_SIGNED_ATTRIBUTES = "no-signed-attributes"
    WEAK_DIGEST = "weak-digest"
    UNSUPPORTED_ALGORITHM = "unsupported-algorithm"
    DIGEST_MISMATCH = "digest-mismatch"
    # XML
    XML_MALFORMED = "xml-malformed"
    XML_AMBIGUOUS = "xml-ambiguous"
    XML_VARIES = "xml-varies"
    SCHEMA_INVALID = "schema-invalid"
    VALUE_INVALID = "value-invalid"
    BEYOND_LIMIT = "beyond-limit"
    EMPTY_TOPIC = "empty-topic"
    RULE_WITHOUT_DOMAINS = "rule-without-domains"
    EMPTY_ELEMENT = "empty-element"
    DDS_SECURITY_1_0 = "dds-security-1.0"

    @property
    def opaque(self) -> bool:
        """Whether some run time may accept what we refuse to interpret.

        What such a file means is then unknown, not denied: the value `unknown` of design section 3.
        """
        return self in _OPAQUE


_OPAQUE = frozenset(
    {
        Kind.CERTIFICATE_UNREADABLE,
        Kind.KEY_UNREADABLE,
        Kind.CRL_UNREADABLE,
        Kind.MIME_MALFORMED,
        Kind.CMS_MALFORMED,
        Kind.CMS_NOT_DER,
        Kind.TWO_CONTENTS,
        Kind.UNSUPPORTED_ALGORITHM,
        Kind.XML_MALFORMED,
        Kind.XML_AMBIGUOUS,
        Kind.XML_VARIES,
        Kind.SCHEMA_INVALID,
        Kind.VALUE_INVALID,
        Kind.BEYOND_LIMIT,
        Kind.EMPTY_TOPIC,
        Kind.RULE_WITHOUT_DOMAINS,
        Kind.EMPTY_ELEMENT,
    }
)


class Defect(Struct, frozen=True, kw_only=True):
    """One defect: `detail` says what was expected and what was there, in a sentence for people.

    `path` and `line` as in `findings.Location`. `detail` may quote untrusted text; whoever prints it escapes.
    """

    kind: Kind
    path: str
    line: int | None
    detail: str


def first_opaque(defects: Iterable[Defect]) -> Defect | None:
    """The first defect for which some run time may accept what we refuse to interpret; None where there is none."""
    return next((each for each in defects if each.kind.opaque), None)


class Malformed(ValueError):
    """A text that the user names has not its form: `line` and `detail`, a sentence without its end."""

    def __init__(self, line: int, detail: str) -> None:
        """Keep line and detail."""
        super().__init__(detail)
        self.line = line
        self.detail = detail
