"""Judges: the rules, and the severities that nothing else holds."""

from __future__ import annotations

from typing import Any

from keystore_audit.rules import (  # noqa: F401 - each registers its rules
    accepted,
    algorithm,
    anomaly,
    anomaly_names,
    asserted,
    audit,
    authority,
    breadth,
    certificate,
    crashes,
    data_tags,
    divergence,
    domain,
    drift,
    envelope,
    environment,
    foreign,
    formal,
    governance,
    identity,
    key_quality,
    layout,
    missing_files,
    observed,
    partition,
    permissions,
    portability,
    private_key,
    protection,
    provisioning,
    revocation,
    ros_services,
    ros_topics,
    rule_order,
    signature,
    start,
    stray,
    subject_names,
    validity,
    writable,
)
from keystore_audit.rules.registry import REGISTERED, Rule

RULES: tuple[Rule[Any], ...] = tuple(rule for key, rule in sorted(REGISTERED.items()) if key == rule.code)
"""Every rule, in report order."""

BY_CODE: dict[str, Rule[Any]] = {rule.code: rule for rule in RULES}
"""Rules by code."""
