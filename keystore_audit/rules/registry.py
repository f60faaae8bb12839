"""How a rule is declared, and what it may look at: identity, clause and remedy stand next to the function."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from functools import wraps
from inspect import cleandoc
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar, cast

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.findings import OF_THE_AUDIT, Location, Severity
from keystore_audit.intent.environment import Environment
from keystore_audit.keystore.identity import Beside
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.meaning import Meaning
from keystore_audit.model.trust.chain import Authorities
from keystore_audit.profiles import Profile
from keystore_audit.properties.result import EngineRun, PropertyResult
from keystore_audit.remedy import Remedy
from keystore_audit.settings.suppressions import Acceptance
from keystore_audit.text import meant
from keystore_audit.truth import Truth

if TYPE_CHECKING:  # an audit without a policy, a graph or a launch file needs none of it
    from keystore_audit.model.intended.drift import Drift
    from keystore_audit.model.intended.observed import Observation


class Context(Struct, frozen=True, kw_only=True):
    """The evidence, its meaning, the engines' answers and the options of this audit.

    `at` is the audit instant (aware UTC), `expires_within` the notice for coming expiry, `deployed` whether
    the tree goes on a robot. `profiles` are the chosen ones; findings about signers are judged under every
    known variant (`model.profiles.VARIANTS`). `observed`: graphs and launch files compared with the keystore, None
    where none were named.
    """

    keystore: Keystore
    meaning: Meaning
    results: tuple[PropertyResult, ...]
    engines: tuple[EngineRun, ...]
    at: datetime
    expires_within: timedelta
    deployed: bool
    profiles: tuple[Profile, ...]
    beside: Beside | None = None
    """The other keystores of this run; None: there are none."""
    environment: Environment | None = None
    """What the robots' processes start with; None where no file says so."""
    drift: Drift | None = None
    """The keystore compared with the policy; None where none was named."""
    observed: Observation | None = None
    authorities: Authorities = Authorities()
    """Those that settings or options declare."""
    acceptances: tuple[Acceptance, ...] = ()
    """Findings that settings and a baseline accept, in the order in which they are looked for."""
    conditions: tuple[str, ...] = ()
    """Of which domain and zone the answers are, and under which assumptions."""

    def chose(self, profiles: Iterable[Profile]) -> bool:
        """Whether some of them are among the chosen ones."""
        return not {*self.profiles}.isdisjoint(profiles)

    def unless_all(self, names: Collection[str]) -> tuple[str, ...]:
        """Those of the chosen profiles with these names; none where it is all of them, as violations have it."""
        found = tuple(profile.name for profile in self.profiles if profile.name in names)
        return () if len(found) == len(self.profiles) else found

    def refused(self, enclaves: Iterable[Enclave], among: Collection[str] | None = None) -> bool:
        """Whether one of them does not start under a chosen profile (of these), whatever the reason."""
        chosen = [profile.name for profile in self.profiles if among is None or profile.name in among]
        known = (self.meaning.usability.get((each.files.directory, name)) for each in enclaves for name in chosen)
        return any(usability is not None and usability.usable is Truth.NO for usability in known)


S = TypeVar("S")


class Violation(Struct, frozen=True):
    """What a rule found wrong with its subject.

    `locations`: all, the primary place first; what is there twice counts once. `enclave`: the one that it is about,
    where that is not the only one of its subject. `severity`: where it depends on profile or option, else the rule's.
    `profiles`: canonical variants that it holds for (empty: all). `undecided`: something stays unknown because of it,
    so the audit is incomplete. `key`: what tells it from others at its first place, without line numbers,
    which reformatting changes. `against`: places that the finding does not list, and that it is about as well: the
    grants of its own that an enclave gets more than, say. `explains`: the properties that this one is a cause of, where
    they are not the rule's (None: the rule's). `shared`: it is said of each of several subjects in the same words, and
    is one finding for all of them. `properties`: of a rule about any property, the ids of those that it is about.
    """

    message: str
    locations: Sequence[Location]
    enclave: str | None = None
    severity: Severity | None = None
    profiles: tuple[str, ...] = ()
    undecided: bool = False
    key: str = ""
    against: Sequence[Location] = ()
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
    of: Callable[[S, Context], object] | None = None
    """What of the subject the rule is about, None where there is none; the subject itself unless it says so."""

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
    clause: str,
    remedy: Remedy,
    *,
    explains: tuple[str, ...] = (),
    stops: bool = False,
    applies: Callable[[Any, Context], bool] | None = None,
    of: Callable[[Any, Context], object] | None = None,
) -> Callable[[Callable[..., Iterator[Violation]]], Rule[Any]]:
    """Registers a rule, which is called as its function is and is about what that takes first, or what `of` does.

    The function takes the context, too, where it looks at it. Raises ValueError at import for a code or name that is
    taken, or a function without a docstring.
    """

    def judged_by(check: Callable[..., Iterator[Violation]]) -> Rule[Any]:
        @wraps(check)
        def alone(about: Any, _context: Context) -> Iterator[Violation]:
            return check(about)

        function = cast(FunctionType, check)
        asked = cast(FunctionType, of or check)
        subject = next(iter(asked.__annotations__.values()))
        made: Rule[Any] = Rule(
            code=code,
            name=function.__name__.replace("_", "-"),
            severity=severity,
            on=asked.__globals__[subject],
            clause=clause,
            remedy=remedy,
            docstring=check.__doc__ or "",
            explains=frozenset(explains),
            stops=stops,
            check=check if function.__code__.co_argcount > 1 else alone,
            applies=applies,
            of=of,
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


def rule_code(word: str) -> str:
    """The code of a rule or of a family (`KA2`), in capitals.

    Raises UsageError for an unknown one, and for one of KA9, the audit itself, which always runs.
    """
    code = word.upper()
    known = sorted({word for made in REGISTERED.values() for word in (made.family, made.code)})
    if code.startswith(OF_THE_AUDIT):
        raise UsageError(f"{word!r}: KA9 says what became of the audit itself, and always runs.")
    if code not in known:
        hint = rule_meant(word, known)
        raise UsageError(f"{word!r} is no rule's code.{hint} `keystore-audit rules` lists them.")
    return code


def rule_meant(word: str, known: Sequence[str]) -> str:
    """` Did you mean …?` with the code or name among `known` that is nearest to `word`, or nothing.

    Codes are compared place by place: the letters of all of them are alike. Another family is never meant.
    """
    family = [code for code in known if code[:3] == word.upper()[:3]]
    if family:
        nearest = max(family, key=lambda code: sum(a == b for a, b in zip(code, word.upper(), strict=False)))
        return f" Did you mean {nearest}?"
    return meant(word.lower(), (name for name in known if name.islower()))
