"""Accepted findings: which ones somebody accepts, why and until when, and which of them an audit finds.

They stand in keystore-audit.toml (`[[suppression]]`) and in baselines (`[[accepted]]`); docs/settings.md.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import date, datetime, time, timedelta, timezone
from enum import Enum
from typing import Annotated, Final

from msgspec import Meta, Struct
from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.findings import (
    MAX_OWNER,
    MAX_PLACES,
    MAX_REASON,
    OF_PROPERTIES,
    OF_THE_AUDIT,
    Finding,
    Location,
    Severity,
    Suppression,
)
from keystore_audit.model.matching.expression import parse
from keystore_audit.profiles import VARIANTS, Matcher, facts
from keystore_audit.settings.document import Source, Table, Texts, several
from keystore_audit.text import counted, meant

MAX_DAYS: Final = 180
"""How long an acceptance may last, from the audit instant, unless settings say otherwise (`max_suppression_days`)."""

ALL: Final = "*"


class Acceptance(Struct, frozen=True, kw_only=True):
    """Findings that somebody accepts: of the rule `code`, and at a place or with a fingerprint.

    `where`: globs on enclave paths (they begin with /) or on paths in the keystore, or `*` for all findings of the
    rule. `severity`: the worst that is accepted; `profiles`: no others than these (None: any).
    `meaning`: what the finding is about (None: whatever it is). `until`: the
    last day, UTC. `location`, `place`: where it stands, for findings and for people; `until_place`: where its end does,
    if known. `finding`: what a baseline notes of the finding, for people alone.
    """

    code: str
    where: tuple[str, ...] = ()
    fingerprint: str | None = None
    severity: Severity | None = None
    profiles: frozenset[str] | None = None
    meaning: str | None = None
    reason: str
    owner: str
    until: date
    location: Location
    place: str
    until_place: str = ""
    finding: str = ""

    @property
    def end(self) -> datetime:
        """The last second, aware UTC."""
        return datetime.combine(self.until, time(23, 59, 59), timezone.utc)

    @property
    def what(self) -> str:
        """What it accepts, in words."""
        return f"{self.code} {f'with fingerprint {self.fingerprint[:12]}' if self.fingerprint else self._at()}"

    def _at(self) -> str:
        return "everywhere" if ALL in self.where else f"at {', '.join(self.where)}"


class Fate(str, Enum):
    """What became of an acceptance in an audit."""

    USED = "used"
    ENDED = "ended"
    UNUSED = "unused"


class Use(Struct, frozen=True, kw_only=True):
    """An acceptance and the findings that it speaks of; `why`: of one that is not used, why, in words."""

    acceptance: Acceptance
    fate: Fate
    findings: tuple[Finding, ...] = ()
    why: str = ""


class FileOfUses(Struct, frozen=True, kw_only=True):
    """What became of the acceptances of one file."""

    path: str
    uses: tuple[Use, ...]


def check_codes(acceptances: Iterable[Acceptance], codes: Collection[str]) -> None:
    """Raises errors.UsageError for one of a rule that there is not."""
    for acceptance in acceptances:
        if acceptance.code not in codes:
            hint = meant(acceptance.code, codes)
            raise UsageError(f"{acceptance.place}: {acceptance.code} is no rule's code.{hint}")


def limited(acceptances: Iterable[Acceptance], worst: Mapping[str, Severity]) -> tuple[Acceptance, ...]:
    """The acceptances; one that names no severity accepts its rule's own, `worst`, and no worse one."""
    return tuple(
        replace(acceptance, severity=worst[acceptance.code]) if acceptance.severity is None else acceptance
        for acceptance in acceptances
    )


def check_dates(acceptances: Iterable[Acceptance], at: datetime, days: int = MAX_DAYS) -> None:
    """Raises errors.UsageError for one that lasts longer than so many days from the audit instant `at`."""
    latest = (at + timedelta(days=days)).date()
    for acceptance in acceptances:
        if acceptance.until > latest:
            where = acceptance.until_place or acceptance.place
            raise UsageError(
                f"{where}: {acceptance.until} is too far away: expected {latest} or sooner, "
                f"{days} days after the audit's time (max_suppression_days in the settings changes that)."
            )


def uses(
    findings: Iterable[Finding],
    acceptances: Iterable[Acceptance],
    at: datetime,
    profiles: Collection[str],
    codes: Collection[str] | None = None,
    outside: Mapping[str, Collection[str]] | None = None,
) -> tuple[FileOfUses, ...]:
    """What becomes of each acceptance at the instant `at`, by file.

    `profiles`: the names of those chosen, which a finding without any of its own is about. `codes`: of the rules that
    were asked (None: all); an acceptance of another is neither used nor unused. `outside`: by fingerprint, the places
    of findings that no enclave carries; who accepts by fingerprint alone has no need of them.
    """
    by_code: dict[str, list[Finding]] = {}
    by_fingerprint: dict[str, Finding] = {}
    for finding in findings:
        by_code.setdefault(finding.code, []).append(finding)
        by_fingerprint[finding.fingerprint] = finding
    files: dict[str, list[Use]] = {}
    for acceptance in acceptances:
        if acceptance.fingerprint is None:
            candidates: Sequence[Finding] = by_code.get(acceptance.code, ())
        else:
            found = by_fingerprint.get(acceptance.fingerprint)
            candidates = () if found is None or found.code != acceptance.code else (found,)
        use = _use(acceptance, candidates, at, profiles, outside or {})
        mine = files.setdefault(acceptance.location.path, [])
        if use.fate is not Fate.UNUSED or codes is None or acceptance.code in codes:
            mine.append(use)
    return tuple(FileOfUses(path=path, uses=tuple(mine)) for path, mine in files.items())


def _use(
    acceptance: Acceptance,
    candidates: Sequence[Finding],
    at: datetime,
    profiles: Collection[str],
    outside: Mapping[str, Collection[str]],
) -> Use:
    refusals = {
        finding.fingerprint: _refusal(acceptance, finding, profiles, outside.get(finding.fingerprint, ()))
        for finding in candidates
    }
    taken = tuple(finding for finding in candidates if refusals[finding.fingerprint] is None)
    if at > acceptance.end:
        return Use(acceptance=acceptance, fate=Fate.ENDED, findings=taken, why=f"until {acceptance.until}")
    if taken:
        return Use(acceptance=acceptance, fate=Fate.USED, findings=taken)
    why = next((refusal for refusal in refusals.values() if refusal), "nothing of the kind was found")
    return Use(acceptance=acceptance, fate=Fate.UNUSED, why=why)


def acceptable(finding: Finding) -> bool:
    """Whether anybody may accept it: not what the audit says of itself, nor what leaves it undecided."""
    return not finding.code.startswith(OF_THE_AUDIT) and not finding.undecided


def _refusal(
    acceptance: Acceptance, finding: Finding, profiles: Collection[str], outside: Collection[str]
) -> str | None:
    """Why the acceptance does not speak of a finding of its rule; None: it does."""
    if not acceptable(finding):
        return "what it names is undecided, and nothing accepts that"
    if acceptance.fingerprint is None and not _within(acceptance.where, finding, outside):
        return (
            "a property is one of the whole keystore: name it by fingerprint and meaning"
            if finding.code.startswith(OF_PROPERTIES)
            else "what was found is not, or not only, there"
        )
    if acceptance.severity is not None and not acceptance.severity.at_least(finding.severity):
        return f"it is {finding.severity.value} now, and {acceptance.severity.value} was accepted"
    others = {*(finding.profiles or profiles)} - acceptance.profiles if acceptance.profiles is not None else ()
    if others:
        return f"it holds under {', '.join(sorted(others))} too"
    if acceptance.meaning is not None and acceptance.meaning != finding.meaning:
        return "what it is about has changed"
    return None


def _within(where: tuple[str, ...], finding: Finding, outside: Collection[str]) -> bool:
    """Whether the finding is at these places and nowhere else.

    That of an enclave may be in what enclaves carry; what lies `outside`, as a document that it may present, has to be
    named as well.
    """
    if finding.code.startswith(OF_PROPERTIES):  # its enclave is that of an example, and others come
        return False
    if ALL in where:
        return True
    enclaves = [glob for glob in where if glob.startswith("/")]
    paths = [glob for glob in where if not glob.startswith("/")]
    if finding.enclave is not None and _matches(enclaves, finding.enclave):
        return all(_matches(paths, path) for path in outside)
    if not 0 < len(finding.locations) < MAX_PLACES:  # there may be more of them than a finding lists
        return False
    places = [location.path for location in finding.locations if not location.beside]
    return bool(places) and all(_matches(paths, path) for path in places)


def _matches(globs: Iterable[str], name: str) -> bool:
    return any(parse(glob, Matcher.POSIX).matches(name) for glob in globs)


def accepted(findings: Iterable[Finding], files: Iterable[FileOfUses]) -> tuple[Finding, ...]:
    """The findings, those that are accepted marked with why and by whom: the first acceptance that speaks of them."""
    marks: dict[str, Suppression] = {}
    for file in files:
        for use in file.uses:
            for finding in use.findings if use.fate is Fate.USED else ():
                marks.setdefault(finding.fingerprint, _mark(use.acceptance))
    return tuple(
        replace(finding, suppressed=marks[finding.fingerprint]) if finding.fingerprint in marks else finding
        for finding in findings
    )


def accepted_by(findings: Iterable[Finding]) -> tuple[str, ...]:
    """How many findings each file accepts, in words: what makes this gate laxer."""
    marks = [finding.suppressed for finding in findings if finding.suppressed is not None]
    counts = Counter(mark.source.rpartition(":")[0] for mark in marks)
    return tuple(f"{counted(count, 'finding')} accepted by {file}" for file, count in counts.items())


def first_end(findings: Iterable[Finding]) -> datetime | None:
    """The first instant at which one of them is accepted no longer, aware UTC; None: none is accepted."""
    days = [date.fromisoformat(finding.suppressed.until) for finding in findings if finding.suppressed is not None]
    return datetime.combine(min(days) + timedelta(days=1), time(), timezone.utc) if days else None


def _mark(acceptance: Acceptance) -> Suppression:
    line = acceptance.location.line
    return Suppression(
        reason=acceptance.reason,
        until=acceptance.until.isoformat(),
        owner=acceptance.owner,
        source=f"{acceptance.location.path}:{line}",
    )


# Accepted findings in settings (`[[suppression]]`) and in baselines (`[[accepted]]`), table by table.


Code = Annotated[str, Meta(pattern=r"^KA[0-9]{3}\Z", description="one rule's code, e.g. KA203, and no family")]
Digest = Annotated[
    str, Meta(pattern=r"^[0-9a-f]{64}\Z", description="64 digits 0 to 9 and a to f, as in the JSON report")
]
_WORDS: Final = "words, and not only spaces"


class _AcceptanceTable(Table, frozen=True, kw_only=True):
    """What both kinds of tables have. `profiles`: None, any; `until`: the last day."""

    code: Code
    profiles: Texts | None = None
    reason: Annotated[str, Meta(max_length=MAX_REASON, pattern=r"\S", description=_WORDS)]
    owner: Annotated[str, Meta(max_length=MAX_OWNER, pattern=r"\S", description=_WORDS)]
    until: date


class SuppressionTable(_AcceptanceTable, frozen=True, kw_only=True):
    """A `[[suppression]]`: at places, or with a fingerprint."""

    where: Texts | None = None
    fingerprint: Digest | None = None
    meaning: Digest | None = None
    severity: Severity | None = None


class AcceptedTable(_AcceptanceTable, frozen=True, kw_only=True):
    """An `[[accepted]]` finding. `severity`: the worst that is accepted; `finding`: what it says, for people."""

    fingerprint: Digest
    meaning: Digest
    severity: Severity
    finding: str = ""


def read_suppressions(tables: Sequence[SuppressionTable], source: Source) -> tuple[Acceptance, ...]:
    """The `[[suppression]]` tables of settings. Raises errors.UsageError."""
    return tuple(_suppression(table, source.at(number)) for number, table in enumerate(tables))


def _suppression(table: SuppressionTable, source: Source) -> Acceptance:
    if (table.where is None) == (table.fingerprint is None):
        source.wrong("expected exactly one of where, fingerprint")
    if table.where is not None and table.meaning is not None:
        source.at("meaning").wrong("this belongs to a fingerprint, and here is where")
    if table.fingerprint is not None and table.meaning is None:
        source.wrong("missing key `meaning`")
    where, here = several(table.where), source.at("where")
    if ALL in where and len(where) > 1:
        here.wrong(f'"{ALL}" is everything: expected it alone')
    for glob in where:
        if glob.startswith("./") or "//" in glob or ".." in glob.split("/"):
            here.wrong(f'{glob!r}: expected an enclave ("/arm/*"), or a path in the keystore ("public/*")')
    return _acceptance(table, source, where)


def read_accepted(tables: Sequence[AcceptedTable], source: Source) -> tuple[Acceptance, ...]:
    """The `[[accepted]]` tables of a baseline. Raises errors.UsageError."""
    seen: dict[str, str] = {}
    read = []
    for number, table in enumerate(tables):
        here = source.at(number)
        if table.fingerprint in seen:
            here.at("fingerprint").wrong(f"this one is accepted already, at {seen[table.fingerprint]}")
        seen[table.fingerprint] = here.place
        read.append(_acceptance(table, here, (), table.finding))
    return tuple(read)


def _acceptance(
    table: SuppressionTable | AcceptedTable,
    source: Source,
    where: tuple[str, ...],
    finding: str = "",
) -> Acceptance:
    if table.code.startswith(OF_THE_AUDIT):
        source.at("code").wrong(f"{table.code} is about the audit itself, which nothing accepts")
    for name in several(table.profiles):
        if name not in VARIANTS:  # what an alias stands for changes from version to version
            expected = f"expected names as in reports, e.g. {facts.EXAMPLE_PROFILE}"
            source.at("profiles").wrong(f"{name!r} is no profile; {expected}")
    return Acceptance(
        code=table.code,
        where=where,
        fingerprint=table.fingerprint,
        severity=table.severity,
        profiles=None if table.profiles is None else frozenset(several(table.profiles)),
        meaning=table.meaning,
        reason=table.reason,
        owner=table.owner,
        until=table.until,
        location=source.location,
        place=source.place,
        until_place=source.at("until").place,
        finding=finding,
    )
