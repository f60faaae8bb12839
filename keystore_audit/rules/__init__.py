"""Judges: the rules, and the severities that nothing else holds."""

from __future__ import annotations

from typing import Any

from keystore_audit.rules.accepted import ACCEPTED
from keystore_audit.rules.algorithm import ALGORITHM
from keystore_audit.rules.anomaly import ANOMALY
from keystore_audit.rules.anomaly_names import ANOMALY_NAMES
from keystore_audit.rules.asserted import ASSERTED
from keystore_audit.rules.audit import AUDIT
from keystore_audit.rules.authority import AUTHORITY
from keystore_audit.rules.breadth import BREADTH
from keystore_audit.rules.certificate import CERTIFICATE
from keystore_audit.rules.crashes import CRASHES
from keystore_audit.rules.data_tags import DATA_TAGS
from keystore_audit.rules.divergence import DIVERGENCE
from keystore_audit.rules.domain import DOMAIN
from keystore_audit.rules.drift import DRIFT
from keystore_audit.rules.envelope import ENVELOPE
from keystore_audit.rules.environment import ENVIRONMENT
from keystore_audit.rules.formal import FORMAL
from keystore_audit.rules.governance import GOVERNANCE
from keystore_audit.rules.identity import IDENTITY
from keystore_audit.rules.labels import LABELS
from keystore_audit.rules.layout import LAYOUT
from keystore_audit.rules.observed import OBSERVED
from keystore_audit.rules.partition import PARTITION
from keystore_audit.rules.permissions import PERMISSIONS
from keystore_audit.rules.portability import PORTABILITY
from keystore_audit.rules.private_key import PRIVATE_KEY
from keystore_audit.rules.protection import PROTECTION
from keystore_audit.rules.provisioning import PROVISIONING
from keystore_audit.rules.registry import Rule
from keystore_audit.rules.revocation import REVOCATION
from keystore_audit.rules.ros_services import ROS_SERVICES
from keystore_audit.rules.ros_topics import ROS_TOPICS
from keystore_audit.rules.rule_order import RULE_ORDER
from keystore_audit.rules.signature import SIGNATURE
from keystore_audit.rules.start import START
from keystore_audit.rules.stray import STRAY
from keystore_audit.rules.subject_names import SUBJECT_NAMES
from keystore_audit.rules.validity import VALIDITY
from keystore_audit.rules.writable import WRITABLE

RULES: tuple[Rule[Any], ...] = tuple(
    sorted(
        (
            *LAYOUT,
            *START,
            *PRIVATE_KEY,
            *WRITABLE,
            *CERTIFICATE,
            *ALGORITHM,
            *IDENTITY,
            *AUTHORITY,
            *REVOCATION,
            *SIGNATURE,
            *ENVELOPE,
            *GOVERNANCE,
            *PROTECTION,
            *DOMAIN,
            *PERMISSIONS,
            *CRASHES,
            *SUBJECT_NAMES,
            *VALIDITY,
            *BREADTH,
            *DIVERGENCE,
            *RULE_ORDER,
            *PARTITION,
            *DATA_TAGS,
            *DRIFT,
            *PORTABILITY,
            *ROS_SERVICES,
            *ROS_TOPICS,
            *ANOMALY,
            *ANOMALY_NAMES,
            *OBSERVED,
            *STRAY,
            *PROVISIONING,
            *ENVIRONMENT,
            *FORMAL,
            *ASSERTED,
            *LABELS,
            *AUDIT,
            *ACCEPTED,
        ),
        key=lambda rule: rule.code,
    )
)
"""Every rule, in report order."""

BY_CODE: dict[str, Rule[Any]] = {rule.code: rule for rule in RULES}
"""Rules by code."""
