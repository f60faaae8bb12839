"""What settings say of the files of a keystore (`[files]`)."""

from __future__ import annotations

import re
from typing import Final

from keystore_audit.keystore.foreign import DeclaredFiles
from keystore_audit.settings.table import Table

_SHA256: Final = re.compile(r"sha256:([0-9a-f]{64})")
_LAST_GROUP: Final = 2**32 - 2


def read_files(root: Table) -> DeclaredFiles:
    """The table, if there is one. Raises errors.UsageError."""
    if "files" not in root.values:
        return DeclaredFiles()
    table = root.table("files")
    table.only("foreign", "accepted", "key_group", "aliases")
    foreign = table.texts("foreign") if "foreign" in table.values else ()
    for pattern in foreign:
        if pattern.startswith(("/", "./")) or "//" in pattern or ".." in pattern.split("/"):
            table.wrong("foreign", f'{pattern!r}: expected a path in the keystore, e.g. "maps/**"')
    found = [(each, _SHA256.fullmatch(each)) for each in table.texts("accepted")] if "accepted" in table.values else []
    for each, match in found:
        if match is None:
            table.wrong("accepted", f'{each!r}: expected "sha256:" and 64 digits 0 to 9 and a to f')
    return DeclaredFiles(
        foreign=foreign,
        accepted=frozenset(match[1] for _each, match in found if match is not None),
        key_group=table.number("key_group", 0, 0, _LAST_GROUP) if "key_group" in table.values else None,
        aliases=table.enclaves("aliases") if "aliases" in table.values else (),
    )
