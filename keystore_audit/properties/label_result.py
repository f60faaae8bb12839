"""What the engines said of two labels between which nothing may flow."""

from __future__ import annotations

from keystore_audit.dataclass import dataclass
from keystore_audit.findings import Location, Severity
from keystore_audit.properties.result import PropertyResult


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelResult(PropertyResult):
    """Whether what is labelled `source` stays away from what is labelled `target`.

    `location`: of the lattice, beside the keystore. `meaning`: what is claimed, equal where it is the same.
    `breaches`: as of an AssertedResult.
    """

    source: str
    target: str
    meaning: str
    severity: Severity
    location: Location
    breaches: tuple[str, ...] | None
