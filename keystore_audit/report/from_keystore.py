"""What a report takes from the keystore while it is at hand: lines that findings show, and what was not looked at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Final

from keystore_audit.findings import Finding, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.profiles import Evidence, Profile
from keystore_audit.text import counted, shorten

MAX_EXCERPT: Final = 200
"""Characters of a line."""


def excerpts(keystore: Keystore, findings: Sequence[Finding]) -> dict[tuple[str, int], str]:
    """The lines of signed documents that findings name first: nothing of a file in which a private key may be."""
    files = chain((keystore.layout.governance,), *(each.files.every for each in keystore.enclaves))
    documents = {each.place: each for each in files if each is not None and each.place.endswith(".p7s")}
    split: dict[str, list[bytes]] = {}
    found = {}
    for finding in findings:
        place = place_of(finding)
        if place is None or not finding.severity.at_least(Severity.MEDIUM):
            continue
        path, number = place
        file = documents.get(path)
        if file is None or file.content is None or file.holds_private_key:
            continue
        lines = split.get(path) or split.setdefault(path, file.content.split(b"\n"))
        line = lines[number - 1].decode("utf-8", "replace").strip() if number <= len(lines) else ""
        if line.startswith("<") and not line.startswith("<!"):  # of the XML, and of no signature, nor of a DTD
            found[place] = shorten(line, MAX_EXCERPT)
    return found


def place_of(finding: Finding) -> tuple[str, int] | None:
    """The path and the number of the line that the finding names first; None where it names none."""
    return next(((each.path, each.line) for each in finding.locations if each.line is not None), None)


def unread(keystore: Keystore) -> Iterator[str]:
    """Files that were not read, and what no digest speaks of."""
    files = keystore.unread_foreign
    if files:
        yield (
            f"{counted(len(files), 'file')} that could not be read and that nobody accepted, {files[0].place} first: "
            "what is said here holds if no key, certificate or document is in there, and no statement passes."
        )
    uncovered = keystore.uncovered
    if uncovered:
        yield (
            f"{len(uncovered)} files or directories whose content is in no digest, since they could not be read or are "
            f"too large, {uncovered[0]} first: what is put there later changes no digest, and no statement passes."
        )


def untested(profiles: Sequence[Profile]) -> Iterator[str]:
    """How the profiles are known whose rows this project's tests do not ask the real implementation about."""
    measured = [profile.name for profile in profiles if profile.evidence is Evidence.MEASURED]
    read = [profile.name for profile in profiles if profile.evidence is Evidence.READ and profile.name != "spec"]
    if measured:
        yield f"{', '.join(measured)}: by measurements on the releases, not asked again since (docs/profiles.md)."
    if read:
        yield f"{', '.join(read)}: by their source alone (docs/profiles.md)."
