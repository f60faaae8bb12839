"""The report as one web page that needs nothing but itself: no network, no script, no other file."""

from __future__ import annotations

from keystore_audit.report.html.page import render

__all__ = ["render"]
