"""Judges: the rules, and the severities that nothing else holds."""
