"""How a rule is declared, and what it may look at: identity, clause and remedy stand next to the function."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from functools import wraps
from inspect import cleandoc
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final, Generic, Protocol, TypeVar, cast

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.findings import OF_THE_AUDIT, Location, Remedy, Severity
from keystore_audit.intent.environment import Environment
from keystore_audit.keystore.identity import Beside
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.meaning import Meaning
from keystore_audit.model.trust.chain import Authorities
from keystore_audit.profiles import Profile, Release
from keystore_audit.properties.result import EngineRun, PropertyResult
from keystore_audit.settings.suppressions import Suppression
from keystore_audit.text import meant
from keystore_audit.truth import Truth

if TYPE_CHECKING:  # an audit without a policy, a graph or a launch file needs none of it
    from keystore_audit.model.claims.stated import Claim
    from keystore_audit.model.intended.drift import Drift
    from keystore_audit.model.intended.observed import Observation
    from keystore_audit.zenoh.network import Network

from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.typed import Operation
from keystore_audit.text import shorten, some


class Context(Struct, frozen=True, kw_only=True):
    """The evidence, its meaning, the engines' answers and the options of this audit.

    `at` is the audit instant (aware UTC), `expires_within` the notice for coming expiry, `deployed` whether
    the tree goes on a robot. `profiles` are the chosen ones; findings about signers are judged under every
    known variant (`model.profiles.VARIANTS`). `observed`: graphs and launch files compared with the keystore, None
    where none were named.
    """

    keystore: Keystore
    meaning: Meaning
    accesses: AccessViews
    """What the documents say to each implementation."""
    results: tuple[PropertyResult, ...]
    engines: tuple[EngineRun, ...]
    at: datetime
    expires_within: timedelta
    deployed: bool
    profiles: tuple[Profile, ...]
    """The implementations that some enclave may run."""
    fleets: tuple[Profile, ...]
    """What is judged: fleets on each of these."""
    beside: Beside | None = None
    """The other keystores of this run; None: there are none."""
    environment: Environment | None = None
    """What the robots' processes start with; None where no file says so."""
    network: Network | None = None
    """The processes of the middleware that routes; None where no folder of theirs was named."""
    releases: tuple[Release, ...] = ()
    """Of that middleware, those that are judged."""
    claims: tuple[Claim, ...] = ()
    """What settings assert."""
    drift: Drift | None = None
    """The keystore compared with the policy; None where none was named."""
    observed: Observation | None = None
    launch_complete: bool = False
    """Whether the audit is incomplete where launch files could not be worked out."""
    authorities: Authorities = Authorities()
    """Those that settings or options declare."""
    suppressions: tuple[Suppression, ...] = ()
    """Findings that settings and a baseline accept, in the order in which they are looked for."""
    conditions: tuple[str, ...] = ()
    """Of which domain and zone the answers are, and under which assumptions."""

    def chose(self, profiles: Iterable[Profile]) -> bool:
        """Whether some of them are among the chosen ones."""
        return not {*self.profiles}.isdisjoint(profiles)

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
    `profiles`: canonical variants that it holds for (empty: it is about none of them). Findings name them where it is
    not about all that are chosen (`judge`). `undecided`: something stays unknown because of it,
    so the audit is incomplete. `key`: what tells it from others at its first place, without line numbers,
    which reformatting changes. `against`: places that it is about as well, and that the finding does not list. Such are
    the own grants of an enclave that gets more. `explains`: the properties that this one is a cause of, where
    they are not the rule's (None: the rule's). `shared`: it is said of each of several subjects in the same words, and
    is one finding for all of them. `properties`: of a rule about any property, the ids of those that it is about.
    `sent`: as in `Finding`.
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
    sent: tuple[tuple[str, str], ...] = ()


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


# How findings name things: the same words for enclaves, instants, implementations and defects in every rule. Untrusted
# text goes into messages as it is, only shortened: whoever renders a message escapes it (`keystore_audit.text`).


MAX_QUOTED: Final = 160
"""Characters of one quoted name: an enclave's path and a subject fit, a hostile subject of 60 kB does not."""

MAX_LISTED: Final = 5
"""Names in a list before it says how many more there are; the locations hold them all."""

VERBS: Final = {Operation.PUBLISH: "publish", Operation.SUBSCRIBE: "subscribe to", Operation.RELAY: "relay"}
"""What is done with the topic whose name follows."""


def quoted(text: str) -> str:
    """Untrusted text in single quotes, bounded."""
    return f"'{shorten(text, MAX_QUOTED)}'"


def listed(names: Iterable[str]) -> str:
    """`a, b, c and 4 more`."""
    return some((shorten(name, MAX_QUOTED) for name in names), MAX_LISTED)


def more(count: int, what: str = "") -> str:
    """` and 2 more` of a count of which one is told; nothing where that is all."""
    return f" and {count - 1} more{what}" if count > 1 else ""


def more_like(found: Collection[object], like: str = " like it") -> str:
    """` (and 2 more like it)`, where the first alone is told."""
    return f" ({more(len(found), like).strip()})" if len(found) > 1 else ""


def paths(enclaves: Iterable[Enclave]) -> str:
    """The enclaves' paths, listed."""
    return listed(enclave.path for enclave in enclaves)


def sole(enclaves: Sequence[Enclave]) -> str | None:
    """The enclave's path where only one is concerned, so that the finding is filed under it."""
    return enclaves[0].path if len(enclaves) == 1 else None


def of_kinds(defects: Iterable[Defect], *kinds: Kind) -> Iterator[Defect]:
    """The defects of these kinds, in order."""
    return (defect for defect in defects if defect.kind in kinds)


def defective(
    defects: Iterable[Defect],
    says: str = "",
    *,
    undecided: bool = False,
    severity: Severity | None = None,
    profiles: tuple[str, ...] = (),
    remedy: Remedy | None = None,
) -> Iterator[Violation]:
    """One violation for all defects of one kind in one file, each of them a location of it; `says` what follows.

    A hostile file may have thousands of them. Where all are the same, no place repeats what the message says.
    """
    found = list(defects)
    if not found:
        return
    first, more = found[0], more_like(found)
    several = any(each.detail != first.detail for each in found)
    joint = "; " if ": " in first.detail else ": "  # one colon in a sentence
    yield Violation(
        f"{sentence(first.detail)}{more}{joint if says else '.'}{says}",
        [located(each, shorten(each.detail, MAX_QUOTED) if several else "") for each in found],
        undecided=undecided,
        severity=severity,
        profiles=profiles,
        key=first.kind.value,
        remedy=remedy,
    )


class _Placed(Protocol):
    """What stands at a line of a file of the keystore."""

    @property
    def path(self) -> str: ...
    @property
    def line(self) -> int | None: ...


def located(found: _Placed, message: str = "") -> Location:
    """Where it stands."""
    return Location(found.path, found.line, message=message)


def sentence(text: str) -> str:
    """The words of a reader as the beginning of a sentence: bounded, first letter large, no full stop."""
    short = shorten(text, 2 * MAX_QUOTED).rstrip(".")
    return short[:1].upper() + short[1:]


def either(names: Collection[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    every = list(names)
    return every[0] if len(every) == 1 else f"{', '.join(every[:-1])} and {every[-1]}"
