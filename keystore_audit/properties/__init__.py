"""The properties: each stated once, answered by both engines."""

from __future__ import annotations

from keystore_audit.properties import access_control, authentication, encryption, flow
from keystore_audit.properties.property import Answer, Property, Role, Status, Witness

PROPERTIES: tuple[Property, ...] = (
    authentication.PROPERTIES + encryption.PROPERTIES + access_control.PROPERTIES + flow.PROPERTIES
)
"""In report order."""

BY_ID = {prop.id: prop for prop in PROPERTIES}

__all__ = ["BY_ID", "PROPERTIES", "Answer", "Property", "Role", "Status", "Witness"]
