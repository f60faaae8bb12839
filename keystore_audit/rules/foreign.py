"""KA1: files that neither sros2 nor the DDS-Security plugins know."""

from __future__ import annotations

from collections.abc import Iterator

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.remedy import decision
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.wording import listed, places
from keystore_audit.text import counted


@rule(
    "KA121",
    Severity.LOW,
    clause="ros2/sros2, keystore layouts; ros2/rmw_dds_common, security.cpp (the files that a run time reads); CWE-538",
    remedy=decision(
        "Take out of the tree what no run time reads. Where it has to be there, name it in the settings: its path "
        '(`[files] foreign = ["maps/**"]`), or its hash where it is not read (`accepted = ["sha256:..."]`).'
    ),
)
def foreign_file(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Files or directories lie in the keystore that neither sros2 nor the DDS-Security plugins know by place and name.

    No run time needs them, and whoever has the robot has them. They are read as OpenSSL reads files, whatever they are
    called: documents, certificates and keys in them count (KA660, KA663, KA668, KA118). What was not read may hold
    others: too large, not readable, no text, base64 that nobody decodes. Verdicts then assume that it does not, and no
    statement passes. Patterns in settings take files out of this finding, and never out of the reading. High in a tree
    that goes on a robot (--deployed).
    """
    declared = keystore.declared
    found = [
        each
        for each in keystore.foreign
        if each.file.sha256 not in declared.accepted and not declared.names(each.file.path)
    ]
    if found:
        tops = {each.top: each.top if each.top == each.file.path else f"{each.top}/" for each in found}
        unread = [each for each in found if each.unread]
        said = f" {counted(len(unread), 'of them was', 'of them were')} not read." if unread else ""
        if any(".git" in each.file.path.split("/") for each in found):
            said += " The history that git keeps in .git may hold keys that were taken out long ago."
        yield Violation(
            message=f"{counted(len(found), 'foreign file')} in the keystore: {listed(tops.values())}.{said}",
            locations=places(Location(path=path) for path in tops),
            severity=Severity.HIGH if context.deployed else None,
            key="\n".join(each.file.path for each in found),
        )
