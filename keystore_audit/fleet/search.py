"""Finds the keystores below a directory."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.layout import Role, keeps_enclaves_apart, starts_by_itself

_ENCLAVES: Final = "enclaves"
"""The folder that makes a directory a keystore since Foxy."""

_FILES: Final = frozenset(
    (
        *(f"{role.value}.{extension}".encode() for role in Role for extension in ("pem", "p11", "p7s")),
        b"ca.cert.pem",
        b"ca.key.pem",
    )
)
"""Files of an enclave, or of the root of a keystore before Foxy."""


class Found(Struct, frozen=True, kw_only=True):
    """What is below a directory, in order of path; paths begin with the directory as it was given.

    `keystores`: each to be audited. `unseen`: what was not looked into, with the reason: directories that cannot be
    listed, and links to directories that are not searched, which are not followed.
    """

    keystores: tuple[str, ...]
    unseen: tuple[tuple[str, str], ...]


def find_keystores(directory: str, *, beside: Sequence[str] = ()) -> Found:
    """The topmost directories at or below `directory` that hold `enclaves`, or a file of an enclave or an authority.

    Nothing is left out silently: where such a file is, it belongs to one of the keystores found or is in `unseen`.
    Folders of single enclaves that lie side by side are keystores of their own. So is a keystore, or an enclave even
    where files of it are missing, in a keystore whose own enclaves lie below enclaves/: the audit of that one judges
    no others. `beside`: other directories that are searched, into which links may lead.
    """
    keystores: list[str] = []
    unseen: list[tuple[str, str]] = []
    searched = [os.path.realpath(each) for each in (directory, *beside)]
    stack = [(directory, False)]
    while stack:
        place, within = stack.pop()
        try:
            with os.scandir(place) as listing:
                entries = sorted(listing, key=lambda entry: os.fsencode(entry.name))
        except OSError as error:
            unseen.append((place, error.strerror or str(error)))
            continue
        names = frozenset(os.fsencode(entry.name) for entry in entries)
        if starts_by_itself(names) or (not within and names & _FILES):
            keystores.append(place)
            if not keeps_enclaves_apart(names):
                continue  # whatever is below is one of its enclaves
            within = True
            entries = [entry for entry in entries if entry.name != _ENCLAVES]  # its audit judges those
        below = [entry for entry in entries if entry.is_dir(follow_symlinks=False)]
        stack.extend((entry.path, within) for entry in reversed(below))
        unseen.extend(_links_out(entries, searched))
    return Found(keystores=tuple(keystores), unseen=tuple(unseen))


def _links_out(entries: list[os.DirEntry[str]], searched: list[str]) -> Iterator[tuple[str, str]]:
    """Links to directories that are not looked through in their own place; those that lead nowhere are none."""
    for entry in entries:
        if not entry.is_symlink():
            continue
        try:
            directory = entry.is_dir()
        except OSError as error:  # in a directory that is closed, or a circle: nobody knows what is there
            yield entry.path, f"a link: {error.strerror or error}"
            continue
        target = os.path.realpath(entry.path)
        if directory and not any(os.path.commonpath((inside, target)) == inside for inside in searched):
            yield entry.path, "a link to a directory elsewhere, which is not followed"
