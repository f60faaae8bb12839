"""Subjects as the text of a grant tells them: whom it means, and which grants name a certificate of just that subject.

Nobody here need have such a certificate. The holder of an identity CA's key can make one, and another robot may have
one. A grant alone does not say who has it. Cyclone DDS takes a grant of `CN=/arm/hand` for one of `CN=/arm` too, but
not the other way about. Of several grants in a document, the first that names the certificate decides.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Final

from cryptography import x509
from msgspec import Struct

from keystore_audit.keystore.attribute_types import OBJECT_IDENTIFIERS, written
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Grant, PermissionsFile
from keystore_audit.model.formal.system import System
from keystore_audit.model.subjects.attributes import Subject, compact, typed
from keystore_audit.model.subjects.comparison import COMPACT_TOO, escaped, matching, split
from keystore_audit.profiles import VARIANTS, SubjectComparison

Meaning = object
"""A subject however it is written: equal where the attributes are, in whatever order."""

_REMEMBERED: Final = 65_536

_COMPACT: Final = re.compile(r"(?:/[A-Za-z0-9.]+=[^/,+]+)+")

_ESCAPED: Final = re.compile(rb"\\(?:([0-9A-Fa-f]{2})|(.?))", re.DOTALL)


class ToldSubject(Struct, frozen=True):
    """A subject that a text tells (`attributes.Subject`)."""

    subject: str
    subject_name: x509.Name


@lru_cache(maxsize=_REMEMBERED)
def told(text: str) -> ToldSubject | None:
    """The subject that the text tells, whatever its blanks, its quotes, its escapes and commas that say nothing.

    In the form of RFC 4514, or as `/type=value/type=value` where no value has a slash. None: it tells none.
    """
    bare = text.strip()
    if _COMPACT.fullmatch(bare):
        bare = ",".join(reversed(bare[1:].replace("\\x", "\\").split("/")))
    pieces = [piece for piece in split(bare, ",") if piece.strip(" ")]
    relative = ["+".join(map(_plainly, split(piece, "+"))) for piece in pieces]
    try:
        name = x509.Name.from_rfc4514_string(",".join(relative), OBJECT_IDENTIFIERS)
    except ValueError:
        return None
    return ToldSubject(subject=written(name), subject_name=name) if relative else None


def _plainly(attribute: str) -> str:
    kind, _sign, value = attribute.partition("=")
    return f"{kind.strip(' ')}={escaped(_unescaped(value.strip(' ')))}"


def _unescaped(value: str) -> str:
    """Without the quotes around it and the backslashes in it."""
    if len(value) > 1 and value[0] == value[-1] == '"':
        value = value[1:-1]
    octets = _ESCAPED.sub(lambda found: bytes.fromhex(found[1].decode()) if found[1] else found[2], value.encode())
    return octets.decode("utf-8", "backslashreplace")


def meaning(text: str) -> Meaning:
    """Whom the text means; where it tells no subject, what it says."""
    subject = told(text)
    return _slashes_bare(text.strip()) if subject is None else _attributes(subject)


@lru_cache(maxsize=_REMEMBERED)
def meanings(certificate: Subject) -> tuple[Meaning, Meaning]:
    """The meanings of a text that means the certificate's subject: its attributes, and all of it between slashes."""
    return _attributes(certificate), _slashes_bare(compact(certificate))


def same_meaning(text: str, certificate: Subject) -> bool:
    """Whether the text means the certificate's subject, in whatever order and spelling."""
    return text == certificate.subject or meaning(text) in meanings(certificate)


def contested(file: PermissionsFile, comparison: SubjectComparison) -> bool:
    """Whether it rests on who begins a handshake which grant of the document counts for a peer (measured).

    So it is where one grant is for another's subject in the form `compact`.
    """
    slashed = {text for text in file.subjects if text.startswith("/")} if comparison in COMPACT_TOO else ()
    others = file.subjects.difference(slashed) if slashed else ()
    return any(compact(each) in slashed for each in map(told, others) if each is not None)


def own_grant(enclave: Enclave) -> Grant | None:
    """The first grant of its document that says the enclave's subject, else the first that means it."""
    first = enclave.identity
    if first is None:
        return None
    said = (grant for grant in enclave.grants if grant.subject_name.text == first.subject)
    meant = (grant for grant in enclave.grants if same_meaning(grant.subject_name.text, first))
    return next(said, None) or next(meant, None)


def _attributes(subject: Subject) -> Meaning:
    return tuple(sorted(tuple(sorted(map(typed, relative))) for relative in subject.subject_name.rdns))


def _slashes_bare(text: str) -> str:
    return text.replace("\\/", "/")


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
    names = (*system.profiles, *system.others)
    comparisons = dict.fromkeys(VARIANTS[name].trust.subjects for name in names if name in VARIANTS)
    for comparison in comparisons if subjects else ():
        naming = [set(by_text[text]) for text in subjects]
        for text, numbers in matching(tuple(by_text), tuple(subjects.values()), comparison).items():
            for number in numbers:
                naming[number] |= by_text[text]
        for text, grants in zip(subjects, naming, strict=True):
            found[text][frozenset(grants)] = None
    return {text: tuple(sets) or (frozenset(by_text[text]),) for text, sets in found.items()}
