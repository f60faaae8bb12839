"""What the auditor is known to get wrong: empty this list, and nothing is excused any more.

The named cases fail as expected failures (strict: a repaired fault has to leave the list), and random mutations that
show one of these faults and nothing else are counted apart.
"""

from __future__ import annotations

from tests.keystore.messages import taken_apart
from tests.oracles.smime.comparison import Comparison
from tests.oracles.smime.der import Element, parse
from tests.oracles.smime.resigning import DIGESTS

ODD_VALUES = "OpenSSL writes values of attributes anew before it hashes them, and refuses malformed ones"
NO_DIGEST = "OpenSSL refuses a message that lists a digest algorithm which it does not know, used or not"
NOT_BROUGHT = "the message does not bring the signer, and only those that it brings count"
FALSE_TWIN = "of certificates with the same issuer and serial number inside the message the first is the signer"

CASES = {
    NOT_BROUGHT: (
        *(f"{kind}: {title}" for kind in ("EC", "RSA") for title in ("smime -text -nocerts", "cms -text -nocerts")),
        *("EC: pyca no certificates", "RSA: pyca no certificates", "CMS: no certificates"),
        "signer: an enclave of the keystore, certificate left out",
    ),
    FALSE_TWIN: ("signer: the authority, its certificate behind a false one",),
    "the authority itself has to be fit to sign where it signs": (
        *(f"chain: the authority with extended key usage {title}" for title in ("clientAuth", "any")),
        *(f"chain: the authority with key usage {title}" for title in ("key_encipherment", "key_cert_sign")),
        "chain: the authority with Netscape type SSL server",
    ),
    "the extended key usage of the authority binds those below it": (
        *(f"chain: an enclave of an authority with extended key usage {title}" for title in ("clientAuth", "any")),
    ),
    "an unknown critical extension is refused": (
        *(f"chain: {who} with an unknown critical extension" for who in ("an enclave", "the authority")),
        "chain: an enclave of an authority with an unknown critical extension",
    ),
    "a chain has to end in a self-signed certificate": (
        *("chain: a middle authority, trusted alone", "chain: an enclave, trusted itself"),
        "chain: an enclave below a middle authority, which is trusted alone",
    ),
    "a message may bring the authorities between": (
        "chain: an enclave below a middle authority that the message brings",
    ),
    NO_DIGEST: ("CMS: digest algorithms with one that is none", "CMS: digest algorithms with MD4"),
    ODD_VALUES: tuple(
        f"CMS: value of an attribute: {title}"
        for title in (
            *("constructed time", "constructed octets", "boolean of two bytes", "empty integer", "padded integer"),
            *("NULL with content", "malformed identifier", "bit string of nothing", "BMPString of three bytes"),
            *("primitive sequence", "constructed boolean"),
        )
    ),
}
"""What is wrong, and the cases that show it; `verdicts.tsv` says what would be right."""

FAULTY = {name: fault for fault, names in CASES.items() for name in names}

_HARMLESS = frozenset({0x30, 0x31, 0x04, 0x06, 0x17, 0x18, 0x0C, 0x13, 0x16})
"""Tags of values that OpenSSL writes as it read them."""


def known(contradiction: str, comparison: Comparison, message: bytes) -> str | None:
    """The fault on this list that explains a contradiction."""
    if not contradiction.endswith("we accept, OpenSSL refuses"):
        return None
    if _unknown_digest(message):
        return NO_DIGEST
    if _odd_values(message):
        return ODD_VALUES
    if not contradiction.startswith("chained"):
        return None
    for signature in comparison.document.signatures:
        verified = {certificate.sha256 for certificate in signature.verified_by}
        signer = next(certificate.sha256 for certificate in signature.named if certificate.sha256 in verified)
        name = signature.issuer_der, signature.serial
        twins = [c.sha256 for c in comparison.document.embedded if (c.issuer_der, c.serial) == name]
        if signer not in twins:
            return NOT_BROUGHT
        if signer != twins[0]:
            return FALSE_TWIN
    return None


def _signed_data(message: bytes) -> list[Element]:
    """The parts of the SignedData; none where it cannot be taken apart."""
    try:
        (structure,) = parse(taken_apart(message)[1])
        return structure.children[1].children[0].children
    except (AssertionError, IndexError, ValueError):
        return []


def _unknown_digest(message: bytes) -> bool:
    parts = _signed_data(message)
    return len(parts) > 1 and any(
        listed.children[:1] and listed.children[0].encode() not in DIGESTS for listed in parts[1].children
    )


def _odd_values(message: bytes) -> bool:
    return any(
        value.tag not in _HARMLESS
        for part in _signed_data(message)[-1:]
        for info in part.children
        for value in _values(info)
    )


def _values(info: Element) -> list[Element]:
    attributes = [child for child in info.children if child.tag == 0xA0]
    return [
        value
        for some in attributes
        for one in some.children
        for values in one.children[1:]
        for value in values.children
    ]
