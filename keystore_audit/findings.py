"""What an audit says: what to do about it, severities, places, findings and outcomes.

These are the values of the interface contract (docs/reference.md); everything
else in the program exists to produce them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from enum import Enum
from itertools import chain, repeat, starmap
from typing import Final, NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.text import some

MAX_PATHS: Final = 3
"""Files named in the text of a step; `paths` has them all."""


class FixKind(str, Enum):
    """Who can do it: a script; a script when somebody has decided and edited something; nobody in the keystore."""

    MECHANICAL = "mechanical"
    DECISION = "decision"
    OUTSIDE = "outside"


class Act(str, Enum):
    """What a script does; the value stands in JSON. What somebody edits first is signed as it is then."""

    SIGN = "sign"
    EDIT = "edit"
    EDIT_GOVERNANCE = "edit-governance"
    EDIT_PERMISSIONS = "edit-permissions"
    ISSUE = "issue"
    RENEW = "renew"
    NEW_IDENTITY_CA = "new-identity-ca"
    NEW_PERMISSIONS_CA = "new-permissions-ca"
    LINK = "link"
    CLOSE_KEY = "chmod-600"
    CLOSE = "chmod-go-w"


_SAID: Final = {
    Act.SIGN: "Sign the document again with the permissions CA.",
    Act.EDIT: "Edit the document's .xml and sign it with the permissions CA.",
    Act.EDIT_GOVERNANCE: "Edit the governance's .xml and sign it with the permissions CA.",
    Act.EDIT_PERMISSIONS: (
        "Edit and sign permissions.xml, or edit the policy and run `ros2 security create_permission KEYSTORE ENCLAVE "
        "policy.xml`."
    ),
    Act.ISSUE: "Issue a new key and certificate under the identity CA, for a year.",
    Act.RENEW: "Renew the authority's certificate with its own key and name, and sign again what names the old one.",
    Act.NEW_IDENTITY_CA: "Make a new identity CA, and issue all identities under it, for a year.",
    Act.NEW_PERMISSIONS_CA: "Make a separate permissions CA, and sign all documents with it.",
    Act.LINK: "Make the link again, as sros2 makes it.",
    Act.CLOSE_KEY: "Remove the rights of other users to the key (chmod 600).",
    Act.CLOSE: "Remove the right to write of other users (chmod go-w).",
}


class Step(Struct, frozen=True, kw_only=True):
    """A sentence and, where a script can do it, the act. `paths`: the files it writes, as in `Location.path`. A remedy
    has none if it is about no keystore, or if the keystore has not the layout that sros2 makes since Foxy.
    """

    text: str
    act: Act | None = None
    paths: tuple[str, ...] = ()

    def at(self, paths: tuple[str, ...]) -> Step:
        """The act on these files."""
        named = f"{self.text.rstrip('.')}: {some(paths, MAX_PATHS)}." if paths else self.text
        return replace(self, text=named, paths=paths)


class Remedy(Struct, frozen=True, kw_only=True):
    """What to do, in this order."""

    kind: FixKind
    steps: tuple[Step, ...]

    @property
    def text(self) -> str:
        """All of it for people."""
        return " ".join(step.text for step in self.steps)

    @property
    def general(self) -> str:
        """The same without the names of files, which several findings of a rule share."""
        return " ".join(map(_sentence, self.steps))

    @property
    def short(self) -> str:
        """Its first step, without the names of files."""
        return _sentence(self.steps[0])

    @property
    def scripted(self) -> bool:
        """Whether there is something that a script does."""
        return any(step.paths for step in self.steps)


def _sentence(step: Step) -> str:
    return step.text if step.act is None else _SAID[step.act]


def _remedy(kind: FixKind, text: str, more: tuple[Act | str, ...]) -> Remedy:
    said = (Step(text=text),) if text else ()
    steps = (Step(text=_SAID[each], act=each) if isinstance(each, Act) else Step(text=each) for each in more)
    return Remedy(kind=kind, steps=(*said, *steps))


def mechanical(text: str, *acts: Act) -> Remedy:
    """What a script does without being told anything."""
    return _remedy(FixKind.MECHANICAL, text, acts)


def decision(text: str, *more: Act | str) -> Remedy:
    """What somebody has to decide; then, where there are acts, a script does the rest."""
    return _remedy(FixKind.DECISION, text, more)


def outside(text: str, *more: str) -> Remedy:
    """What no edit of the keystore brings about."""
    return _remedy(FixKind.OUTSIDE, text, more)


MAX_PLACES: Final = 50
"""Locations of one finding: enough to fix by hand, and ten thousand wildcards make no report of ten thousand lines."""

OF_PROPERTIES: Final = "KA7"
OF_NETWORKS: Final = "KA8"
OF_THE_AUDIT: Final = "KA9"
"""How the codes begin of rules about what the engines decide, networks without DDS, and the audit itself."""


class Severity(str, Enum):
    """How much a finding matters; ordered from worst to least by `rank`."""

    CRITICAL = "critical"
    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"
    INFO = "info"

    @property
    def rank(self) -> int:
        """0 for critical, 4 for info."""
        return _RANK[self]

    def at_least(self, other: Severity) -> bool:
        """Whether this is as bad as `other` or worse."""
        return self.rank <= other.rank


_RANK = {severity: rank for rank, severity in enumerate(Severity)}

SEVERITIES: Final = tuple(severity.value for severity in Severity)
"""Their names, the worst first."""


class Location(Struct, frozen=True):
    """A place in a file of the keystore, or (`beside`) in one that the user named: a policy, a graph, settings.

    `path` is relative to the keystore, links resolved, POSIX, percent-encoded where it is not
    UTF-8; `beside`, it is as the user gave it. `line` counts from 1 in the file as it is on disk, and is None for a
    whole file.
    """

    path: str
    line: int | None = None
    message: str = ""
    beside: bool = False

    def __str__(self) -> str:
        """`enclaves/governance.p7s:12`, raw text."""
        return self.path if self.line is None else f"{self.path}:{self.line}"


MAX_REASON: Final = 1000
MAX_OWNER: Final = 200
"""Characters of what a suppression says."""


class Suppressed(Struct, frozen=True, kw_only=True):
    """Why, until when and by whom a finding is accepted, and which file says so."""

    reason: str
    until: str
    owner: str
    source: str


class Finding(Struct, frozen=True, kw_only=True):
    """One defect of the keystore, or of the audit itself (KA9).

    `locations` has the primary place first. `profiles` are the canonical variants it holds for
    (empty: all). `explained_by` holds fingerprints of the findings that are its cause. `undecided`: something stays
    unknown because of it, so the audit is incomplete. `properties`: of a rule about any property, the ids of those that
    it is about. `fix`: what to do, with the files of this keystore. `fingerprint`: which finding
    it is; `meaning`: a digest of what it is about, which changes where more is to be accepted. `sent`: the sender and
    the name of ROS 2 of what can be sent by this defect, for pictures.
    """

    code: str
    name: str
    severity: Severity
    message: str
    fix: Remedy
    clause: str
    enclave: str | None
    locations: tuple[Location, ...]
    profiles: tuple[str, ...] = ()
    explained_by: tuple[str, ...] = ()
    fingerprint: str
    meaning: str = ""
    undecided: bool = False
    properties: tuple[str, ...] = ()
    sent: tuple[tuple[str, str], ...] = ()
    suppressed: Suppressed | None = None

    def fails(self, gate: Severity | None) -> bool:
        """Whether it alone fails the gate; None: one that never fails on findings."""
        return self.suppressed is None and gate is not None and self.severity.at_least(gate)


class Result(str, Enum):
    """What came of one rule on one subject.

    `OPEN` means that the question could not be decided: such an audit is incomplete and never passes.
    """

    PASS = "pass"  # noqa: S105 - a verdict, not a password
    FAIL = "fail"
    NOT_APPLICABLE = "notApplicable"
    OPEN = "open"


WHOLE: Final = "keystore"
"""The subject of rules about the whole keystore; a file may be called so too."""


class Outcome(NamedTuple):
    """The answer of rule `rule` (a code) about `subject` (an enclave, a path, a property id or `WHOLE`)."""

    rule: str
    subject: str
    outcome: Result


class Row(NamedTuple):
    """The answers of one rule about subjects in turn: each of `results` holds for so many of them."""

    rule: str
    subjects: Sequence[str]
    results: Sequence[tuple[Result, int]]


class Outcomes(Struct, frozen=True, kw_only=True):
    """The answers of every rule about every subject: 80,000 for a thousand enclaves, nearly all alike."""

    rows: tuple[Row, ...]

    def __iter__(self) -> Iterator[Outcome]:
        """Each answer."""
        for rule, subjects, results in self.rows:
            each = chain.from_iterable(starmap(repeat, results))
            yield from map(Outcome, repeat(rule), subjects, each)

    def __len__(self) -> int:
        """How many they are."""
        return sum(len(row.subjects) for row in self.rows)

    def some(self, wanted: Result) -> set[str]:
        """The rules that gave this answer about some subject."""
        return {row.rule for row in self.rows if any(result is wanted for result, _count in row.results)}


def fingerprint(code: str, enclave: str | None, path: str | None, key: str) -> str:
    """Identity of a finding across runs: no line numbers, so that reformatting keeps it.

    SHA-256, in hexadecimal, of the four parts joined by NUL.
    """
    parts = (code, enclave or "", path or "", key)
    return hashlib.sha256("\0".join(parts).encode("utf-8", "surrogatepass")).hexdigest()
