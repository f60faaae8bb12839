"""Our verdict on a message beside OpenSSL's, for implementations that pin the signer and for those that chain."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from functools import lru_cache

from msgspec import Struct

from keystore_audit.keystore.certificate import CertificateFile
from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.smime import Candidates, SignedDocument, read_signed
from keystore_audit.model.trust.chain import path_refusal
from keystore_audit.model.trust.verdicts import document_verdict
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.keystore.builder import Signed, present, read
from tests.oracles.smime.oracle import Answer, Oracle

PINNED = VARIANTS["spec"].trust
CHAINED = VARIANTS["fastdds-2.9"].trust
"""Implementations that pin the signer, and those that follow a chain: the latter as Fast DDS 2.9.1 does."""

INSTANT = datetime(2030, 1, 1, tzinfo=timezone.utc)
"""At which the program in C looks at chains."""

_VARIABLE = re.compile(
    r'"[^"]*"|\b\d+(?:\.\d+)+\b|-?\b\d+\b|(?<=whose key is ).*|(?<=, key ).*'
    r"|(?<=cannot be read as CMS signed data: ).*|(?<=an algorithm identifier cannot be read: ).*|(?<=base64: ).*",
    re.DOTALL,
)
_ALGORITHMS = re.compile(r"\b(?:md5|sha\d+)\b")


class Comparison(Struct, frozen=True, kw_only=True):
    """A message as we read it, our verdicts on it, and OpenSSL's."""

    document: SignedDocument
    pinned: Truth
    chained: Truth
    answer: Answer

    def contradictions(self) -> list[str]:
        """Where we are certain and wrong. Unknown contradicts nothing: the gate is then shut.

        Accepted has to mean accepted with the same bytes, refused has to mean refused: a robot that grants what we
        call denied is as bad as the opposite.
        """
        found = []
        for variant, ours, theirs in (
            ("pinned", self.pinned, self.answer.pinned),
            ("chained", self.chained, self.answer.chained),
        ):
            if ours is Truth.YES and theirs is None:
                found.append(f"{variant}: we accept, OpenSSL refuses")
            elif ours is Truth.YES and theirs != self.document.content:
                found.append(f"{variant}: we read other bytes than OpenSSL")
            elif ours is Truth.NO and theirs is not None:
                found.append(f"{variant}: we refuse, OpenSSL accepts")
            elif ours is not Truth.UNKNOWN and self.answer.split:
                found.append(f"{variant}: we are certain, and OpenSSL reads a file in another way than memory")
        return found

    def stricter(self) -> frozenset[tuple[str, str]]:
        """The reasons for which we leave open what OpenSSL accepts: kind of defect, and what it says."""
        accepted = self.answer.pinned is not None or self.answer.chained is not None
        if not accepted and not self.answer.split:
            return frozenset()
        if Truth.UNKNOWN not in (self.pinned, self.chained):
            return frozenset()
        return frozenset((defect.kind.value, said(defect)) for defect in self.document.defects if defect.kind.opaque)

    def columns(self) -> tuple[str, ...]:
        """What stands in `verdicts.tsv`."""
        found = sorted({defect.kind.value for defect in self.document.defects})
        split = ", split" if self.answer.split else ""
        theirs = ["refused" if content is None else "accepted" for content in (self.answer.pinned, self.answer.chained)]
        ours = WORDS[self.pinned], WORDS[self.chained]
        return (" ".join(found) or "-", ours[0], theirs[0] + split, ours[1], theirs[1] + split)


WORDS = {Truth.YES: "accepted", Truth.NO: "refused", Truth.UNKNOWN: "unknown"}


def said(defect: Defect) -> str:
    """What a defect says, without what differs from one message to the next."""
    return _ALGORITHMS.sub("…", _VARIABLE.sub("…", defect.detail))


@lru_cache(maxsize=64)
def _trusted(trusted: tuple[Signed, ...], known: tuple[Signed, ...]) -> tuple[bytes, CertificateFile, Candidates]:
    """The certificates of the keystore are copies in files of others, as where enclaves have no links."""
    pem = b"".join(signed.pem for signed in trusted)
    return pem, read(pem), Candidates(read(*(signed.pem for signed in known), pem).certificates)


def compare(oracle: Oracle, message: bytes, trusted: Sequence[Signed], known: Iterable[Signed] = ()) -> Comparison:
    """Read a message and ask OpenSSL about it; `known` are other certificates of the keystore."""
    pem, file, candidates = _trusted(tuple(trusted), tuple(known))
    document = read_signed(present(message), candidates)
    oracle.trust(pem)
    chained = document_verdict(document, file, CHAINED)
    lost = chained is Truth.YES and path_refusal(document, file, CHAINED, INSTANT) is not None
    return Comparison(
        document=document,
        pinned=document_verdict(document, file, PINNED),
        chained=Truth.NO if lost else chained,
        answer=oracle.ask(message),
    )
