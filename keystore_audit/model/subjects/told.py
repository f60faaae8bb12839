"""Subjects as the text of a grant tells them: whom it means, and which grants name a certificate of just that subject.

Nobody here need have such a certificate; whoever has the key of an identity CA makes one, and another robot may have
one. By its grant alone is not who has it: Cyclone DDS takes a grant of `CN=/arm/hand` for one of `CN=/arm` too, and not
the other way about, and of several grants in a document the first that names the certificate decides.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Final

from cryptography import x509
from msgspec import Struct

from keystore_audit.model.formal.system import System
from keystore_audit.model.subjects.attributes import OBJECT_IDENTIFIERS
from keystore_audit.model.subjects.comparison import escaped, matching, split, unescaped
from keystore_audit.profiles import VARIANTS

Meaning = object
"""A subject however it is written: equal where the attributes are, in whatever order."""

_REMEMBERED: Final = 65_536


class ToldSubject(Struct, frozen=True):
    """A subject that a text tells (`attributes.Subject`)."""

    subject: str
    subject_name: x509.Name


@lru_cache(maxsize=_REMEMBERED)
def told(text: str) -> ToldSubject | None:
    """The subject that the text tells, whatever its blanks, its quotes and commas that say nothing; None for none."""
    relative = [_plainly(piece.strip(" ")) for piece in split(text, ",") if piece.strip(" ")]
    try:
        name = x509.Name.from_rfc4514_string(",".join(relative), OBJECT_IDENTIFIERS)
    except ValueError:
        return None
    return ToldSubject(subject=name.rfc4514_string(), subject_name=name) if relative else None


def _plainly(relative: str) -> str:
    kind, _sign, value = relative.partition("=")
    value = value.strip(" ")
    if value.startswith('"'):
        value = escaped(unescaped(value))
    return f"{kind.strip(' ')}={value}"


def meaning(text: str) -> Meaning:
    """Whom the text means; where it tells no subject, what it says."""
    subject = told(text)
    if subject is None:
        return text
    relative = ([(each.oid.dotted_string, each.value) for each in rdn] for rdn in subject.subject_name.rdns)
    return tuple(sorted(map(tuple, map(sorted, relative))))


def grants_naming(system: System, texts: Iterable[str]) -> Mapping[str, Sequence[frozenset[int]]]:
    """For each of `texts`, subject_names of grants: the grants that name a certificate of that very subject.

    As each profile of the system compares them: about certificates that are not here they may differ. What the text
    itself grants counts at all events, so that one that tells no subject is somebody's as well.
    """
    by_text: dict[str, set[int]] = {}
    for number, grant in enumerate(system.grants):
        by_text.setdefault(grant.subject, set()).add(number)
    found: dict[str, dict[frozenset[int], None]] = {text: {} for text in texts}
    subjects = {text: subject for text in found if (subject := told(text)) is not None}
    comparisons = dict.fromkeys(VARIANTS[name].trust.subjects for name in system.profiles if name in VARIANTS)
    for comparison in comparisons if subjects else ():
        naming = [set(by_text[text]) for text in subjects]
        for text, numbers in matching(tuple(by_text), tuple(subjects.values()), comparison).items():
            for number in numbers:
                naming[number] |= by_text[text]
        for text, grants in zip(subjects, naming, strict=True):
            found[text][frozenset(grants)] = None
    return {text: tuple(sets) or (frozenset(by_text[text]),) for text, sets in found.items()}
