"""Directories as hypothesis strategies: the names that mean something, where they belong and where they do not."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from hypothesis import strategies as st

from tests.strategies.mutations import seeds

RUN_TIME: Final = (
    b"cert.pem",
    b"key.pem",
    b"identity_ca.cert.pem",
    b"permissions_ca.cert.pem",
    b"governance.p7s",
    b"permissions.p7s",
)
NAMES: Final = (
    *RUN_TIME,
    *(b"ca.cert.pem", b"ca.key.pem", b"governance.xml", b"permissions.xml", b"crl.pem", b"key.p11", b"index.txt"),
    *(
        b"enclaves",
        b"public",
        b"private",
        b"talker",
        b"Talker",
        b"a",
        b"\xff\xfe",
        b"\x1b[2J",
        b"a\nb",
        b"%41",
        "é".encode(),
    ),
)
FOLDERS: Final = (
    b"",
    b"enclaves",
    b"enclaves/talker",
    b"enclaves/a/b",
    b"public",
    b"private",
    b"talker",
    b"a/enclaves/x",
)
TARGETS: Final = (
    b"../cert.pem",
    b"cert.pem",
    b".",
    b"..",
    b"/",
    b"/etc/passwd",
    b"../../../outside",
    b"nowhere",
    b"\x1b",
)

Entry = tuple[str, bytes]
"""`file` with its content, `link` with its target, `pipe` or `directory` with nothing."""


def _entries() -> st.SearchStrategy[Entry]:
    contents = st.one_of(
        *(seeds(target) for target in ("certificate", "private_key", "smime", "crl")), st.binary(max_size=9)
    )
    return st.one_of(
        st.tuples(st.just("file"), contents),
        st.tuples(st.just("file"), contents),
        st.tuples(st.just("file"), contents),
        st.tuples(st.just("link"), st.sampled_from(TARGETS)),
        st.tuples(st.sampled_from(("pipe", "directory")), st.just(b"")),
    )


def trees() -> st.SearchStrategy[Mapping[bytes, Entry]]:
    """What stands at each path, relative to the keystore."""
    paths = st.tuples(st.sampled_from(FOLDERS), st.sampled_from(NAMES)).map(lambda pair: b"/".join(filter(None, pair)))
    return st.dictionaries(paths, _entries(), max_size=24)


def make(tree: Mapping[bytes, Entry], root: Path) -> None:
    """Make them below `root`; what finds its place taken is left out."""
    for path, (kind, value) in tree.items():
        place = os.fsencode(root) + b"/" + path
        parent = os.path.dirname(place)
        try:
            os.makedirs(parent, exist_ok=True)
            if os.path.realpath(parent) != os.path.abspath(parent) or os.path.lexists(place):
                continue
        except OSError:  # a file, or a link that leads nowhere, stands in the way
            continue
        if kind == "link":
            os.symlink(value, place)
        elif kind == "pipe":
            os.mkfifo(place)
        elif kind == "directory":
            os.mkdir(place)
        else:
            with open(place, "wb") as stream:
                stream.write(value)
