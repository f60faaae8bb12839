"""`ros2 security audit`, from a workspace: the verb of the installed keystore-audit."""

from keystore_audit.ros2 import AuditVerb

__all__ = ["AuditVerb"]
