"""Grants for subjects that are no enclave here: the holder of such an identity may present the document.

The keystore of one robot holds its own enclaves; its authorities vouch for those of others too.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from operator import itemgetter
from typing import Final

from msgspec import Struct, field
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.model.comparison.change import Aspect, Direction, Layer
from keystore_audit.model.comparison.facts import Dates, Draft, folded, told
from keystore_audit.model.comparison.grants import (
    NOTHING,
    WORDS,
    Given,
    changed_right,
    dates_of,
    differing,
    either,
    given,
)
from keystore_audit.model.comparison.sides import Pair, Sides, View
from keystore_audit.model.formal.bit_sets import union
from keystore_audit.model.subjects.told import same_meaning
from keystore_audit.text import instant

SUBJECT: Final = "grant for"
"""What an aspect is called that has one of the subjects."""

MAX_SUBJECTS: Final = 3
_WHO: Final = "\0"
"""Stands for the subjects; it is in no name (XML 1.0, 2.2)."""

_PLAIN: Final = re.compile(r"CN=(?:/[A-Za-z0-9_]+)+")
"""Subjects that name nothing but themselves, under every implementation."""


class _Granted(Struct):
    """What documents that peers take grant one subject: `now`, and `ever`, once grants count that do not yet.

    `dates`: of those that are not over. `odd`: by document the order of its grants, where one of them may name the
    subject of another as well. `where`: the first of them. `places`: of the documents.
    """

    now: Given = NOTHING
    ever: Given = NOTHING
    dates: set[Dates] = field(default_factory=set)
    odd: set[tuple[tuple[str, Given], ...]] = field(default_factory=set)
    where: Location | None = None
    places: set[str] = field(default_factory=set)


def others_grants(sides: Sides) -> tuple[list[Draft], frozenset[str]]:
    """One draft for all subjects for which the same names changed; and the enclaves that carry such documents."""
    places: set[str] = set()
    found = [_worded(each) for each in folded(_changes(sides, places), sides)]
    carrying = (
        path
        for by_path in sides.enclaves
        for path, enclave in by_path.items()
        if enclave.permissions is not None and enclave.permissions.signed.file.place in places
    )
    return found, frozenset(carrying)


def _worded(draft: Draft) -> Draft:
    """The change with the subjects in its words, which stood in the place of enclaves."""
    subjects, direction = draft.enclaves, draft.direction
    more = f" and {len(subjects) - MAX_SUBJECTS} more" if len(subjects) > MAX_SUBJECTS else ""
    aspects = (
        Aspect(
            SUBJECT,
            None if direction is Direction.GAINED else each,
            None if direction is Direction.LOST else each,
            direction,
        )
        for each in subjects
    )
    who = f"whoever has the identity {' or '.join(subjects[:MAX_SUBJECTS])}{more}"
    return replace(draft, enclaves=(), what=draft.what.replace(_WHO, who), aspects=tuple(aspects))


def _changes(sides: Sides, places: set[str]) -> Iterator[Draft]:
    """One change for each subject, difference and pair; adds the `places` of the documents."""
    for pair in sides.pairs:
        views = pair.old, pair.new
        own, staying = ([_own_subjects(view, among) for view in views] for among in (None, sides.both))
        unguarded = _unguarded(pair.old) & _unguarded(pair.new)  # elsewhere the change of protection says so
        one, other, kept = (_granted(view, unguarded, own[0] & own[1]) for view in (*views, pair.kept))
        for subject in sorted({*one, *other}):
            old, new = (each.get(subject) or _Granted() for each in (one, other))
            for draft in _differences(sides, pair, old, new, kept.get(subject)):
                gained = draft.direction is Direction.GAINED
                # That an enclave came says that its rights did; that it went says that they did. One that took a
                # subject to which something was granted before says neither.
                before = old if gained else new
                by_enclave = draft.operation is not None and subject in own[gained]
                if not by_enclave or (subject in staying[gained] and before.dates):
                    places |= old.places | new.places
                    yield replace(draft, enclaves=(subject,), profiles=pair.profiles, old=old.where, new=new.where)


def _differences(sides: Sides, pair: Pair, old: _Granted, new: _Granted, kept: _Granted | None) -> Iterator[Draft]:
    now = dict(differing(sides, pair, old.now, new.now))
    ever = ((right, channels & ~now.get(right, 0)) for right, channels in differing(sides, pair, old.ever, new.ever))
    rights = [("", right, channels) for right, channels in now.items()]
    rights += [(", once a further grant takes effect,", right, channels) for right, channels in ever]
    for when, right, channels in rights:
        still = []
        if not right.gained and kept is not None and kept.dates:
            until = instant(max(end for _begin, end in kept.dates if end is not None))
            still.append((kept.ever.channels(pair.kept, right.operation), until))
        who = f"{_WHO}{when} "
        yield from changed_right(pair, right, channels, still, layer=Layer.GRANTS, kind="right-of-others", who=who)
    names = sides.mask & union(
        rights.channels(view, operation)
        for view, rights in ((pair.old, old.ever), (pair.new, new.ever))
        for operation in WORDS
    )
    if now or not names:
        return
    words = None
    if old.dates and new.dates and old.dates != new.dates:
        gone, come = (
            " and ".join(" to ".join(map(told, each)) for each in sorted(dates)) or "none"
            for dates in (old.dates - new.dates, new.dates - old.dates)
        )
        words = f"grants for {_WHO} have other dates ({gone} → {come}), on"
    elif old.odd != new.odd:
        words = f"grants for {_WHO} stand among others that may name it too, on"
    if words is not None:
        yield Draft(layer=Layer.GRANTS, kind="grant-of-others", direction=Direction.CHANGED, what=words, channels=names)


def _own_subjects(view: View, among: Collection[str] | None) -> frozenset[str]:
    """The subject_names that mean the identity of an enclave: `can` and the changes of enclaves speak of those.

    `among`: of enclaves of these paths alone.
    """
    firsts = {
        enclave.identity: evidence.identity
        for enclave in view.system.enclaves
        if enclave.identity is not None
        and (among is None or enclave.label in among)
        and (evidence := view.evidence.get(enclave.label)) is not None
        and evidence.identity is not None
    }
    found = {first.subject for first in firsts.values()}
    for text, number in view.subjects:
        named = view.system.grants[number].names & firsts.keys() if text not in found else ()
        if any(same_meaning(text, firsts[each]) for each in named):
            found.add(text)
    return frozenset(found)


def _granted(view: View, unguarded: int, skipped: frozenset[str]) -> dict[str, _Granted]:
    """By subject what documents that some peer takes grant it, those `skipped` aside; `unguarded`: domains that anybody
    whom a grant names may join.
    """
    system = view.system
    by_document = gathered(
        (system.grants[number].document, (text, number))
        for text, number in view.subjects
        if system.grants[number].document in view.taken
    )
    found: dict[str, _Granted] = {}
    for document, several in by_document.items():
        theirs = [(text, number) for text, number in several if text not in skipped]
        if not theirs:  # nearly always
            continue
        odd = not all(_PLAIN.fullmatch(text) for text, _number in several)
        order = {tuple((text, given(view, number)) for text, number in several)} if odd else set()
        decided: set[str] = set()
        for text, number in theirs:
            each, grant = found.setdefault(text, _Granted()), system.grants[number]
            each.where = each.where or grant.location
            each.places.add(system.documents[document].label)
            each.odd |= order
            in_force = view.permissions.in_force(grant.not_before, grant.not_after)
            if system.now <= grant.not_after and grant.not_before <= grant.not_after:
                gives = given(view, number)
                gives = gives._replace(joined=gives.joined | unguarded)
                each.ever = either((each.ever, gives))
                each.dates.add(dates_of(view, grant))
                if in_force and text not in decided:  # by no grant before it in its document
                    each.now = either((each.now, gives))
            if in_force or not system.reading_of(grant).skips_grants_out_of_date:
                decided.add(text)
    return found


def _unguarded(view: View) -> int:
    """The domains that peers let everybody join who has a grant, whatever it gives."""
    protections = (each.protection for each in view.trust_domains if each.reading.requires_grant)
    return union(each.ruled & ~each.join_controlled for each in protections)


def said_grants(view: View) -> dict[int, list[tuple[str, Dates, Given]]]:
    """By document for whom its grants are, from when to when, and what each gives, as these profiles read it."""
    found: dict[int, list[tuple[str, Dates, Given]]] = {}
    for text, number in view.subjects:
        grant = view.system.grants[number]
        found.setdefault(grant.document, []).append((text, dates_of(view, grant), given(view, number)))
    for grants in found.values():
        if all(_PLAIN.fullmatch(text) for text, _dates, _given in grants):
            grants.sort(key=itemgetter(0))  # of those for one subject the first decides, no other order counts
    return found
