"""Whom Cyclone DDS takes grants for beside those whose subjects they tell: whoever has a subject of some of its parts.

A grant of `CN=/robot/arm` names `CN=/robot` too. No keystore says whether its CA vouches for somebody of such a name
elsewhere, and for each grant there is one: `CN=/`, the enclave `/` of sros2, which nodes use that are given none. So
that is said beside a claim of who alone may publish, and violates it only where the keystore tells of one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.asked import ClaimAtom
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.model.subjects.comparison import MAX_PIECES, TOKENWISE, matching
from keystore_audit.model.subjects.told import ToldSubject, meaning, told
from keystore_audit.profiles import VARIANTS, SubjectComparison

_BETWEEN_PARTS: Final = re.compile("[,/|]")


def shorter_subjects(system: System, claim: ClaimAtom) -> Mapping[str, str]:
    """A subject that nobody here has, by the subject_name of a grant that lets it publish what the claim is about."""
    comparisons = {VARIANTS[name].trust.subjects for name in system.profiles if name in VARIANTS}
    granting = sorted(_granting(system, bits(claim.target.channels))) if comparisons & TOKENWISE else []
    known = {meaning(certificate.label) for certificate in system.certificates}
    wanted: dict[int, list[ToldSubject]] = {
        grant: [each for each in _shorter(system.grants[grant].subject) if meaning(each.subject) not in known]
        for grant in granting
    }
    found: dict[str, str] = {}
    for comparison in sorted(comparisons & TOKENWISE, key=lambda each: each.value):
        deciding = _deciding(system, wanted, comparison)
        for grant, subjects in wanted.items():
            taken = [each.subject for each in subjects if grant in deciding[each.subject]]
            for subject in taken[:1]:
                found.setdefault(system.grants[grant].subject, subject)
    return found


def _granting(system: System, asked: int) -> Iterator[int]:
    """The grants in force that let publish some of these channels, in documents that peers take."""
    permissions = Permissions(system)
    governed = [(view.accepted, view.protection.governed & asked) for view in trust_domain_views(system, permissions)]
    for number, grant in enumerate(system.grants):
        here = [channels for accepted, channels in governed if channels and grant.document in accepted]
        if here and permissions.in_force(grant.not_before, grant.not_after):
            allowed = permissions.met(permissions.allowed(number, Operation.PUBLISH))
            if any(allowed & channels for channels in here):
                yield number


def _shorter(text: str) -> Iterator[ToldSubject]:
    """The subjects of all parts of the text but the last ones, the longest first; of too many it names nobody."""
    places = [found.start() for found in _BETWEEN_PARTS.finditer(text)]
    for place in reversed(places) if len(places) <= MAX_PIECES else ():
        kept = text[: place + 1] if text[:place].endswith("=") else text[:place]  # no subject ends so: `CN=/` is one
        subject = told(kept)
        if subject is not None:
            yield subject


def _deciding(
    system: System, wanted: Mapping[int, Iterable[ToldSubject]], comparison: SubjectComparison
) -> Mapping[str, frozenset[int]]:
    """By subject: the grants that decide about it, of each document the first that is taken to name it."""
    subjects = list({each.subject: each for several in wanted.values() for each in several}.values())
    documents = {system.grants[number].document for number in wanted}
    grants = [number for number, grant in enumerate(system.grants) if grant.document in documents]
    named = matching([system.grants[number].subject for number in grants], subjects, comparison)
    first: list[dict[int, int]] = [{} for _ in subjects]
    for number in grants:
        for place in named[system.grants[number].subject]:
            first[place].setdefault(system.grants[number].document, number)
    return {each.subject: frozenset(by.values()) for each, by in zip(subjects, first, strict=True)}
