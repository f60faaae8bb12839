"""The properties: each stated once, answered by both engines."""

from __future__ import annotations

from keystore_audit.properties.result import Answer, Property, Role, Status, Witness
from keystore_audit.properties.stated import PROPERTIES

BY_ID = {prop.id: prop for prop in PROPERTIES}

__all__ = ["BY_ID", "PROPERTIES", "Answer", "Property", "Role", "Status", "Witness"]
