"""The rules of grants as steps over channels: the first step that is about a channel decides.

One evaluation (`allowing`, `deciding`) and one comparison (`compare`) for everybody who asks what ordered rules say.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Generic, NamedTuple, TypeVar

from msgspec import Struct

from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.channels import Channels
from keystore_audit.model.domains import Interval
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.permission import allowing
from keystore_audit.model.semantics import ReadGrant, ReadRule, Region
from keystore_audit.profiles import Matcher

By = TypeVar("By")


class Step(Struct, Generic[By], frozen=True):
    """Decides about `channels` (a bit set), unless an earlier step did. `by`: what says so."""

    channels: int
    allow: bool
    by: By


class Difference(NamedTuple, Generic[By]):
    """Channels that two lists decide differently about, and the step of each that does."""

    channels: int
    left: Step[By]
    right: Step[By]


def allowed(steps: Iterable[Step[By]]) -> int:
    """The channels that the steps allow."""
    return allowing((step.channels, step.allow) for step in steps)


def deciding(steps: Iterable[Step[By]], channel: int) -> Step[By]:
    """The step that decides about a channel; of lists that end with one about all of them."""
    return next(step for step in steps if step.channels >> channel & 1)


def compare(left: Iterable[Step[By]], right: Sequence[Step[By]], channels: int) -> Iterator[Difference[By]]:
    """Of the channels, those that the lists decide differently about, by the two steps that do."""
    theirs, undecided = [], channels
    for step in right:
        theirs.append(step.channels & undecided)
        undecided &= ~step.channels
    undecided, first = channels, 0
    for one in left:
        mine = one.channels & undecided
        undecided &= ~mine
        while first < len(theirs) and not theirs[first]:  # both mostly decide in one order, of thousands
            first += 1
        for number in range(first, len(theirs) if mine else 0):
            both = mine & theirs[number]
            if both:
                mine &= ~both
                theirs[number] &= ~both
                if one.allow is not right[number].allow:
                    yield Difference(both, one, right[number])
                if not mine:
                    break


class RuleLists:
    """Makes the steps of grants over some channels (`all`); what expressions and domains come to is worked out once."""

    def __init__(self, channels: Channels) -> None:
        self.all = (1 << len(channels.channels)) - 1
        self._channels = channels
        self._regions: dict[tuple[Matcher, Region], int] = {}
        self._covers: dict[tuple[Interval, ...], int] = {}

    def of(
        self,
        grant: ReadGrant,
        operation: Operation,
        matcher: Matcher,
        *,
        of_peers: bool = False,
        in_every_domain: bool = False,
    ) -> Iterator[Step[ReadRule | None]]:
        """What the grant decides about the operation, in order; last (`by` None) the default, about everything.

        `of_peers`: rules that decide about peers alone are among them. `in_every_domain`: rules apply outside of the
        domains that they name as well.
        """
        for rule in grant.rules:
            if of_peers or not rule.of_peers:
                channels = self.region(matcher, rule.region(operation))
                if not in_every_domain:
                    channels &= self.domains(rule.domains)
                if channels:
                    yield Step(channels, rule.allow, rule)
        yield Step(self.all, grant.default_allow, None)

    def region(self, matcher: Matcher, region: Region) -> int:
        """The channels of a region that took part when the channels were made."""
        if not region:
            return 0
        known = self._regions.get((matcher, region))
        if known is None:
            known = self._regions[matcher, region] = bits(self._channels.regions[matcher, region])
        return known

    def domains(self, cover: tuple[Interval, ...]) -> int:
        """The channels of the domains."""
        known = self._covers.get(cover)
        if known is None:
            known = self._covers[cover] = self._channels.within(cover)
        return known
