"""Keystores of which a part cannot be read, or can be read in two ways: nothing that it may change is
called safe.
"""

from __future__ import annotations

from collections.abc import Iterator

from .base import LISTENER_GRANT, PERMISSIONS_CA, TWO, with_listener
from .documents import Permissions, edited
from .smime import signed_by
from .story import Case, Story, pair


def stories() -> Iterator[Story]:
    """The samples below unknown/ and the pair of KA906."""
    document = Permissions(grants=(LISTENER_GRANT,)).xml()
    whole = signed_by(PERMISSIONS_CA).smime(document.encode())
    yield Story(
        directory="unknown/unreadable_enclave",
        text=(
            "The listener's permissions.p7s is cut off inside the signature. No property that its rights could "
            "change holds: incomplete, exit 4."
        ),
        tree=with_listener(changes={"permissions.p7s": whole[: len(whole) - 300]}).tree(),
    )
    ambiguous = edited(document, "rt/chatter", "rt/<![CDATA[chatter]]>")
    yield Story(
        directory="unknown/ambiguous_enclave",
        text=(
            "The listener's permissions are validly signed, but a topic has a CDATA section, which parsers read "
            "differently. What depends on it is unknown: exit 4."
        ),
        tree=with_listener(permissions=ambiguous).tree(),
    )
    yield from pair(
        "KA906",
        bad=Case(
            "A .p11 reference lies beside the listener's certificate, so the listener's identity is unknown.",
            with_listener(changes={"cert.p11": b"pkcs11:token=robot;object=listener\n"}),
        ),
        good=Case("The certificate is only the file cert.pem.", TWO),
    )
