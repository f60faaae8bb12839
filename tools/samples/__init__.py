"""Builds `sample_keystores/`: healthy and stock keystores, and one bad and one good keystore for every rule.

Every private key that comes out of here is derived from a public label: samples only, worth nothing
anywhere else.
"""
