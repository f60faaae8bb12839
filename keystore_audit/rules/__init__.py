"""Judges: the rules, and the severities that nothing else holds."""

from __future__ import annotations

from typing import Any

from keystore_audit.rules.audit import AUDIT
from keystore_audit.rules.certificate import CERTIFICATE
from keystore_audit.rules.formal import FORMAL
from keystore_audit.rules.governance import GOVERNANCE
from keystore_audit.rules.layout import LAYOUT
from keystore_audit.rules.permissions import PERMISSIONS
from keystore_audit.rules.private_key import PRIVATE_KEY
from keystore_audit.rules.registry import Rule
from keystore_audit.rules.signature import SIGNATURE

RULES: tuple[Rule[Any], ...] = tuple(
    sorted(
        (*LAYOUT, *CERTIFICATE, *PRIVATE_KEY, *SIGNATURE, *GOVERNANCE, *PERMISSIONS, *FORMAL, *AUDIT),
        key=lambda rule: rule.code,
    )
)
"""In report order."""

BY_CODE = {rule.code: rule for rule in RULES}
"""Rules by code."""
