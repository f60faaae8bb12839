"""The checker of certificates (docs/certificates.md): it shares no code with whatever decides elsewhere in the house.

Its world is small. Whatever lies beyond it is `CannotTell`, one answer for the whole class.
"""
