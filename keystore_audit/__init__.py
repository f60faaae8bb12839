"""Audit SROS2 keystores: what the signed artifacts allow, as the robots read them."""

__version__ = "0.1.0"
