"""What each DDS implementation does with a keystore, as data: `variants.py` has the rows."""

from __future__ import annotations

from keystore_audit.model.profiles.access import Access, JoinCheck, Local, OpenRange, PartitionReading, RelayReading
from keystore_audit.model.profiles.naming import implementations, scope_of, shipped_by
from keystore_audit.model.profiles.profile import Evidence, Profile, RevocationLists, SubjectComparison, Trust
from keystore_audit.model.profiles.variants import (
    ALIASES,
    DEFAULT,
    DISTRIBUTIONS,
    MIDDLEWARE,
    SPEC,
    VARIANTS,
    in_scope,
    resolve,
    running,
)
from keystore_audit.model.validity import DateReading

__all__ = [
    "ALIASES",
    "DEFAULT",
    "DISTRIBUTIONS",
    "MIDDLEWARE",
    "SPEC",
    "VARIANTS",
    "Access",
    "DateReading",
    "Evidence",
    "JoinCheck",
    "Local",
    "OpenRange",
    "PartitionReading",
    "Profile",
    "RelayReading",
    "RevocationLists",
    "SubjectComparison",
    "Trust",
    "implementations",
    "in_scope",
    "resolve",
    "running",
    "scope_of",
    "shipped_by",
]
