"""Whose keys open most, in a report for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from keystore_audit.report.page import Page
from keystore_audit.text import counted

if TYPE_CHECKING:
    from keystore_audit.model.blast_radius import Ranked, Ranking

MAX_RANKED: Final = 5
"""Enclaves that are listed; `flow --from-compromised` tells all of one."""


def put(page: Page, rankings: Sequence[Ranking]) -> None:
    """Add the section: the first of the ranking under most profiles, and of each other one the first alone."""
    page.blank()
    page.put(("Blast radius, what the private key of an enclave opens", "bold"))
    if not rankings:
        page.put("Not worked out here: too many enclaves. The HTML report ranks up to 2,000 of them.", indent=2)
    for place, ranking in enumerate(rankings):
        under = f"Under {', '.join(ranking.profiles)}" if len(rankings) > 1 else "Under every profile"
        page.put(f"{under}:", indent=2)
        listed = ranking.enclaves[: 1 if place else MAX_RANKED]
        for one in listed:
            page.put(_words(one), indent=4)
        more = len(ranking.enclaves) - len(listed)
        if more:
            page.put(f"and {more} more with no larger one", indent=4)


def _words(one: Ranked) -> str:
    endless = ", names without end among them" if one.endless else ""
    alone = f" ({one.enclaves_reached_alone} while the others stay honest)"
    more = one.enclaves_reached > one.enclaves_reached_alone
    reached = f"reaches {counted(one.enclaves_reached, 'enclave')}{alone if more else ''}"
    posed = f", passes for {one.passes_for}" if one.passes_for else ""
    topics = f"writes {one.topics_written}, forges {one.topics_forged}, reads {one.topics_read} DDS topics{endless}"
    return f"{one.path}: {reached}{posed}; {topics}"
