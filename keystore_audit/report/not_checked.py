"""What of this keystore, and of these profiles, a report says was not looked at."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from keystore_audit.keystore.keystore import Keystore
from keystore_audit.profiles import Evidence, Profile
from keystore_audit.text import counted


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
