"""What the enclaves' own permissions give, before and after: first match, default, domains and partitions.

Peers take whatever document is presented to them. An enclave can keep and present an old document (measured on Fast DDS
2.9.1 and Cyclone DDS 0.10.2). With an old identity it is let in as before. So what is lost is asked of NEW's peers
again, with those files added.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.comparison.change import Direction, Layer, direction_of
from keystore_audit.model.comparison.facts import Dates, Draft, dated, folded, placed
from keystore_audit.model.comparison.sides import Pair, Sides, View
from keystore_audit.model.formal.bit_sets import bits, lowest, members, union
from keystore_audit.model.formal.steps import Step, compare
from keystore_audit.model.formal.system import GrantAtom, RuleAtom
from keystore_audit.text import instant

JOIN: Final = "join"
LATER: Final = "later-rights"
WORDS: Final = {"publish": "publish", "subscribe": "subscribe to", "relay": "relay", JOIN: "join"}
"""Operations as verbs of what follows."""

PRESENTED_BEFORE: Final = ", unless somebody presents an older signed document,"
"""Added to what others can no longer do, or where data can no longer get, where peers of NEW accept such documents."""

_LATER_WORDS: Final = {
    Direction.GAINED: "may do more, once a further grant takes effect, on",
    Direction.LOST: "may do less, once a further grant takes effect, on",
    Direction.MIXED: "may do other things, once a further grant takes effect, on",
    Direction.CHANGED: "has other grants that are not in effect yet, with the same rights",
}


class Right(NamedTuple):
    """An operation that somebody gained (or lost)."""

    operation: str
    gained: bool

    @property
    def direction(self) -> Direction:
        """Gained or lost."""
        return Direction.GAINED if self.gained else Direction.LOST


class Given(NamedTuple):
    """What a grant gives: channels by operation, and domains that it lets its holder join."""

    publish: int = 0
    subscribe: int = 0
    relay: int = 0
    joined: int = 0

    @property
    def rights(self) -> Rights:
        """The same as steps."""
        return tuple([Step(channels, True, None), _ELSE] for channels in self)

    def channels(self, view: View, operation: str) -> int:
        """The channels on which the operation is given; for joining, all names of the domains."""
        if operation == JOIN:
            return view.decisions.within(members(self.joined))
        return int(getattr(self, operation))


Rights = tuple[list[Step[RuleAtom | None]], ...]
"""What is decided, operation by operation in the order of `WORDS`: about channels, and to join about domains."""

_ELSE: Final[Step[RuleAtom | None]] = Step(-1, False, None)
NOTHING: Final = Given()


def either(several: Collection[Given]) -> Given:
    """What all of them give together."""
    return Given(*map(union, zip(*several, strict=True))) if several else NOTHING


def given(view: View, grant: int | None) -> Given:
    """What the grant gives its holder; None: nothing."""
    if grant is None:
        return NOTHING
    publish, subscribe, relay = (view.decisions.allowed(grant, operation) for operation in Operation)
    return Given(publish, subscribe, relay, view.decisions.joins(grant))


def right_drafts(
    sides: Sides, pair: Pair, path: str, right: Right, channels: int, *, layer: Layer, kind: str, verb: str = ""
) -> Iterator[Draft]:
    """The right that the enclave gained or lost there. Apart from it: what it may still do, and until when."""
    parts = [] if right.gained else [*_still(sides, pair, path, right.operation, channels)]
    return changed_right(pair, right, channels, parts, layer=layer, kind=kind, verb=verb, enclaves=(path,))


def changed_right(
    pair: Pair,
    right: Right,
    channels: int,
    kept: Collection[tuple[int, str]],
    *,
    layer: Layer,
    kind: str,
    verb: str = "",
    who: str = "",
    enclaves: tuple[str, ...] = (),
) -> Iterator[Draft]:
    """The right that was gained or lost there. `kept`: channels on which it is still effective, and until when."""
    still, until = union(part for part, _end in kept), max((end for _part, end in kept), default=None)
    for part, end in ((channels & still, until), (channels & ~still, None)):
        if part:
            yield Draft(
                layer=layer,
                kind=kind,
                direction=right.direction,
                what=f"{who}{may(f'{verb}{WORDS[right.operation]}', end, gained=right.gained)}",
                enclaves=enclaves,
                profiles=pair.profiles,
                operation=right.operation,
                until=end,
                channels=part,
            )


def _still(sides: Sides, pair: Pair, path: str, operation: str, channels: int) -> Iterator[tuple[int, str]]:
    """What each grant that is not over, begun or not, still gives a participant of that name, and until when."""
    view, enclave = pair.kept, sides.enclaves[0].get(path)
    system, number = view.system, view.numbers.get(path)
    identities: set[int] = set()
    if enclave is not None and enclave.identity is not None:
        identities.update(view.named.get(enclave.identity.subject, ()))
    if number in view.let_in and (own := system.enclaves[number].identity) is not None:
        identities.add(own)
    for identity in identities:
        for grant in view.lasting.get(identity, ()):
            rights = given(view, grant).channels(view, operation)
            part = channels & (rights if operation == JOIN else view.decisions.met(rights))
            if part:
                end = min(system.grants[grant].not_after, system.certificates[identity].not_after)
                yield part, instant(system.instants[end])


def may(verb: str, until: str | None, *, gained: bool) -> str:
    """What somebody may do, as a verb phrase. It never says that a right is gone while it is still effective."""
    if gained:
        return f"may {verb}"
    return f"may no longer {verb}" if until is None else f"may still, until {until}, {verb}"


def grant_changes(sides: Sides) -> Iterator[Draft]:
    """One draft for each operation and direction, of all enclaves for which the same names changed."""
    return folded(_rights(sides), sides)


def _rights(sides: Sides) -> Iterator[Draft]:
    for pair in sides.pairs:
        for path in sides.compared:
            if sides.refused(pair, path, "permissions"):
                continue  # whether it starts says so
            grants = [(view, view.own_grant(path)) for view in (pair.old, pair.new)]
            if given(*grants[0]) == given(*grants[1]):  # of most of 10,000 enclaves
                continue
            for change in compared(sides, pair, *(_decided(view, grant) for view, grant in grants)):
                right, channels, by = change.right, change.channels, (change.old, change.new)
                places = [
                    None if grant is None else _written(view, grant, right.operation, rule, channels)
                    for (view, grant), rule in zip(grants, by, strict=True)
                ]
                drafts = right_drafts(sides, pair, path, right, channels, layer=Layer.GRANTS, kind="right")
                yield from placed(drafts, places, path)


def _decided(view: View, grant: int | None) -> Rights:
    """What the rules of the grant decide; None: nothing is given."""
    if grant is None:
        return NOTHING.rights
    joined: list[Step[RuleAtom | None]] = [Step(view.decisions.joins(grant), True, None), _ELSE]
    return *(view.decisions.steps(grant, operation) for operation in Operation), joined


class Changed(NamedTuple):
    """A right that came or went on these channels. `old`, `new`: the rules that decide about the first of them."""

    right: Right
    channels: int
    old: RuleAtom | None
    new: RuleAtom | None


def compared(sides: Sides, pair: Pair, old: Rights, new: Rights) -> Iterator[Changed]:
    """Operations with the channels on which they were gained, or lost; joining only if the others do not imply it."""
    touched = {True: 0, False: 0}
    for operation, before, after in zip(WORDS, old, new, strict=True):
        joining = operation == JOIN
        found = list(compare(before, after, pair.old.decisions.all_domains if joining else sides.mask))
        for gained in (True, False):
            turned = [each for each in found if each.right.allow is gained]
            channels = union(each.channels for each in turned)
            if joining:
                within = (pair.old.decisions.channels_in[domain] & sides.mask for domain in members(channels))
                channels = union(each for each in within if not each & touched[gained])  # else it goes without saying
            touched[gained] |= channels
            if channels:
                first = min(turned, key=lambda each: lowest(each.channels))
                yield Changed(Right(operation, gained), channels, first.left.by, first.right.by)


def differing(sides: Sides, pair: Pair, old: Given, new: Given) -> Iterator[tuple[Right, int]]:
    """The same for everything that grants give, without rules."""
    if old != new:
        yield from ((each.right, each.channels) for each in compared(sides, pair, old.rights, new.rights))


def both_ways(sides: Sides, before: int, after: int) -> Iterator[tuple[bool, int]]:
    """The channels that were gained, and those that were lost, each with whether they were gained, if there are any."""
    old, new = (Given(each).rights[0] for each in (before, after))
    for difference in sorted(compare(old, new, sides.mask), key=lambda each: each.left.allow):
        yield difference.right.allow, difference.channels


def validity_changes(sides: Sides, rights: list[Draft]) -> Iterator[Draft]:
    """The dates of the grants that count, or would: one draft for all enclaves whose dates changed alike.

    Not where the new dates take all rights away, or give them: `rights` has that.
    """
    told = {path for draft in rights for path in draft.enclaves}
    return folded(_validities(sides, told), sides)


def _validities(sides: Sides, told: set[str]) -> Iterator[Draft]:
    pair = sides.pairs[0]
    for path in sides.compared:
        flips = (pair.old.own_grant(path) is None) != (pair.new.own_grant(path) is None)
        one, other = _naming(pair.old, path), _naming(pair.new, path)
        if one is not None and other is not None and not (flips and path in told):
            dates = dates_of(pair.old, one), dates_of(pair.new, other)
            yield from placed(dated("grant-validity", "its grant", *dates), (one.location, other.location), path)


def dates_of(view: View, grant: GrantAtom) -> Dates:
    """When it begins and ends."""
    return view.system.instants[grant.not_before], view.system.instants[grant.not_after]


def _naming(view: View, path: str) -> GrantAtom | None:
    """The grant of the enclave's own document that counts, or, where none is in force, the first that names it."""
    own = view.own_grant(path)
    if own is not None:
        return view.system.grants[own]
    enclave = view.enclave(path)
    for grant in view.system.grants:
        if grant.document in enclave.permissions and enclave.identity in grant.names:
            return grant
    return None


def deciding(view: View, grant: int | None, operation: str, channels: int) -> Location | None:
    """The rule of the grant that decides about the first of the channels; where none does, and to join, the grant."""
    if grant is None:
        return None
    joining = operation == JOIN
    rule = None if joining else view.decisions.decider(grant, Operation(operation), lowest(channels))
    return _written(view, grant, operation, rule, channels)


def _written(view: View, grant: int, operation: str, rule: RuleAtom | None, channels: int) -> Location:
    """Where the rule has the expression that takes in the first of the channels; without a rule, the grant."""
    if rule is None:
        return view.system.grants[grant].location
    return view.system.place(rule, Operation(operation), lowest(channels))


def later_changes(sides: Sides, told: frozenset[str]) -> Iterator[Draft]:
    """Rights that begin later: of grants whose dates have not begun. Where grants out of date are passed over, also of
    those after a grant that ends. One draft for all enclaves where they changed alike.

    It is a gain where such a grant gives what none did before, now or later: what begins tomorrow is signed today.
    `told`: enclaves of which it is said that their grant has other dates.
    """
    found: dict[tuple[object, ...], Draft] = {}
    for draft in (draft for pair in sides.pairs for draft in _later(sides, pair, told)):
        key = draft.enclaves, draft.direction
        known = found.get(key)
        if known is not None:
            both = known.profiles + draft.profiles
            found[key] = replace(known, profiles=both, channels=known.channels | draft.channels)
        else:
            found[key] = draft
    return folded(found.values(), sides)


def _later(sides: Sides, pair: Pair, told: frozenset[str]) -> Iterator[Draft]:
    views = pair.old, pair.new
    begin = [_begin_later(view) for view in views]
    for path in sides.compared if any(begin) else ():  # nearly never
        if sides.refused(pair, path, "permissions"):
            continue
        one, other = (_beginning(sides, view, later, path) for view, later in zip(views, begin, strict=True))
        if one.keys() == other.keys():
            continue
        soon = [either([gives for _dates, gives in grants]) for grants in (one, other)]
        ever = [either((each, given(view, view.own_grant(path)))) for each, view in zip(soon, views, strict=True)]
        gained, lost = (
            union(channels for _right, channels in differing(sides, pair, had, either((had, gives))))
            for had, gives in ((ever[0], soon[1]), (ever[1], soon[0]))
        )
        direction = direction_of(gained, lost)
        if direction is not Direction.CHANGED or path not in told:
            yield Draft(
                layer=Layer.TRUST,
                kind=LATER,
                direction=direction,
                what=_LATER_WORDS[direction],
                enclaves=(path,),
                profiles=pair.profiles,
                channels=gained | lost,
                old=next(iter(one.values()), None),
                new=next(iter(other.values()), None),
            )


def _begin_later(view: View) -> list[int]:
    system = view.system
    ends: dict[tuple[int, int], int] = {}  # by document and certificate: when the first of its grants has ended
    found = []
    for number, grant in enumerate(system.grants):
        named = [(grant.document, certificate) for certificate in grant.names]
        earlier = [ends.get(each, grant.not_after) for each in named]
        comes_up = system.reading_of(grant).skips_grants_out_of_date and any(end < grant.not_after for end in earlier)
        if grant.not_before > system.now or (comes_up and grant.not_after > system.now):
            found.append(number)
        ends.update((each, min(end, grant.not_after)) for each, end in zip(named, earlier, strict=True))
    return found


def _beginning(sides: Sides, view: View, later: list[int], path: str) -> dict[tuple[Dates, Given], Location]:
    """What the enclave's own grants among these give, when, and where it is written."""
    enclave = view.enclave(path)
    domains = bits(number for number, channels in enumerate(view.decisions.channels_in) if channels & sides.mask)
    counting = Given(sides.mask, sides.mask, sides.mask, domains)
    found: dict[tuple[Dates, Given], Location] = {}
    for number in later:
        grant = view.system.grants[number]
        theirs = grant.document in enclave.permissions or grant.document in view.taken
        if theirs and enclave.identity in grant.names and grant.not_before <= grant.not_after:
            gives = Given(*(mine & counts for mine, counts in zip(given(view, number), counting, strict=True)))
            if any(gives):
                found.setdefault((dates_of(view, grant), gives), grant.location)
    return found
