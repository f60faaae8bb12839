"""What one run of the program knows before its command does."""

from __future__ import annotations

from keystore_audit.dataclass import dataclass


@dataclass(slots=True)
class Session:
    """Set while the command line is parsed. `verbose`: the user wants to know where a fault is."""

    verbose: bool = False
