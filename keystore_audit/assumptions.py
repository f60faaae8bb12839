"""What a verdict takes for granted: facts about the world, or about what no keystore can change (docs/assumptions.md).

What these files could avoid is never an assumption: a weakness that they can remove makes a verdict violated.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import Final

from msgspec import Struct


class Assumption(str, Enum):
    """A named fact. The value is its name; in Alloy it is called the same, without the dashes."""

    ROBOTS_ENFORCE = "robots-enforce"
    AUTHORITIES_AS_FOUND = "authorities-as-found"
    NOTHING_ELSE_CERTIFIED = "nothing-else-certified"
    NO_OTHER_DOCUMENTS = "no-other-documents"
    NOTHING_IN_UNREAD_FILES = "nothing-in-unread-files"
    TRUTHFUL_ANNOUNCEMENTS = "truthful-announcements"
    SESSIONS_END_WITH_GRANTS = "sessions-end-with-grants"
    LOCKSTEP_ROUNDS = "lockstep-rounds"

    @property
    def atom(self) -> str:
        """Its name in Alloy."""
        return "".join(word.capitalize() for word in self.value.split("-"))

    @property
    def short(self) -> str:
        """What stands behind "holds if"."""
        return _WORDS[self][0]

    @property
    def statement(self) -> str:
        """What is taken for granted: one sentence."""
        return _WORDS[self][1]


EVERY: Final = frozenset(Assumption)

WORLD: Final = EVERY - {Assumption.TRUTHFUL_ANNOUNCEMENTS}
"""What nobody sees in the files, so that without it an answer is unknown. What an attacker can do anyhow is not among
these: without that assumption a property is violated."""

IDENTITIES: Final = frozenset(
    {
        Assumption.AUTHORITIES_AS_FOUND,
        Assumption.NOTHING_ELSE_CERTIFIED,
        Assumption.NOTHING_IN_UNREAD_FILES,
    }
)
"""Without one of these an enclave may hold any identity, and sign what it likes."""

DOCUMENTS: Final = frozenset({Assumption.NO_OTHER_DOCUMENTS, Assumption.NOTHING_IN_UNREAD_FILES})
"""Without one of these there may be a document that grants anything."""

CONDITIONS: Final = (Assumption.TRUTHFUL_ANNOUNCEMENTS, Assumption.NOTHING_ELSE_CERTIFIED)
"""That every format says beside a verdict: who keeps or breaks them is not whoever runs the robots."""

_WORDS: Final = {
    Assumption.ROBOTS_ENFORCE: (
        "robots enforce security",
        (
            "Every robot runs with ROS_SECURITY_ENABLE=true and ROS_SECURITY_STRATEGY=Enforce: with Permissive, an "
            "enclave that fails to load starts unsecured."
        ),
    ),
    Assumption.AUTHORITIES_AS_FOUND: (
        "the authorities are those found here",
        "The authorities whose certificates lie in the CA files are the ones to trust: nobody declared them.",
    ),
    Assumption.NOTHING_ELSE_CERTIFIED: (
        "authorities issued no other certificates",
        (
            "The keys of both authorities, and of all CAs that they issued, certified nothing but the certificates "
            "found here."
        ),
    ),
    Assumption.NO_OTHER_DOCUMENTS: (
        "no other signed documents exist",
        "All signed documents that peers accept are among those found here.",
    ),
    Assumption.NOTHING_IN_UNREAD_FILES: (
        "unread files hold no keys, certificates or documents",
        "The files that were not read hold no keys, certificates or documents.",
    ),
    Assumption.TRUTHFUL_ANNOUNCEMENTS: (
        "peers announce endpoints truthfully",
        "Whoever joins a domain announces truthfully which of its endpoints are under access control.",
    ),
    Assumption.SESSIONS_END_WITH_GRANTS: (
        "sessions end with grants",
        "A running session ends when its grant ends.",
    ),
    Assumption.LOCKSTEP_ROUNDS: (
        "nodes run in lockstep rounds",
        "Time passes in rounds, alike for all nodes whose behaviour is declared.",
    ),
}


class Declaration(Struct, frozen=True, kw_only=True):
    """Who answers for it, and why: settings say so."""

    owner: str
    reason: str


class Needed(Struct, frozen=True, kw_only=True):
    """An assumption of an answer. `needed_by`: ids of the properties that hold under it alone. `unchecked`: names of
    the implementations that do not see to it, where others do. `declared`: None where it is made by default.
    """

    assumption: Assumption
    needed_by: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()
    declared: Declaration | None = None

    @property
    def condition(self) -> str:
        """What stands behind "holds if"."""
        if not self.unchecked:
            return self.assumption.short
        do = "does" if len(self.unchecked) == 1 else "do"
        return f"{self.assumption.short} ({', '.join(self.unchecked)} {do} not check)"

    @property
    def sentence(self) -> str:
        """What is taken for granted, in full."""
        told = f" Not checked by {', '.join(self.unchecked)}." if self.unchecked else ""
        said = f" ({self.declared.owner}: {self.declared.reason})" if self.declared else ""
        return f"{self.assumption.statement}{told}{said}"

    @property
    def described(self) -> dict[str, object]:
        """The same by the keys of reports."""
        by = {"owner": self.declared.owner, "reason": self.declared.reason} if self.declared else {}
        source = "settings" if self.declared else "default"
        return {
            "name": self.assumption.value,
            "statement": self.assumption.statement,
            "needed_by": list(self.needed_by),
            "source": source,
            **by,
        }


def holds_if(needed: Iterable[Needed]) -> str:
    """The line that says what an answer rests on; empty where it rests on nothing."""
    found = "; ".join(each.condition for each in needed)
    return f"HOLDS IF {found}" if found else ""
