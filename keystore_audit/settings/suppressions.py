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
    Suppressed,
)
from keystore_audit.model.matching.expression import parse
from keystore_audit.profiles import VARIANTS, Matcher, facts
from keystore_audit.settings.document import Source, Table, Texts, several
from keystore_audit.text import counted, meant

MAX_DAYS: Final = 180
"""How long a suppression may last, from the audit instant, unless settings say otherwise (`max_suppression_days`)."""

ALL: Final = "*"


class Suppression(Struct, frozen=True, kw_only=True):
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
    """What became of a suppression in an audit."""

    USED = "used"
    ENDED = "ended"
    UNUSED = "unused"


class Use(Struct, frozen=True, kw_only=True):
    """A suppression and the findings that it speaks of; `why`: of one that is not used, why, in words."""

    suppression: Suppression
    fate: Fate
    findings: tuple[Finding, ...] = ()
    why: str = ""


class FileOfUses(Struct, frozen=True, kw_only=True):
    """What became of the suppressions of one file."""

    path: str
    uses: tuple[Use, ...]


def check_codes(suppressions: Iterable[Suppression], codes: Collection[str]) -> None:
    """Raises errors.UsageError for one of a rule that there is not."""
    for suppression in suppressions:
        if suppression.code not in codes:
            hint = meant(suppression.code, codes)
            raise UsageError(f"{suppression.place}: {suppression.code} is no rule's code.{hint}")


def limited(suppressions: Iterable[Suppression], worst: Mapping[str, Severity]) -> tuple[Suppression, ...]:
    """The suppressions; one that names no severity accepts its rule's own, `worst`, and no worse one."""
    return tuple(
        replace(suppression, severity=worst[suppression.code]) if suppression.severity is None else suppression
        for suppression in suppressions
    )


def check_dates(suppressions: Iterable[Suppression], at: datetime, days: int = MAX_DAYS) -> None:
    """Raises errors.UsageError for one that lasts longer than so many days from the audit instant `at`."""
    latest = (at + timedelta(days=days)).date()
    for suppression in suppressions:
        if suppression.until > latest:
            where = suppression.until_place or suppression.place
            raise UsageError(
                f"{where}: {suppression.until} is too far away: expected {latest} or sooner, "
                f"{days} days after the audit's time (max_suppression_days in the settings changes that)."
            )


def uses(
    findings: Iterable[Finding],
    suppressions: Iterable[Suppression],
    at: datetime,
    profiles: Collection[str],
    codes: Collection[str] | None = None,
    outside: Mapping[str, Collection[str]] | None = None,
) -> tuple[FileOfUses, ...]:
    """What becomes of each suppression at the instant `at`, by file.

    `profiles`: the names of those chosen, which a finding without any of its own is about. `codes`: of the rules that
    were asked (None: all); a suppression of another is neither used nor unused. `outside`: by fingerprint, the places
    of findings that no enclave carries; who accepts by fingerprint alone has no need of them.
    """
    by_code: dict[str, list[Finding]] = {}
    by_fingerprint: dict[str, Finding] = {}
    for finding in findings:
        by_code.setdefault(finding.code, []).append(finding)
        by_fingerprint[finding.fingerprint] = finding
    files: dict[str, list[Use]] = {}
    for suppression in suppressions:
        if suppression.fingerprint is None:
            candidates: Sequence[Finding] = by_code.get(suppression.code, ())
        else:
            found = by_fingerprint.get(suppression.fingerprint)
            candidates = () if found is None or found.code != suppression.code else (found,)
        use = _use(suppression, candidates, at, profiles, outside or {})
        mine = files.setdefault(suppression.location.path, [])
        if use.fate is not Fate.UNUSED or codes is None or suppression.code in codes:
            mine.append(use)
    return tuple(FileOfUses(path=path, uses=tuple(mine)) for path, mine in files.items())


def _use(
    suppression: Suppression,
    candidates: Sequence[Finding],
    at: datetime,
    profiles: Collection[str],
    outside: Mapping[str, Collection[str]],
) -> Use:
    refusals = {
        finding.fingerprint: _refusal(suppression, finding, profiles, outside.get(finding.fingerprint, ()))
        for finding in candidates
    }
    taken = tuple(finding for finding in candidates if refusals[finding.fingerprint] is None)
    if at > suppression.end:
        return Use(suppression=suppression, fate=Fate.ENDED, findings=taken, why=f"until {suppression.until}")
    if taken:
        return Use(suppression=suppression, fate=Fate.USED, findings=taken)
    why = next((refusal for refusal in refusals.values() if refusal), "nothing of the kind was found")
    return Use(suppression=suppression, fate=Fate.UNUSED, why=why)


def acceptable(finding: Finding) -> bool:
    """Whether anybody may accept it: not what the audit says of itself, nor what leaves it undecided."""
    return not finding.code.startswith(OF_THE_AUDIT) and not finding.undecided


def _refusal(
    suppression: Suppression, finding: Finding, profiles: Collection[str], outside: Collection[str]
) -> str | None:
    """Why the suppression does not speak of a finding of its rule; None: it does."""
    if not acceptable(finding):
        return "what it names is undecided, and nothing accepts that"
    if suppression.fingerprint is None and not _within(suppression.where, finding, outside):
        return (
            "a property is one of the whole keystore: name it by fingerprint and meaning"
            if finding.code.startswith(OF_PROPERTIES)
            else "what was found is not, or not only, there"
        )
    if suppression.severity is not None and not suppression.severity.at_least(finding.severity):
        return f"it is {finding.severity.value} now, and {suppression.severity.value} was accepted"
    others = {*(finding.profiles or profiles)} - suppression.profiles if suppression.profiles is not None else ()
    if others:
        return f"it holds under {', '.join(sorted(others))} too"
    if suppression.meaning is not None and suppression.meaning != finding.meaning:
        return "what it is about has changed"
    return None


def _within(where: tuple[str, ...], finding: Finding, outside: Collection[str]) -> bool:
    """Whether the finding is at these places and nowhere else.

    A finding of an enclave may be in what enclaves carry. What lies `outside`, as a document that it may present, has
    to be named as well.
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
    """The findings, those that are accepted marked with why and by whom: the first suppression that speaks of them."""
    marks: dict[str, Suppressed] = {}
    for file in files:
        for use in file.uses:
            for finding in use.findings if use.fate is Fate.USED else ():
                marks.setdefault(finding.fingerprint, _mark(use.suppression))
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


def _mark(suppression: Suppression) -> Suppressed:
    line = suppression.location.line
    return Suppressed(
        reason=suppression.reason,
        until=suppression.until.isoformat(),
        owner=suppression.owner,
        source=f"{suppression.location.path}:{line}",
    )


# Accepted findings in settings (`[[suppression]]`) and in baselines (`[[accepted]]`), table by table.


Code = Annotated[str, Meta(pattern=r"^KA[0-9]{3}\Z", description="one rule's code, e.g. KA203, and no family")]
Digest = Annotated[
    str, Meta(pattern=r"^[0-9a-f]{64}\Z", description="64 digits 0 to 9 and a to f, as in the JSON report")
]
_WORDS: Final = "words, and not only spaces"


class _SuppressionTable(Table, frozen=True, kw_only=True):
    """What both kinds of tables have. `profiles`: None, any; `until`: the last day."""

    code: Code
    profiles: Texts | None = None
    reason: Annotated[str, Meta(max_length=MAX_REASON, pattern=r"\S", description=_WORDS)]
    owner: Annotated[str, Meta(max_length=MAX_OWNER, pattern=r"\S", description=_WORDS)]
    until: date


class SuppressionTable(_SuppressionTable, frozen=True, kw_only=True):
    """A `[[suppression]]`: at places, or with a fingerprint."""

    where: Texts | None = None
    fingerprint: Digest | None = None
    meaning: Digest | None = None
    severity: Severity | None = None


class AcceptedTable(_SuppressionTable, frozen=True, kw_only=True):
    """An `[[accepted]]` finding. `severity`: the worst that is accepted; `finding`: what it says, for people."""

    fingerprint: Digest
    meaning: Digest
    severity: Severity
    finding: str = ""


def read_suppressions(tables: Sequence[SuppressionTable], source: Source) -> tuple[Suppression, ...]:
    """The `[[suppression]]` tables of settings. Raises errors.UsageError."""
    return tuple(_in_settings(table, source.at(number)) for number, table in enumerate(tables))


def _in_settings(table: SuppressionTable, source: Source) -> Suppression:
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
    return _suppression(table, source, where)


def read_accepted(tables: Sequence[AcceptedTable], source: Source) -> tuple[Suppression, ...]:
    """The `[[accepted]]` tables of a baseline. Raises errors.UsageError."""
    seen: dict[str, str] = {}
    read = []
    for number, table in enumerate(tables):
        here = source.at(number)
        if table.fingerprint in seen:
            here.at("fingerprint").wrong(f"this one is accepted already, at {seen[table.fingerprint]}")
        seen[table.fingerprint] = here.place
        read.append(_suppression(table, here, (), table.finding))
    return tuple(read)


def _suppression(
    table: SuppressionTable | AcceptedTable,
    source: Source,
    where: tuple[str, ...],
    finding: str = "",
) -> Suppression:
    if table.code.startswith(OF_THE_AUDIT):
        source.at("code").wrong(
            f"{table.code}: codes from {OF_THE_AUDIT}00 on are about the audit itself, which nothing accepts"
        )
    for name in several(table.profiles):
        if name not in VARIANTS:  # what an alias stands for changes from version to version
            expected = f"expected names as in reports, e.g. {facts.EXAMPLE_PROFILE}"
            source.at("profiles").wrong(f"{name!r} is no profile; {expected}")
    return Suppression(
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
