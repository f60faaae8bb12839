"""Flows over time: what somebody got at one moment it may keep, and pass on at a later one (docs/model.md, Claims).

Each engine decides each moment by itself. This is worked out natively alone, and only where no moment violates a claim
that must hold until a date; so what is said of several moments is the native engine's answer alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.engine.counterexample_claims import UNDER, by_right, hop_ways, route, then_at
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.flow import Flows, Leg, Search, search_of
from keystore_audit.model.formal.permission import Decisions, Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import Answer, Counterexample, Hop, Status, Step

MAX_AT_HAND: Final = 16
"""Moments whose flows are kept for the next claim; those of a large fleet take some ten megabytes each."""


class Stage(NamedTuple):
    """The hops of a flow that are taken at one moment (as `Permissions` takes it)."""

    moment: int
    legs: tuple[Leg, ...]


class KeptFlows:
    """Flows of one system from the audit on, over moments in order."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._decisions = Decisions(system)
        self._at: dict[int, Flows] = {}

    def flow(self, claim: ClaimAtom) -> tuple[Stage, ...] | None:
        """A flow that the claim excludes, however many moments it takes until the claim's end; None: there is none."""
        if claim.kind is not ClaimKind.NO_FLOW or claim.until is None:
            return None
        search, kept = search_of(claim), list[frozenset[int]]()
        moments = self._moments(claim.until)
        keeping: frozenset[int] = frozenset()
        for moment in moments:
            kept.append(keeping)
            stages = self._stages(search, moments, kept)
            if stages is not None:
                return stages
            keeping = self._flows(moment).reached(replace(search, keeping=keeping))
        return None

    def looks_beyond(self, claim: ClaimAtom) -> bool:
        """Whether there are several moments until the claim's end, so that each by itself does not decide it."""
        return claim.until is not None and len(self._moments(claim.until)) > 1

    def takes_time(self, claim: ClaimAtom) -> bool:
        """Whether there is such a flow, and none as soon at one moment alone."""
        return len(self.flow(claim) or ()) > 1

    def _stages(
        self, search: Search, moments: Sequence[int], kept: Sequence[frozenset[int]]
    ) -> tuple[Stage, ...] | None:
        """A flow that ends at the last moment of which it is said who had `kept` what; at that one alone if it can."""
        moment = moments[len(kept) - 1]
        flows = self._flows(moment)
        alone = flows.shortest(search)
        if alone is not None:
            return (Stage(moment, alone),)
        legs = flows.shortest(replace(search, keeping=kept[-1])) if kept[-1] else None
        if legs is None:
            return None
        begun = legs[0].sender
        holder = Place(outsider=True) if begun is None else Place(enclaves=frozenset({begun}))
        [node] = flows.nodes(holder)
        first = next(place for place, keeping in enumerate(kept) if node in keeping)
        before = self._stages(replace(search, target=holder), moments, kept[:first])
        if before is None:
            raise AssertionError("what was kept came from nowhere")
        return (*before, Stage(moment, legs))

    def _moments(self, until: int) -> list[int]:
        """Those until an instant at which grants are in force, or people revoked, that were not just before."""
        found: list[int] = []
        before: object = None
        for moment in range(2 * self._system.now, max(2 * until, 2 * self._system.now) + 1):
            grants = self._system.grants
            counting = [2 * grant.not_before <= moment <= 2 * grant.not_after for grant in grants]
            now = counting, [trust_domain.at(moment).revoked for trust_domain in self._system.trust_domains]
            if now != before:
                found.append(moment)
            before = now
        return found

    def _flows(self, moment: int) -> Flows:
        if moment in self._at:
            return self._at[moment]
        flows = Flows(
            self._system, trust_domain_views(self._system, Permissions(self._system, moment, self._decisions))
        )
        if len(self._at) < MAX_AT_HAND:
            self._at[moment] = flows
        return flows


def kept_status(flows: Mapping[int, tuple[Stage, ...] | None]) -> Status:
    """Of a claim that holds at each moment, by the systems that read the keystore: in all, in none or in some."""
    found = {flow is not None for flow in flows.values()}
    return Status.UNKNOWN if len(found) > 1 else Status.VIOLATED if True in found else Status.HOLDS


def describe_kept(system: System, claim: ClaimAtom, stages: Sequence[Stage]) -> Counterexample:
    """The flow in the user's names, moment by moment."""
    told: list[str] = []
    steps: list[Step] = []
    attacked = False
    for number, stage in enumerate(stages):
        source = claim.source if number == 0 else Place()
        target = claim.target if number == len(stages) - 1 else Place()
        part = replace(claim, source=source, target=target)
        path = tuple(Hop(sender=s, channel=c, receiver=r, instant=stage.moment // 2) for s, c, r in stage.legs)
        when, then = then_at(system, Answer(status=Status.VIOLATED, moment=stage.moment))
        told.append(route(then, part, path) + (when or " now"))
        attacked |= not by_right(then, part, path)
        steps += [step for hop in path for _why, shown in hop_ways(then, part, hop) for step in shown]
    under = UNDER[claim.attacker if attacked else Attacker.HONEST]
    text = f"{'; then, of what was kept, '.join(told)} ({under})."
    return Counterexample(text=text, steps=tuple(dict.fromkeys(steps)))
