"""The commands that remedies give, to be typed in the root of a keystore that sros2 laid out (since Foxy).

ENCLAVE stands for the path of an enclave, `/talker`, as in the commands of `ros2 security`.
tests/rules/test_remedies.py runs them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from keystore_audit.keystore.layout import LayoutKind

_PLACE: Final = re.compile(r"`[^`]*\b(public|private|enclaves)/")
_OF_ALL: Final = re.compile(r"-out public/|mv signed\.new enclaves/governance\.p7s")
_OF_ONE: Final = "mv signed.new enclaves/DOCUMENT.p7s"
_COPY: Final = re.compile(r"enclaves/.+/(governance\.p7s|(identity|permissions)_ca\.cert\.pem)", re.DOTALL)
COPIES: Final = "Enclaves with copies in place of links need the new files too."


def are_copied(places: Iterable[str]) -> bool:
    """Whether a file of these is an enclave's own, where sros2 makes a link to that of all."""
    return any(map(_COPY.fullmatch, places))


def for_layout(remedy: str, kind: LayoutKind, places: Iterable[str] = (), *, copies: bool = False) -> str:
    """The remedy as it is to be read in a keystore of this layout: in an older one its commands find nothing, and where
    enclaves have `copies`, what they write is not yet where it is read; of a document, where that of the finding,
    which is at `places`, is a copy.
    """
    if kind in (LayoutKind.FLAT, LayoutKind.ARDENT) and _PLACE.search(remedy) and MAKE_LAYOUT not in remedy:
        return f"The commands are for the layout since Foxy, which this keystore does not have (KA115). {remedy}"
    elsewhere = (copies and _OF_ALL.search(remedy)) or (_OF_ONE in remedy and are_copied(places))
    return f"{remedy} {COPIES}" if elsewhere and COPIES not in remedy else remedy


def signing(document: str) -> str:
    """The command that signs a document, which is named without its ending.

    Where the key is missing, belongs to another certificate or has a password, openssl leaves an empty file. A link
    called like it would be followed, to whatever file of the user it leads, with what the document says.
    """
    return (
        f"`rm -f signed.new && openssl smime -sign -text -in {document}.xml -out signed.new "
        "-signer public/permissions_ca.cert.pem "
        f"-inkey private/permissions_ca.key.pem && mv signed.new {document}.p7s`"
    )


SIGN_GOVERNANCE: Final = signing("enclaves/governance")
SIGN_PERMISSIONS: Final = signing("enclaves/ENCLAVE/permissions")
SIGN_DOCUMENT: Final = (
    f"{signing('enclaves/DOCUMENT')}, in the keystore's root, DOCUMENT being governance or ENCLAVE/permissions"
)

SHOW_DOCUMENT: Final = "`openssl smime -verify -text -noverify -in enclaves/DOCUMENT.p7s`"

CREATE_PERMISSION: Final = "`ros2 security create_permission KEYSTORE ENCLAVE policy.xml`"
CREATE_ENCLAVE: Final = (
    f"`ros2 security create_enclave KEYSTORE ENCLAVE`, then {CREATE_PERMISSION}, since the first leaves permissions "
    "that allow everything"
)

UNREVIEWED: Final = "This signs whatever the .xml files say: read first those that KA110 or KA3 names"


# Written beside sros2's links and moved over them: openssl follows a link, and would overwrite the one CA behind both.
def _making(role: str) -> str:
    """The commands that make an authority of this role with a new key."""
    return (
        "`rm -f private/new.key.pem public/new.cert.pem && "
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -sha256 -days 3650 "
        f"-subj /CN={role}CA -keyout private/new.key.pem -out public/new.cert.pem`, "
        f"`mv private/new.key.pem private/{role}_ca.key.pem`, `mv public/new.cert.pem public/{role}_ca.cert.pem`"
    )


MAKE_PERMISSIONS_CA: Final = _making("permissions")
MAKE_IDENTITY_CA: Final = _making("identity")
RENEW_CA: Final = (
    "`openssl req -x509 -new -sha256 -days 3650 -key private/ROLE_ca.key.pem -subj /CN=NAME "
    "-out public/ROLE_ca.cert.pem`, ROLE being identity or permissions"
)

ISSUE_IDENTITY: Final = (
    "`openssl req -new -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -sha256 -subj '/CN=NAME' "
    "-addext basicConstraints=CA:FALSE -keyout enclaves/ENCLAVE/key.pem | openssl x509 -req -sha256 -days 365 "
    "-copy_extensions copy -CA public/identity_ca.cert.pem -CAkey private/identity_ca.key.pem "
    '-set_serial "0x$(openssl rand -hex 16)" -out enclaves/ENCLAVE/cert.pem`, '
    "NAME being ENCLAVE with a backslash before each slash"
)
SHOW_SUBJECT: Final = (
    "`openssl x509 -noout -subject -nameopt RFC2253 -in enclaves/ENCLAVE/cert.pem | sed s/^subject=//`"
)

LINK_GOVERNANCE: Final = "`ln -sf ../governance.p7s enclaves/ENCLAVE/governance.p7s`"
DEEPER: Final = "with one ../ more for every further level of the enclave's path"
LINK_CA: Final = "`ln -sf ../../public/ROLE_ca.cert.pem enclaves/ENCLAVE/ROLE_ca.cert.pem`"

MAKE_LAYOUT: Final = (
    "`mkdir public private enclaves`, `mv ca.cert.pem public/`, `mv ca.key.pem private/`, `mv governance.* enclaves/`, "
    "for both ROLEs, identity and permissions, `ln -s ca.cert.pem public/ROLE_ca.cert.pem` and `ln -s ca.key.pem "
    "private/ROLE_ca.key.pem`, for every folder of enclaves `mv FOLDER enclaves/`, and for every enclave "
    f"{LINK_GOVERNANCE} and for both ROLEs {LINK_CA}, {DEEPER}"
)

START_LIST: Final = (
    r"`printf '%s\n' '[ca]' 'default_ca = crl' '[crl]' 'database = index.txt' 'default_md = sha256' > crl.cnf`"
)
_LIST: Final = "openssl ca -config crl.cnf -keyfile private/identity_ca.key.pem -cert public/identity_ca.cert.pem"
REVOKE: Final = f"`{_LIST} -revoke enclaves/ENCLAVE/cert.pem`"
SIGN_LIST: Final = f"`{_LIST} -gencrl -crldays 30 -out crl.pem`"
