"""What each DDS implementation does with a keystore, as data (`quirks.toml`). Nobody else names a vendor."""

from __future__ import annotations

from keystore_audit.profiles.alike import Alike
from keystore_audit.profiles.naming import (
    TESTED_ON,
    contrasted,
    doing,
    explained,
    implementations,
    scope_of,
    shipped_by,
    told,
)
from keystore_audit.profiles.peculiarities import (
    Access,
    DateReading,
    Evidence,
    JoinCheck,
    Local,
    Matcher,
    OpenRange,
    PartitionReading,
    Profile,
    RelayReading,
    RevocationLists,
    SubjectComparison,
    Trust,
)
from keystore_audit.profiles.scope import (
    ALIASES,
    DEFAULT,
    DISTRIBUTIONS,
    MIDDLEWARE,
    in_scope,
    resolve,
    running,
)
from keystore_audit.profiles.table import QUIRKS, SPEC, VARIANTS, TableError, check_reader

__all__ = [
    "ALIASES",
    "DEFAULT",
    "DISTRIBUTIONS",
    "MIDDLEWARE",
    "QUIRKS",
    "SPEC",
    "TESTED_ON",
    "VARIANTS",
    "Access",
    "Alike",
    "DateReading",
    "Evidence",
    "JoinCheck",
    "Local",
    "Matcher",
    "OpenRange",
    "PartitionReading",
    "Profile",
    "RelayReading",
    "RevocationLists",
    "SubjectComparison",
    "TableError",
    "Trust",
    "check_reader",
    "contrasted",
    "doing",
    "explained",
    "implementations",
    "in_scope",
    "resolve",
    "running",
    "scope_of",
    "shipped_by",
    "told",
]
