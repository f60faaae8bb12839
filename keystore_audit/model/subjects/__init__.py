"""Whom the subjects of grants name: the comparisons of the implementations, and subjects that nobody here has."""
