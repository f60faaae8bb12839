"""What a check ends with that does not accept."""

from __future__ import annotations


class NotAccepted(Exception):
    """Why a certificate is not accepted: a sentence, whose names are raw text of a keystore or a file."""


class Refused(NotAccepted):
    """The certificate does not prove the property of this keystore: the first thing that it lacks, or says wrongly."""


class CannotTell(NotAccepted):
    """The keystore, or the question, lies beyond what the checker understands."""
