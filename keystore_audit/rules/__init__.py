"""Judges: the rules, and the severities that nothing else holds."""

from __future__ import annotations

from typing import Any

from keystore_audit.rules import (  # noqa: F401 - each registers its rules
    anomaly,
    anomaly_names,
    audit,
    authority,
    breadth,
    certificate,
    divergence,
    drift,
    envelope,
    environment,
    files,
    formal,
    governance,
    grants,
    identity,
    layout,
    network,
    network_access,
    network_drift,
    observed,
    permissions,
    portability,
    private_key,
    protection,
    provisioning,
    restrictions,
    revocation,
    ros,
    signature,
    unmanaged,
)
from keystore_audit.rules.registry import REGISTERED, Rule

RULES: tuple[Rule[Any], ...] = tuple(rule for key, rule in sorted(REGISTERED.items()) if key == rule.code)
"""Every rule, in report order."""

BY_CODE: dict[str, Rule[Any]] = {rule.code: rule for rule in RULES}
"""Rules by code."""
