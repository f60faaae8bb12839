"""Differences between both sides as facts, noted one by one and told together, and what follows from them.

A comparison yields a draft for each enclave and each pair of profiles; `folded` makes changes of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Final, TypeVar

from msgspec import field
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.model.comparison.change import (
    ORDER,
    Aspect,
    Change,
    Consequence,
    Direction,
    Layer,
    direction_of,
    joint_direction,
)
from keystore_audit.model.comparison.sides import Sides
from keystore_audit.model.formal.bit_sets import union
from keystore_audit.text import instant

ADDED: Final = "enclave-added"
AUTHORITY: Final = "authority"
REMOVED: Final = "enclave-removed"
SUBJECT: Final = "identity-subject"
FILE: Final = "file"
_EVERYBODY: Final = frozenset(
    {ADDED, REMOVED, SUBJECT, FILE, "identity-key", "identity-issuer", "identity-authority", AUTHORITY, "signer"}
    | {"signature", "revocation"}
)
"""Kinds of changes that bear on what peers accept from any enclave."""

_LAYERS: Final = list(Layer)
MAX_APART: Final = 4
"""Sets of names, each of other enclaves, that stand apart among the consequences of one change."""

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


class Draft(Change, frozen=True, kw_only=True, eq=False):
    """A change while it is worked out: `channels` in place of names; no profiles: all that were asked for.

    `touched`: further enclaves that it bears on; `whole`: it may bear on any, as a change of the keystore does.
    `cause`: what accounts for it. `follows`: those that it accounts for itself; `parts`: as of `Consequence`.
    """

    channels: int = 0
    touched: tuple[str, ...] = ()
    whole: bool = False
    parts: bool = False
    cause: Draft | None = None
    follows: list[Draft] = field(default_factory=list)

    def change(self, sides: Sides, labels: tuple[str, ...]) -> Change:
        """The change with its names and consequences; parts that say the same of other names are one."""
        effects: dict[Consequence, int] = {}
        for shown in self.follows:
            effect = Consequence(**{name: getattr(shown, name) for name in Consequence.__struct_fields__})
            effects[effect] = effects.get(effect, 0) | shown.channels
        told = {
            "profiles": self.profiles or sides.every,
            "names": sides.names(self.channels),
            "until": max(filter(None, (each.until for each in (self, *self.follows))), default=None),
            "consequences": tuple(
                replace(effect, names=sides.names(channels))
                for effect, channels in sorted(effects.items(), key=lambda each: ORDER.index(each[0].direction))
            ),
            "labels": labels,
        }
        return Change(**{name: getattr(self, name) for name in Change.__struct_fields__} | told)


_APART: Final = frozenset(Draft.__struct_fields__) - {
    "enclaves",
    "profiles",
    "channels",
    "varies",
    "old",
    "new",
    "follows",
}


def folded(drafts: Iterable[Draft], sides: Sides, *, complete: bool = False) -> Iterator[Draft]:
    """Drafts that say the same of several enclaves as one, also dates that moved the same way; in the first place.

    `complete`: each has all its profiles; else what it says under each of them is noted one by one.
    """
    noted: dict[tuple[object, ...], tuple[dict[str, int], list[Draft]]] = {}
    for draft in drafts:
        dates = draft.kind.endswith("-validity")
        said = (getattr(draft, name) for name in _APART if not dates or name != "aspects")
        key = draft.enclaves, draft.profiles if complete else None, *said
        by_profile, several = noted.setdefault(key, ({}, []))
        several.append(draft)
        for profile in draft.profiles or sides.every:
            by_profile[profile] = by_profile.get(profile, 0) | draft.channels
    alike = gathered(
        ((key[1:], *sorted(by_profile.items())), (by_profile, several)) for key, (by_profile, several) in noted.items()
    )
    for noted_alike in alike.values():
        by_profile = noted_alike[0][0]
        several = [draft for _by_profile, each in noted_alike for draft in each]
        placed = next((draft for draft in several if draft.old or draft.new), several[0])
        yield replace(
            placed,
            enclaves=tuple(dict.fromkeys(path for draft in several for path in draft.enclaves)),
            profiles=sides.in_order(by_profile),
            channels=union(by_profile.values()),
            varies=len(set(by_profile.values())) > 1,
            aspects=_spanned([draft.aspects for draft in several]),
        )


def accounted(drafts: Iterable[Draft], sides: Sides) -> list[Draft]:
    """The differences, folded: given to the changes that account for them. Returned are those without any."""
    found = list(folded(drafts, sides))
    effects = gathered(
        ((each.cause, each.kind, each.what, each.operation, each.reasons, each.influenced, each.profiles), each)
        for each in found
        if each.cause is not None
    )
    for several in effects.values():
        apart = several
        if len(several) > MAX_APART:
            enclaves = tuple(path for each in several for path in each.enclaves)
            channels = union(each.channels for each in several)
            apart = [replace(several[0], enclaves=enclaves, channels=channels, parts=True)]
        for each in apart:
            if each.cause is not None:
                each.cause.follows.append(each)
    return [each for each in found if each.cause is None]


def shares(candidates: Iterable[tuple[Draft, int]], left: int) -> Iterator[tuple[Draft | None, int]]:
    """What of a set each change accounts for, the nearest first; and (None) the rest."""
    for draft, part in candidates if left else ():
        if part & left:
            yield draft, part & left
            left &= ~part
    if left:
        yield None, left


class Causes:
    """Changes and, by whether something is gained, those that may account for it; opposite ones come last.

    `rows`: of protection. `everybody`: those that bear on what peers accept from any enclave. `grants`: rights.
    """

    def __init__(self, drafts: list[Draft]) -> None:
        self.drafts = _without_rights_of_others(sorted(drafts, key=_either_way_round))
        self.rows = agreeing(draft for draft in self.drafts if draft.kind == "protection")
        self.everybody = agreeing(draft for draft in self.drafts if draft.kind in _EVERYBODY)
        self.grants = agreeing(draft for draft in self.drafts if draft.layer is Layer.GRANTS)
        self._of_enclave = gathered((path, draft) for draft in self.drafts for path in draft.enclaves)

    def of(self, path: str) -> list[Draft]:
        """The changes that are about an enclave."""
        return self._of_enclave.get(path, [])


def _without_rights_of_others(drafts: list[Draft]) -> list[Draft]:
    """Rights that an enclave has or lost since its identity is another's, or gone, follow from that."""
    causes = [draft for draft in drafts if draft.kind in (SUBJECT, FILE)]
    kept: list[Draft] = []
    for draft in drafts:
        follows = draft.kind in ("right", "grant-validity")
        cause = next((each for each in causes if set(draft.enclaves) <= set(each.enclaves)), None) if follows else None
        (kept if cause is None else cause.follows).append(draft)
    return kept


def _either_way_round(draft: Draft) -> tuple[int, str, tuple[str, ...], str, str, int]:
    """An order of changes that is the same for NEW and OLD as for OLD and NEW."""
    kind = ADDED if draft.kind == REMOVED else draft.kind
    aspects = " ".join(sorted(aspect.what for aspect in draft.aspects))
    return _LAYERS.index(draft.layer), kind, draft.enclaves, draft.operation or "", aspects, draft.channels


def agreeing(drafts: Iterable[Draft]) -> tuple[list[Draft], list[Draft]]:
    """In the order in which they account for a loss, and for a gain: opposite ones last."""
    several = list(drafts)
    loss, gain = (
        sorted(several, key=lambda draft: (draft.direction is other, draft.direction is Direction.INFO))
        for other in (Direction.GAINED, Direction.LOST)
    )
    return loss, gain


def order(draft: Draft) -> tuple[bool, int, int, str, tuple[str, ...], str]:
    """Other authorities first, since all rests on them; else by layer. Gains come first, unnoticeable changes last."""
    what = draft.what + "".join(f"{aspect.what} {aspect.old} {aspect.new}" for aspect in draft.aspects)
    other = draft.kind != AUTHORITY
    return other, _LAYERS.index(draft.layer), ORDER.index(draft.direction), draft.kind, draft.enclaves, what


def fact(kind: str, direction: Direction, what: str, *aspects: Aspect) -> Draft:
    """A change in what trust rests on."""
    return Draft(layer=Layer.TRUST, kind=kind, direction=direction, what=what, aspects=aspects)


def turned(kind: str, what: str, yes: str, no: str, before: object, after: object) -> Iterator[Draft]:
    """Something that is so on one side alone: more where it now is."""
    if bool(before) != bool(after):
        yield fact(kind, direction_of(after, before), f"{what} {yes if after else no}")


def placed(facts: Iterable[Draft], places: Iterable[Location | None], *enclaves: str) -> Iterator[Draft]:
    """The facts with where they are written in the old and in the new keystore, and about whom they are."""
    old, new = places
    return (replace(each, old=old, new=new, enclaves=enclaves) for each in facts)


def place_of(certificate: Certificate | None) -> Location | None:
    """Where it is written."""
    return None if certificate is None else Location(path=certificate.path, line=certificate.line)


def parted(old: Mapping[_Key, _Value], new: Mapping[_Key, _Value]) -> tuple[list[_Value], list[_Value], Direction]:
    """What went and what came, by their keys, and what became of it all."""
    gone, come = ([each for key, each in one.items() if key not in other] for one, other in ((old, new), (new, old)))
    return gone, come, direction_of(come, gone)


def listing(what: str, old: Iterable[str], new: Iterable[str], direction: Direction) -> Aspect:
    """What is on one side alone, each in order."""
    return Aspect(what, ", ".join(sorted(old)) or None, ", ".join(sorted(new)) or None, direction)


Dates = tuple[datetime | None, datetime | None]
"""Beginning and end, aware UTC; None: there is none."""


def dated(kind: str, what: str, old: Dates, new: Dates) -> Iterator[Draft]:
    """Other dates, as "begins later and ends later": more where something counts for longer than before."""
    words, aspects = [], []
    for verb, name, before, after in zip(("begins", "ends"), ("from", "until"), old, new, strict=True):
        if before != after:
            later = after is None or (before is not None and before < after)
            words.append(f"{verb} {'later' if later else 'earlier'}")
            direction = Direction.GAINED if later == (name == "until") else Direction.LOST
            aspects.append(Aspect(name, told(before), told(after), direction))
    if aspects:
        yield fact(kind, joint_direction(aspects), f"{what} {' and '.join(words)}", *aspects)


def _spanned(several: Sequence[tuple[Aspect, ...]]) -> tuple[Aspect, ...]:
    """One aspect for equally many of several changes: where values differ, the first and the last."""
    return tuple(
        Aspect(alike[0].what, _span(each.old for each in alike), _span(each.new for each in alike), alike[0].direction)
        for alike in zip(*several, strict=True)
    )


def _span(values: Iterable[str | None]) -> str | None:
    known = sorted({value for value in values if value is not None})
    return " to ".join(dict.fromkeys((known[0], known[-1]))) if known else None


def told(moment: datetime | None) -> str:
    """As reports write it."""
    return "never" if moment is None else instant(moment)
