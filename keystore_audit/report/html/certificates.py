"""Who vouches for whom: each CA with what it issued and signed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from keystore_audit.model.tables.issuance import Issuance, IssuedCertificate
from keystore_audit.report.html.element import Html, element, folded, items, joined, lines, name, place
from keystore_audit.report.html.sheet import FULL, Sheet
from keystore_audit.text import counted, instant

MAX_LISTED: Final = 100
"""Certificates, or documents, listed below one."""

MAX_ROOTS: Final = 30
"""Certificates that nobody else issued."""

MAX_DEPTH: Final = 6
"""Certificates above each other; what lies deeper is not drawn."""

_OPEN: Final = 16
"""Entries up to which a list is seen without a click."""


def certificates(sheet: Sheet, issued: Issuance) -> Html:
    """Return the chains as nested lists, roots first."""
    roots = [number for number, each in enumerate(issued.certificates) if each.is_root]
    if issued.certificates and not roots:  # authorities that issued each other
        roots = [number for number, each in enumerate(issued.certificates) if each.issued][:1]
    roots.sort(key=lambda n: (not issued.certificates[n].issued and not issued.certificates[n].signed, n))
    parts: list[Html] = [element("li", _entry(sheet, issued, root, ())) for root in roots[:MAX_ROOTS]]
    if len(roots) > MAX_ROOTS:
        parts.append(element("li", f"{counted(len(roots) - MAX_ROOTS, 'more certificate')} without an issuer. {FULL}"))
    chain = element("ul", lines(parts), class_="chain") if parts else element("p", "No certificate could be read.")
    told = [chain]
    for paths, words in (
        (issued.unsigned, "whose signature none of these certificates made"),
        (issued.unread, "of which it cannot be told who signed"),
    ):
        if paths:
            told += [element("p", f"{counted(len(paths), 'document')} {words}", class_="under"), _places(paths)]
    return joined(told)


def _entry(sheet: Sheet, issued: Issuance, number: int, above: Sequence[int]) -> Html:
    """One certificate, what it is for, and below it what it issued and signed."""
    certificate = issued.certificates[number]
    parts: list[Html] = [_card(sheet, certificate)]
    below = [child for child in certificate.issued if child not in above and child != number]
    if below and len(above) < MAX_DEPTH:
        listed = [element("li", _entry(sheet, issued, child, (*above, number))) for child in below[:MAX_LISTED]]
        if len(below) > MAX_LISTED:
            listed.append(element("li", f"{len(below) - MAX_LISTED} more. {FULL}", class_="soft"))
        head = f"issued {counted(len(below), 'certificate')}"
        parts.append(folded(head, element("ul", lines(listed)), open_=len(below) <= _OPEN, class_="below"))
    if certificate.signed:
        fit = certificate.permissions_ca_of
        head = f"signed {counted(len(certificate.signed), 'document')}{'' if fit else ', and is no permissions CA'}"
        parts.append(folded(head, _places(certificate.signed), open_=len(certificate.signed) <= _OPEN, class_="below"))
    return joined(parts)


def _card(sheet: Sheet, certificate: IssuedCertificate) -> Html:
    at = sheet.report.at
    dates = f"{instant(certificate.not_before)[:10]} to {instant(certificate.not_after)[:10]}"
    state = ""
    if certificate.not_before > at:
        state = "not valid yet"
    elif certificate.not_after < at:
        state = "expired"
    key = f", {certificate.key_kind}, {certificate.signature_algorithm}"
    warned = [word for word in (state, "revoked" if certificate.revoked else "") if word]
    return element(
        "div",
        element("span", name(certificate.subject), class_="subject"),
        element("span", " · ".join(_roles(certificate)), element("span", key, class_="soft"), class_="role"),
        element(
            "span",
            element("span", dates, class_="dates"),
            *[element("strong", word, class_="warned") for word in warned],
        ),
        place(certificate.location.path, certificate.location.line),
        class_="card",
    )


def _roles(certificate: IssuedCertificate) -> Iterable[str]:
    """What it is for; a certificate for both roles of a CA is said to be."""
    if certificate.identity_ca_of and certificate.permissions_ca_of:
        yield f"one CA for identities and permissions, of {counted(certificate.identity_ca_of, 'enclave')}"
    elif certificate.identity_ca_of:
        yield f"identity CA of {counted(certificate.identity_ca_of, 'enclave')}"
    elif certificate.permissions_ca_of:
        yield f"permissions CA of {counted(certificate.permissions_ca_of, 'enclave')}"
    if len(certificate.identity_of) == 1:
        yield "identity"
    elif certificate.identity_of:
        yield f"identity of {len(certificate.identity_of)} enclaves: {', '.join(certificate.identity_of[:4])}"


def _places(paths: Sequence[str]) -> Html:
    listed = [place(path, None) for path in paths[:MAX_LISTED]]
    if len(paths) > MAX_LISTED:
        listed.append(element("span", f"{len(paths) - MAX_LISTED} more. {FULL}", class_="soft"))
    return items(listed, class_="names")
