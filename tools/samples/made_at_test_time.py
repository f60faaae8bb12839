"""Keystores that git or a source distribution cannot hold: modes, pipes, links that lead out, names that clash.

Each recipe builds one keystore as the directory it is given, which must not be there yet; what lies outside of
the keystore is put beside that directory.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path

from msgspec.structs import replace

from . import policy
from .base import IDENTITY_CA, ONE, PERMISSIONS_CA, TALKER_CERTIFICATE, TALKER_GRANT, talker, with_talker
from .certificates import Certificate, day
from .cms import SignedData, Signer
from .documents import Permissions
from .keys import Key
from .smime import Message, signed_by
from .store import Enclave, Link, Store, write

Recipe = Callable[[Path], None]

TOO_LARGE = 4 * 1024 * 1024 + 1
"""One byte over what is read of a file."""


def _good(root: Path) -> None:
    write(ONE.tree(), root)


def _linked(name: str, target: str) -> Recipe:
    """The talker's file `name` is a link to `target`."""
    return lambda root: write(with_talker(changes={name: Link(target=target)}).tree(), root)


def _outside(root: Path) -> None:
    beside = root.with_name(root.name + "-outside")
    beside.mkdir(parents=True)
    (beside / "cert.pem").write_bytes(TALKER_CERTIFICATE.pem())
    _linked("cert.pem", f"../../../{beside.name}/cert.pem")(root)


def _absolute(root: Path) -> None:
    write(ONE.tree(), root)
    link = root / "enclaves/talker/identity_ca.cert.pem"
    target = link.resolve()
    link.unlink()
    link.symlink_to(target)


def _directory_link(root: Path) -> None:
    beside = root.with_name(root.name + "-outside")
    beside.mkdir(parents=True)
    write(ONE.tree(), root)
    (root / "enclaves" / "fleet").symlink_to(f"../../{beside.name}", target_is_directory=True)


def _directory_as_file(root: Path) -> None:
    write(with_talker(changes={"cert.pem": None}).tree(), root)
    (root / "enclaves" / "talker" / "cert.pem").mkdir()


def _pipe(root: Path) -> None:
    write(with_talker(changes={"permissions.p7s": None}).tree(), root)
    os.mkfifo(root / "enclaves" / "talker" / "permissions.p7s")


def _too_large(root: Path) -> None:
    """A valid message padded behind its last boundary, which OpenSSL does not read."""
    message = signed_by(ONE.permissions_ca)
    write(with_talker(seal=replace(message, epilogue=b"\r\n" * (TOO_LARGE // 2)).smime).tree(), root)


def _almost_too_large(root: Path) -> None:
    """The same with a padding that just fits: other rules may speak, this one must not."""
    message: Message = signed_by(ONE.permissions_ca)
    size = len(ONE.signed_permissions(talker()))
    padded = replace(message, epilogue=b"\n" * (TOO_LARGE - 1 - size))
    write(with_talker(seal=padded.smime).tree(), root)


def _key_mode(mode: int) -> Recipe:
    return lambda root: write(ONE.tree(), root, mode)


def _modes(store: Store, folder: str, mode: int) -> Recipe:
    """The keystore with this mode on the files of a folder."""

    def build(root: Path) -> None:
        write(store.tree(), root)
        for file in (root / folder).iterdir():
            file.chmod(mode)

    return build


def _named(*paths: str) -> Store:
    """A keystore with an enclave for each of `paths`."""
    enclaves = []
    for path in paths:
        certificate = Certificate(key=Key(label=f"rules {path}"), subject=path, issuer=IDENTITY_CA)
        permissions = Permissions(grants=(replace(TALKER_GRANT, path=path),))
        enclaves.append(Enclave(path=path, certificate=certificate, permissions=permissions))
    return replace(ONE, enclaves=tuple(enclaves))


def _name_not_utf8(root: Path) -> None:
    write(ONE.tree(), root)
    enclaves = os.fsencode(root / "enclaves")
    os.rename(enclaves + b"/talker", enclaves + b"/talk\xe9r")


def _names(*paths: str) -> Recipe:
    return lambda root: write(_named(*paths).tree(), root)


_WHOLE = policy.Node(name="talker", publish=("chatter",), reply=("~/get_type_description",))
"""All that a node asks for, so that nothing at medium stands beside what is asked about."""


def _own_keys(*, signed: int | None = None, days: tuple[datetime, datetime] | None = None) -> Recipe:
    """Keys that no sample publishes. `signed`: the year of the signature; `days`: how long all lasts."""

    def build(root: Path) -> None:
        mark = secrets.token_hex(8)
        identity_ca, permissions_ca, own = (
            replace(each, key=Key(label=f"{mark} {each.subject}"))
            for each in (IDENTITY_CA, PERMISSIONS_CA, TALKER_CERTIFICATE)
        )
        own, grant = replace(own, issuer=identity_ca), policy.grant("/talker", _WHOLE)
        if days is not None:
            own = replace(own, not_before=days[0], not_after=days[1])
            texts = [each.strftime("%Y-%m-%dT%H:%M:%S") for each in days]
            grant = replace(grant, not_before=texts[0], not_after=texts[1])
        data = SignedData(signers=(Signer(certificate=permissions_ca),), signed_at=day(signed or 2020, 1, 1))
        enclave = talker(certificate=own, permissions=Permissions(grants=(grant,)), seal=Message(signature=data).smime)
        write(replace(ONE, identity_ca=identity_ca, permissions_ca=permissions_ca, enclaves=(enclave,)).tree(), root)

    return build


WITH_KEYS = replace(ONE, private_keys=True)

RECIPES: Mapping[str, tuple[Recipe, Recipe]] = {
    "KA102": (_linked("identity_ca.cert.pem", "../../public/identity.cert.pem"), _good),
    "KA103": (_outside, _good),
    "KA104": (_directory_link, _good),
    "KA105": (_pipe, _good),
    "KA106": (_too_large, _almost_too_large),
    # A name that no file system takes cannot be opened by root either, as a file without permissions can.
    "KA107": (_linked("permissions.p7s", "x" * 300), _good),
    "KA108": (_key_mode(0o644), _key_mode(0o600)),
    "KA113": (_name_not_utf8, _good),
    "KA114": (_names("/talker", "/Talker"), _names("/talker", "/talker2")),
    "KA116": (_modes(WITH_KEYS, "private", 0o644), _modes(WITH_KEYS, "private", 0o600)),
    "KA119": (_modes(ONE, "public", 0o666), _modes(ONE, "public", 0o644)),
    "KA120": (_absolute, _good),
    "KA230": (_good, _own_keys()),
    # Identity and grant of eighty years, and of one.
    "KA665": (_own_keys(), _own_keys(signed=2026, days=(day(2026, 1, 1), day(2027, 1, 1)))),
    # Permissions that were signed anew four years after the certificate was issued, and with it.
    "KA667": (_own_keys(signed=2024), _own_keys()),
}
"""For each code, what builds the bad keystore and what builds the good one."""

DEPLOYED = frozenset({"KA230", "KA665", "KA667"})
"""Codes whose keystores are audited as trees that go on a robot, with keys of their own where they are good."""

VARIANTS: Mapping[str, tuple[str, Recipe]] = {
    "loop": ("KA102", _linked("cert.pem", "cert.pem")),
    "absolute-link": ("KA103", _linked("cert.pem", "/dev/null")),
    "directory-instead-of-file": ("KA101", _directory_as_file),
    "link-to-device": ("KA103", _linked("permissions.p7s", "/dev/zero")),
}
"""More bad keystores by name, each with the code that must find it."""
