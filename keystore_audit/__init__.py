"""Audit SROS2 keystores: what the signed artifacts allow, as the robots read them (docs/python-api.md)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from keystore_audit.api import (
        AuditError,
        EnclaveEntry,
        Finding,
        Location,
        NothingToAudit,
        Report,
        Severity,
        UsageError,
        Verdict,
        audit,
        render,
    )

__version__ = "0.1.0"

__all__ = [
    "AuditError",
    "EnclaveEntry",
    "Finding",
    "Location",
    "NothingToAudit",
    "Report",
    "Severity",
    "UsageError",
    "Verdict",
    "audit",
    "render",
]


def __getattr__(name: str) -> Any:
    """The Python interface, loaded when it is first asked for: the command line starts without it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("keystore_audit.api"), name)
