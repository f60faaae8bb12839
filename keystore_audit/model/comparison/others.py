"""Grants for subjects that are no enclave here: whoever holds such an identity may present the document.

The keystore of one robot holds its own enclaves; its authorities vouch for those of others too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from operator import itemgetter
from typing import Final, NamedTuple

from msgspec import Struct, field

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.permissions import Operation, PermissionsFile
from keystore_audit.model.comparison.change import Aspect, Direction, Layer
from keystore_audit.model.comparison.drafts import Draft, Fold, Folds
from keystore_audit.model.comparison.facts import Dates, told
from keystore_audit.model.comparison.grants import NOTHING, WORDS, Given, Right, differing, either, given
from keystore_audit.model.comparison.sides import Pair, Sides, View
from keystore_audit.model.comparison.still import JOIN, may
from keystore_audit.model.formal.bit_sets import members, union
from keystore_audit.model.subjects.comparison import same_meaning
from keystore_audit.text import instant

KINDS: Final = ("right-of-others", "grant-of-others")
SUBJECT: Final = "grant for"
"""What an aspect is called that has one of the subjects."""

MAX_SUBJECTS: Final = 3
_PLAIN: Final = re.compile(r"CN=(?:/[A-Za-z0-9_]+)+")
"""Subjects that name nothing but themselves, under every implementation."""


class _Granted(Struct):
    """What documents that peers take grant one subject: `now`, and `ever`, once grants count that do not yet.

    `dates`: of those that are not over. `odd`: by document the order of its grants, where one of them may name the
    subject of another as well. `where`: the first of them.
    """

    now: Given = NOTHING
    ever: Given = NOTHING
    dates: set[Dates] = field(default_factory=set)
    odd: set[tuple[tuple[str, Given], ...]] = field(default_factory=set)
    where: Location | None = None
    places: set[str] = field(default_factory=set)


_Grants = list[tuple[str, Dates, Given]]


class _Key(NamedTuple):
    """A change for one subject. `later`: of a right that does not count yet. `until`: when what is lost ends.

    `right` None: other dates, or other grants beside it that may name the subject too.
    """

    right: Right | None
    later: bool
    dates: tuple[tuple[Dates, ...], tuple[Dates, ...]] | None
    until: str | None = None


class OthersGrants:
    """Changes of what others are granted. `places`: the documents that have them."""

    def __init__(self, sides: Sides) -> None:
        self.places: set[str] = set()
        self._sides = sides
        self._found = Folds[_Key]()
        for pair in sides.pairs:
            self._compare(pair)

    def drafts(self) -> list[Draft]:
        """One for all subjects for which the same names changed."""
        return [_draft(key, fold) for key, fold in self._found.folded(self._sides)]

    def _compare(self, pair: Pair) -> None:
        views = pair.old, pair.new
        own = [_own_subjects(view, pair, self._sides, side) for side, view in enumerate(views)]
        both = frozenset(self._sides.common)
        staying = [_own_subjects(view, pair, self._sides, side, both) for side, view in enumerate(views)]
        granted = [_granted(view, pair, self._sides, side, own[0] & own[1]) for side, view in enumerate(views)]
        kept = _granted(pair.kept, pair, self._sides, 2, own[0] & own[1])
        for subject in sorted({*granted[0], *granted[1]}):
            old, new = (each.get(subject) or _Granted() for each in granted)
            for key, channels in self._differences(pair, old, new):
                if key.right is not None and subject in own[key.right.gained]:
                    # That an enclave came says that its rights did; that it went says that they did. One that took a
                    # subject to which something was granted before says neither.
                    before = old if key.right.gained else new
                    if subject not in staying[key.right.gained] or not before.dates:
                        continue
                for part, until in _left(pair, key, kept.get(subject), channels):
                    self._found.note(key._replace(until=until), subject, pair, part, old.where, new.where)
                self.places |= old.places | new.places

    def _differences(self, pair: Pair, old: _Granted, new: _Granted) -> Iterator[tuple[_Key, int]]:
        now = list(differing(self._sides, pair, old.now, new.now))
        told: dict[Right, int] = dict(now)
        for right, channels in now:
            yield _Key(right, False, None), channels
        for right, channels in differing(self._sides, pair, old.ever, new.ever):
            if channels & ~told.get(right, 0):
                yield _Key(right, True, None), channels & ~told.get(right, 0)
        names = (_all(pair.old, old.ever) | _all(pair.new, new.ever)) & self._sides.mask
        if now or not names:
            return
        if old.dates and new.dates and old.dates != new.dates:
            dates = tuple(sorted(old.dates - new.dates)), tuple(sorted(new.dates - old.dates))
            yield _Key(None, False, dates), names
        elif old.odd != new.odd:
            yield _Key(None, False, None), names


def _left(pair: Pair, key: _Key, kept: _Granted | None, channels: int) -> Iterator[tuple[int, str | None]]:
    """Of what is lost, what documents of before still grant, and until when; and (None) the rest."""
    still = 0
    if key.right is not None and not key.right.gained and kept is not None and kept.dates:
        joined = pair.kept.decisions.within(members(kept.ever.joined))
        still = channels & (joined if key.right.operation == JOIN else kept.ever.of(Operation(key.right.operation)))
        if still:
            yield still, instant(max(end for _begin, end in kept.dates if end is not None))
    if channels & ~still:
        yield channels & ~still, None


def _draft(key: _Key, fold: Fold) -> Draft:
    """One for all subjects for which the same names changed."""
    direction = Direction.CHANGED
    if key.right is not None:
        direction = Direction.GAINED if key.right.gained else Direction.LOST
    return Draft(
        layer=Layer.GRANTS,
        kind=KINDS[key.right is None],
        direction=direction,
        what=_words(key, fold.whom),
        enclaves=(),
        profiles=fold.profiles,
        operation=key.right.operation if key.right is not None else None,
        aspects=tuple(_aspect(subject, direction) for subject in fold.whom),
        channels=fold.channels,
        varies=fold.varies,
        old=fold.old,
        new=fold.new,
        until=key.until,
    )


def _own_subjects(
    view: View, pair: Pair, sides: Sides, side: int, among: frozenset[str] | None = None
) -> frozenset[str]:
    """The subject_names that mean the identity of an enclave: `can` and the changes of enclaves speak of those.

    `among`: of enclaves of these paths alone.
    """
    firsts: dict[int, Certificate] = {}
    for enclave in view.system.enclaves:
        if among is not None and enclave.label not in among:
            continue
        evidence = sides.enclaves[side].get(enclave.label)
        first = evidence.identity if evidence is not None else None
        if first is not None and enclave.identity is not None:
            firsts[enclave.identity] = first
    found = {first.subject for first in firsts.values()}
    for text, number in _texts(view, pair, sides, side):
        named = view.system.grants[number].names & firsts.keys() if text not in found else ()
        if any(same_meaning(text, firsts[each]) for each in named):
            found.add(text)
    return frozenset(found)


def _texts(view: View, pair: Pair, sides: Sides, side: int) -> Iterator[tuple[str, int]]:
    """The subject_name of each grant of the system, in order."""
    numbers = gathered((grant.document, number) for number, grant in enumerate(view.system.grants))
    for document, grants in numbers.items():
        file = sides.documents[side][view.system.documents[document].label]
        if isinstance(file, PermissionsFile):
            read = sides.accesses.read(file, pair.lead.access).grants or ()
            for number, each in zip(grants, read, strict=True):
                yield each.grant.subject_name.text, number


def _granted(view: View, pair: Pair, sides: Sides, side: int, skipped: frozenset[str]) -> dict[str, _Granted]:
    """By subject what documents that some peer takes grant it, those `skipped` aside."""
    system = view.system
    by_document = gathered(
        (system.grants[number].document, (text, number))
        for text, number in _texts(view, pair, sides, side)
        if system.grants[number].document in view.taken
    )
    found: dict[str, _Granted] = {}
    unguarded = _unguarded(pair.old) & _unguarded(pair.new)  # elsewhere the change of protection says so
    for document, several in by_document.items():
        theirs = [(text, number) for text, number in several if text not in skipped]
        if not theirs:  # nearly always
            continue
        order: tuple[tuple[str, Given], ...] = ()
        if not all(_PLAIN.fullmatch(text) for text, _number in several):
            order = tuple((text, given(view, number)) for text, number in several)
        decided: set[str] = set()
        for text, number in theirs:
            each = found.setdefault(text, _Granted())
            each.where = each.where or system.grants[number].location
            each.places.add(system.documents[document].label)
            each.odd |= {order} if order else set()
            _add(view, each, number, unguarded, first=text not in decided)
            if not system.skips_grants_out_of_date or _in_force(view, number):
                decided.add(text)
    return found


class SameGrants:
    """Whether documents have the same grants: for whom, from when to when, and what each of them gives."""

    def __init__(self, sides: Sides) -> None:
        self._sides = sides
        self._known: dict[tuple[int, int], dict[int, _Grants]] = {}

    def of(self, pair: Pair, path: str) -> bool:
        """Whether the enclave's own permissions have, as these profiles read them."""
        views = pair.old, pair.new
        documents = [view.enclave(path).permissions for view in views]
        one, other = (
            self._grants(view, pair, side).get(document, []) if document is not None else None
            for side, (view, document) in enumerate(zip(views, documents, strict=True))
        )
        return one is not None and one == other

    def _grants(self, view: View, pair: Pair, side: int) -> dict[int, _Grants]:
        """By document."""
        key = side, id(view)
        if key not in self._known:
            found = self._known[key] = {}
            instants = view.system.instants
            for text, number in _texts(view, pair, self._sides, side):
                grant = view.system.grants[number]
                dates = instants[grant.not_before], instants[grant.not_after]
                found.setdefault(grant.document, []).append((text, dates, given(view, number)))
            for grants in found.values():
                if all(_PLAIN.fullmatch(text) for text, _dates, _given in grants):
                    grants.sort(key=itemgetter(0))  # of those for one subject the first decides, no other order counts
        return self._known[key]


def _unguarded(view: View) -> int:
    """The domains that peers let everybody join whom some grant names, whatever it gives."""
    protections = (realm.protection for realm in (view.realms if view.system.requires_grant else ()))
    return union(each.ruled & ~each.join_controlled for each in protections)


def _add(view: View, granted: _Granted, number: int, unguarded: int, *, first: bool) -> None:
    """Add what a grant gives; `first`: no grant before it in its document decides about the subject."""
    grant, instants = view.system.grants[number], view.system.instants
    if grant.not_after < view.system.now or grant.not_after < grant.not_before:
        return
    gives = given(view, number)
    gives = gives._replace(joined=gives.joined | unguarded)
    granted.ever = either(granted.ever, gives)
    granted.dates.add((instants[grant.not_before], instants[grant.not_after]))
    if first and _in_force(view, number):
        granted.now = either(granted.now, gives)


def _in_force(view: View, number: int) -> bool:
    grant = view.system.grants[number]
    return view.permissions.in_force(grant.not_before, grant.not_after)


def _all(view: View, rights: Given) -> int:
    """The names of which they speak: of domains that may be joined, all."""
    return rights.publish | rights.subscribe | rights.relay | view.decisions.within(members(rights.joined))


def _words(key: _Key, subjects: list[str]) -> str:
    more = f" and {len(subjects) - MAX_SUBJECTS} more" if len(subjects) > MAX_SUBJECTS else ""
    who = f"whoever has the identity {' or '.join(subjects[:MAX_SUBJECTS])}{more}"
    if key.dates is not None:
        old, new = (" and ".join(" to ".join(map(told, each)) for each in dates) or "none" for dates in key.dates)
        return f"grants for {who} have other dates ({old} → {new}), on"
    if key.right is None:
        return f"grants for {who} stand among others that may name it too, on"
    when = ", once a grant counts that does not yet," if key.later else ""
    return f"{who}{when} {may(WORDS[key.right.operation], key.until, gained=key.right.gained)}"


def _aspect(subject: str, direction: Direction) -> Aspect:
    old = None if direction is Direction.GAINED else subject
    new = None if direction is Direction.LOST else subject
    return Aspect(what=SUBJECT, old=old, new=new, direction=direction)


def carriers(places: Iterable[str], sides: Sides) -> set[str]:
    """The enclaves whose own permissions are one of these documents, in either keystore."""
    wanted = set(places)
    return {
        path
        for by_path in sides.enclaves
        for path, enclave in by_path.items()
        if enclave.permissions is not None and enclave.permissions.signed.file.place in wanted
    }
