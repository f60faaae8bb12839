"""How a rule is declared: its identity, clause and remedy stand next to the function that judges."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import cleandoc
from types import FunctionType
from typing import Any, Final, Generic, TypeVar, cast

from msgspec import Struct

from keystore_audit.findings import Location, Severity
from keystore_audit.remedy import Remedy
from keystore_audit.rules.context import Context

S = TypeVar("S")


class Violation(Struct, frozen=True, kw_only=True):
    """What a rule found wrong with its subject.

    `locations`: all, the primary place first. `severity`: where it depends on profile or option, else the rule's.
    `profiles`: canonical variants that it holds for (empty: all). `undecided`: something stays unknown because of it,
    so the audit is incomplete. `key`: what makes it beside what stands at its places, unabridged: with both it is
    accepted by its fingerprint. It holds no line numbers, which reformatting changes. `contents`: whether what stands
    at the places is part of what makes it (of a property that no finding explains: what all files say); where not,
    `key` holds all of it. `against`: places that the finding does not list, whose contents make it as well: the grants
    of its own that an enclave gets more than, say. `explains`: the properties that this one is a cause of, where they
    are not the rule's (None: the rule's). `shared`: it is said of each of several subjects in the same words, and is
    one finding for all of them. `properties`: of a rule about any property, the ids of those that it is about.
    """

    message: str
    locations: tuple[Location, ...]
    enclave: str | None = None
    severity: Severity | None = None
    profiles: tuple[str, ...] = ()
    undecided: bool = False
    key: str = ""
    contents: bool = True
    against: tuple[Location, ...] = ()
    remedy: Remedy | None = None
    explains: frozenset[str] | None = None
    shared: bool = False
    properties: tuple[str, ...] = ()


class Rule(Struct, Generic[S], frozen=True, kw_only=True):
    """A registered rule. `explains`: ids of properties whose violation this rule's findings are a cause of.

    `stops`: what it finds may be why an enclave does not start.
    """

    code: str
    name: str
    severity: Severity
    on: type[S]
    clause: str
    remedy: Remedy
    docstring: str
    explains: frozenset[str] = frozenset()
    stops: bool = False
    check: Callable[[S, Context], Iterator[Violation]]
    applies: Callable[[S, Context], bool] | None = None
    """Whether the subject has what the rule is about; None: it always has."""

    @property
    def description(self) -> str:
        """Why it matters, the clause, and what the check cannot know."""
        return cleandoc(self.docstring)

    @property
    def family(self) -> str:
        """`KA1` … `KA9`."""
        return self.code[:3]


REGISTERED: Final[dict[str, Rule[Any]]] = {}
"""Every rule whose module was imported, by code and by name."""


def rule(
    code: str,
    severity: Severity,
    *,
    clause: str,
    remedy: Remedy,
    explains: tuple[str, ...] = (),
    stops: bool = False,
    applies: Callable[[Any, Context], bool] | None = None,
) -> Callable[[Callable[[S, Context], Iterator[Violation]]], Rule[S]]:
    """Registers a rule, which is called as its function is and is about what that takes first.

    Raises ValueError at import for a code or name that is taken, or a function without a docstring.
    """

    def judged_by(check: Callable[[S, Context], Iterator[Violation]]) -> Rule[S]:
        function = cast(FunctionType, check)
        subject = next(iter(function.__annotations__.values()))
        made: Rule[S] = Rule(
            code=code,
            name=function.__name__.replace("_", "-"),
            severity=severity,
            on=function.__globals__[subject],
            clause=clause,
            remedy=remedy,
            docstring=check.__doc__ or "",
            explains=frozenset(explains),
            stops=stops,
            check=check,
            applies=applies,
        )
        register(made)
        return made

    return judged_by


def register(made: Rule[Any]) -> None:
    """Raises ValueError for a code or name that is taken, or a rule that does not say why."""
    if made.code in REGISTERED or made.name in REGISTERED:
        raise ValueError(f"rule {made.code} {made.name} is registered twice")
    if not made.docstring:
        raise ValueError(f"rule {made.code} {made.name} has no docstring")
    REGISTERED[made.code] = REGISTERED[made.name] = made
