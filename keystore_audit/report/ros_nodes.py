"""What ROS 2 asks beyond a participant: who starts is told of DDS, which is what an attacker needs too."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from keystore_audit.findings import Finding, Severity

_KEEPING_NODES: Final = ("KA113", "KA418", "KA636")
"""Rules of what DDS lets pass and ROS 2 does not: names of enclaves, and topics that every node needs."""


def nodes_beside(findings: Iterable[Finding]) -> str:
    """A sentence that names the findings which keep nodes from being made where a participant starts, or nothing."""
    told = {finding.code for finding in findings if finding.severity.at_least(Severity.MEDIUM)}
    codes = [code for code in _KEEPING_NODES if code in told]
    if not codes:
        return ""
    return f"That is of DDS participants. ROS 2 asks for more before it makes a node: see {', '.join(codes)}."
