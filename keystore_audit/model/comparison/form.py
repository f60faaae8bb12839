"""The form of signed documents and of certificates that say the same: digests, algorithms, and what is out of order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.public_key import is_weak_algorithm, is_weak_kind
from keystore_audit.model.comparison.change import Aspect, Direction, direction_of, joint_direction
from keystore_audit.model.comparison.facts import Fact, listing
from keystore_audit.model.inventory import Typed

DOCUMENT: Final = "document-form"
CERTIFICATE: Final = "certificate-form"


def document_form(word: str, old: Typed, new: Typed) -> Iterator[Fact]:
    """What a document signed again has otherwise; a weak digest is less protection: others may have the signature."""
    aspects = []
    digests = [", ".join(sorted({each.digest for each in file.signed.signatures})) or None for file in (old, new)]
    weak = [Kind.WEAK_DIGEST in _kinds(file) for file in (old, new)]
    if digests[0] != digests[1] or weak[0] != weak[1]:
        aspects.append(_aspect("digest", digests[0], digests[1], weak[0], weak[1]))
    kinds = [_kinds(file) - {Kind.WEAK_DIGEST} for file in (old, new)]
    if kinds[0] != kinds[1]:
        lost, found = ([kind.value for kind in one - other] for one, other in (kinds, kinds[::-1]))
        aspects.append(listing("out of order", lost, found, Direction.CHANGED))
    if aspects:
        yield Fact(DOCUMENT, joint_direction(aspects), f"its {word}: signed again in another form", tuple(aspects))


def _kinds(file: Typed) -> set[Kind]:
    return {defect.kind for defect in (*file.signed.defects, *file.defects)}


def certificate_form(what: str, old: Certificate, new: Certificate) -> Iterator[Fact]:
    """What a certificate issued again has otherwise; a weak key or signature is less protection."""
    aspects = []
    if old.key_kind != new.key_kind:
        aspects.append(
            _aspect("key", old.key_kind, new.key_kind, is_weak_kind(old.key_kind), is_weak_kind(new.key_kind))
        )
    algorithms = old.signature_algorithm, new.signature_algorithm
    if algorithms[0] != algorithms[1]:
        aspects.append(_aspect("signature algorithm", *algorithms, *map(is_weak_algorithm, algorithms)))
    alike = bool(old.is_ca) == bool(new.is_ca)  # else that is a change of its own, and accounts for the rest
    for name, one, other in (
        ("key usage", _listed(old.key_usage), _listed(new.key_usage)),
        ("extended key usage", _listed(old.extended_key_usage), _listed(new.extended_key_usage)),
        ("path length", _number(old.path_length), _number(new.path_length)),
        ("constraints", _listed(old.constraints), _listed(new.constraints)),
        ("unknown critical extensions", _listed(old.unknown_critical), _listed(new.unknown_critical)),
    ):
        if alike and one != other:
            aspects.append(Aspect(what=name, old=one, new=other, direction=Direction.CHANGED))
    if aspects:
        yield Fact(CERTIFICATE, joint_direction(aspects), f"{what} another form than before", tuple(aspects))


def _aspect(what: str, old: str | None, new: str | None, was_weak: bool, is_weak: bool) -> Aspect:
    """Which of two weak ones is worse is not judged: one in the place of another is both."""
    direction = direction_of(gains=is_weak, losses=was_weak)
    return Aspect(what=what, old=old, new=new, direction=direction)


def _listed(values: Iterable[str] | None) -> str | None:
    return None if values is None else ", ".join(sorted(values)) or "nothing"


def _number(value: int | None) -> str | None:
    return None if value is None else str(value)
