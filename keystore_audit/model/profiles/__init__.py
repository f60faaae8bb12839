"""What each DDS implementation does with a keystore, as data: `variants.py` has the rows."""

from __future__ import annotations

from keystore_audit.model.profiles.profile import Profile, RevocationLists, SubjectComparison, Trust
from keystore_audit.model.profiles.variants import ALIASES, DEFAULT, VARIANTS, resolve

__all__ = ["ALIASES", "DEFAULT", "VARIANTS", "Profile", "RevocationLists", "SubjectComparison", "Trust", "resolve"]
