"""Renders a finished report; computes nothing."""
