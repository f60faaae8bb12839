"""Who may do what, and where implementations differ, as tables of a web page.

Enclaves by namespace stand against topics by what protects them. Each right names the line that gives it. Enclaves of
one namespace that may do the same are one column. What is left out is counted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from msgspec.structs import replace

from keystore_audit.findings import Finding, Severity
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.blast_radius import Ranking
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.intended.meant import Meant, Uses
from keystore_audit.model.tables.access_rows import Row, decision_rows, folded_by_owner
from keystore_audit.model.tables.access_table import AccessTable, Group
from keystore_audit.model.tables.overview import Issuance, IssuedCertificate, Overview
from keystore_audit.properties.result import Status
from keystore_audit.report.access_words import (
    SHORT,
    differences,
    namespace,
    peers,
    protected,
    protection_words,
    rights,
    worth_showing,
)
from keystore_audit.report.content import STATUSES, Report
from keystore_audit.report.page import by_answer, worst_first
from keystore_audit.report.view_model import Consequences, concerned, only_on, properties_of
from keystore_audit.text import counted
from keystore_audit.truth import Truth, any_of
from keystore_audit.zenoh.answers import RoutedAnswer, RoutedTable

MAX_COLUMNS: Final = 14
"""Columns of one matrix, so that it fits on a page."""

MAX_TOGETHER: Final = 14
"""Enclaves up to which all are in one matrix, whatever their namespaces, each with a column of its own."""

MAX_CELLS: Final = 12_000
"""Cells of all matrices: what a browser shows at once without effort."""

MAX_ROWS: Final = 250
"""Rows of one matrix (the least protected are drawn), or of one ranking (enclaves with the same numbers are one)."""

MAX_RANKED: Final = 12
"""Enclaves of a ranking that are seen without a click."""

MAX_RANKINGS: Final = 4
"""Rankings, where profiles differ."""

MAX_DIFFERENT: Final = 60
"""Things that are set side by side."""

_NEEDS: Final = {
    "publish": (Operation.PUBLISH,),
    "subscribe": (Operation.SUBSCRIBE,),
    "relay": (Operation.RELAY,),
}
"""The operations of a right; services and actions need both publishing and subscribing."""


class Sheet:
    """One report on the page. `prefix`: of every id of its part. `shown`: its findings that are at least so severe.

    `numbers`: by enclave path, a number for ids.
    """

    def __init__(self, report: Report, prefix: str, least: Severity) -> None:
        """Of this report; findings below `least` are hidden."""
        self.report, self.prefix = report, prefix
        self.shown = report.shown(least)
        self.consequences: Final = Consequences(self.shown, report.properties)
        self.profiles = report.judged_profiles
        self.numbers = {entry.path: number for number, entry in enumerate(report.enclaves)}

    def anchor(self, kind: str, number: int | str = "") -> str:
        """The id of a part of this report."""
        return f"{self.prefix}{kind}{f'-{number}' if number != '' else ''}"

    def under(self, names: Iterable[str]) -> str:
        """For which profiles something holds, in words; empty for all."""
        words = only_on(names, self.profiles)
        return words and f"on {words}"

    def of(self, finding: Finding) -> str:
        """The same of a finding."""
        words = concerned(self.report, finding)
        return words and f"on {words}"


def properties(report: Report) -> Mapping[str, Any]:
    """Those that do not hold with their counterexamples, the worst first, and those that do."""
    worst = {each: finding for finding in reversed(report.findings) for each in properties_of(finding)}
    ranks = {each: finding.severity.rank for each, finding in worst.items()}
    failed = sorted(report.properties, key=lambda each: (STATUSES.index(each.status), ranks.get(each.prop.id, 0)))
    engines = (engine for each in report.holding for answer in each.profiles.values() for engine in answer.engines)
    return {
        "failed": [
            (
                result,
                worst_first(result.profiles, lambda each: (frozenset(each.engines.items()), each.counterexample)),
                worst.get(result.prop.id),
            )
            for result in failed
            if result.status is not Status.HOLDS
        ],
        "holding": report.holding,
        "deciding": " and ".join(dict.fromkeys(engines)),
    }


def access(sheet: Sheet, overview: Overview) -> Mapping[str, Any]:
    """The matrices of the profiles that share most answers, and what peers accept beyond them."""
    table = overview.access
    if table is None:
        return {"refused": overview.refused}
    main = table.groups[-1]
    drawing = _Drawing(sheet, main, decision_rows(table, main))

    def sources(path: str, row: Row) -> tuple[Sequence[tuple[str, str]], bool]:
        """The lines that give the rights, each once, and whether a wildcard gives some of one name."""
        needed = {each for word in row.cells[path] for each in _NEEDS.get(word, tuple(Operation)[:2])}
        every = overview.allowances.get(path, ())
        giving = [each for each in every if each.operation in needed and each.names & row.names]
        patterned = not row.several and any(each.by_pattern & row.names for each in giving)
        return [*dict.fromkeys((str(each.location or ""), each.reason) for each in giving)], patterned

    said = sheet.report.meant or Meant(beyond={}, lacking={})

    def uses(told: Uses, path: str, row: Row) -> set[Operation]:
        """What is told of the enclave about a name of the row."""
        own = told.get(path, ())
        topics = {table.names[number].topic for number in members(row.names)} if own else ()
        return {operation for operation, topic in own if topic in topics}

    def beyond(path: str, row: Row, word: str) -> bool:
        """Whether the right was not meant."""
        return not uses(said.beyond, path, row).isdisjoint(_NEEDS.get(word, tuple(Operation)))

    return {
        "domain": table.domain,
        "under": sheet.under(main.profiles),
        "sources": sources,
        "meant": sheet.report.meant is not None,
        "beyond": beyond,
        "lacking": lambda path, row: bool(uses(said.lacking, path, row)),
        "peers": peers(table, main),
        **drawing.matrices(),
    }


def routed(report: Report) -> Mapping[str, Any]:
    """By group of releases that answer alike, what each enclave can do with its own file and without it."""
    table = report.routed
    if table is None:
        return {"groups": ()}
    alike = by_answer({release: tuple(_routed_rows(table, release)) for release in table.releases})
    return {
        "domain": table.domain,
        "groups": [
            (", ".join(names) if len(alike) > 1 else "", [(name, dict(cells)) for name, cells in rows])
            for rows, names in alike.items()
        ],
        "paths": [entry.path for entry in report.enclaves],
        "doubts": [f"{location}: {why}" for location, why in table.doubts],
    }


_Cells = tuple[tuple[str, tuple[tuple[str, str], ...]], ...]
"""By enclave a word for each right that it has, and whether it works, takes dropping the file, or is unknown."""


def _routed_rows(table: RoutedTable, release: str) -> Iterator[tuple[str, _Cells]]:
    """Of each name that somebody can use."""
    for name, asked in grouped(table.rights, lambda each: each.name).items():
        kinds = ((each, _routed_kind(each.answers[release])) for each in asked)
        cells = gathered((each.enclave, (SHORT[each.operation], kind)) for each, kind in kinds if kind)
        if cells:
            yield name, tuple((path, tuple(words)) for path, words in cells.items())


def _routed_kind(answer: RoutedAnswer) -> str:
    if answer.works.truth is Truth.YES:
        return "works"
    return {Truth.YES: "dropped", Truth.UNKNOWN: "open", Truth.NO: ""}[any_of((answer.works.truth, answer.could.truth))]


class _Drawing:
    """The matrices of one group of profiles."""

    def __init__(self, sheet: Sheet, group: Group, rows: Sequence[Row]) -> None:
        self._sheet, self._group = sheet, group
        self._cells = MAX_CELLS
        self._many = len(group.enclaves) > MAX_TOGETHER
        self._rows = folded_by_owner(rows) if self._many else rows
        self._done = rights(self._rows)

    def matrices(self) -> Mapping[str, Any]:
        """One for all enclaves, or those of each namespace, which stands for those that are alike."""
        spaces = grouped(sorted(self._group.enclaves, key=lambda path: (namespace(path), path)), namespace)
        if not self._many:
            return {"whole": self._matrix([column for paths in spaces.values() for column in self._columns(paths)])}
        kinds = grouped(spaces, lambda space: self._kind(space, spaces[space]))
        return {"whole": None, "spaces": [self._space(alike, spaces[alike[0]]) for alike in kinds.values()]}

    def _kind(self, space: str, paths: Sequence[str]) -> object:
        """What its enclaves may do, with the namespace's own name taken out: equal for robots that are alike."""
        own = f"{space}/"
        kind = []
        for path in paths:
            enclave = self._group.enclaves[path]
            done = ((self._rows[number], words) for number, words in self._done.get(path, ()))
            may = ((row.label.replace(own, "\0"), row.sort, row.safeguards, words) for row, words in done)
            kind.append((path.removeprefix(own), enclave.usable, enclave.reasons, frozenset(may)))
        return tuple(kind) if space else (space, *kind)

    def _space(self, alike: Sequence[str], paths: Sequence[str]) -> Mapping[str, Any]:
        columns = self._columns(paths)
        starts = range(0, len(columns), MAX_COLUMNS)
        return {
            "names": [f"{space}/" for space in alike],
            "enclaves": len(paths),
            "kinds": len(columns),
            "matrices": [self._matrix(columns[start : start + MAX_COLUMNS]) for start in starts],
        }

    def _columns(self, paths: Sequence[str]) -> list[Mapping[str, Any]]:
        """Enclaves that are alike together, unless there are few; each leads to its information flow."""

        def kind(path: str) -> object:
            enclave = self._group.enclaves[path]
            said = self._sheet.report.meant
            told = (f"{each.get(path)}" for each in (said.beyond, said.lacking)) if said is not None else ()
            done = tuple(self._done.get(path, ()))
            return (enclave.usable, enclave.reasons, done, *told) if self._many else path

        return [
            {
                "paths": alike,
                "short": alike[0].rpartition("/")[2] or "/",
                "number": self._sheet.numbers.get(alike[0]),
                "usable": self._group.enclaves[alike[0]].usable.value,
                "reasons": self._group.enclaves[alike[0]].reasons,
            }
            for alike in grouped(paths, kind).values()
        ]

    def _matrix(self, columns: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
        """As many rows as there is room for, the least protected first: that is what a reader looks for."""
        wanted = {number for column in columns for number, _words in self._done.get(column["paths"][0], ())}
        every = sorted(worth_showing(self._rows, wanted), key=_protection)
        rows = every[: min(MAX_ROWS, self._cells // len(columns))]
        self._cells -= len(rows) * len(columns)
        spaces = [(space, len([*each])) for space, each in groupby(namespace(column["paths"][0]) for column in columns)]
        return {
            "columns": columns,
            "spaces": spaces if len(spaces) > 1 or self._many else (),
            "bodies": [
                (protected(each[0].safeguards), words, each)
                for (_rank, words), each in grouped(rows, _protection).items()
            ],
            "left_out": len(every) - len(rows),
        }


def _protection(row: Row) -> tuple[int, str]:
    return protected(row.safeguards).rank, protection_words(row.safeguards)


_STARTS: Final = {
    Truth.YES: ("✓", "starts"),
    Truth.NO: ("✗", "does not start"),
    Truth.UNKNOWN: ("?", "unknown"),
}


def profiles(sheet: Sheet, rows: Sequence[Mapping[str, Any]], table: AccessTable | None) -> Mapping[str, Any]:
    """What differs as a table, profiles that always answer alike in one column, and in access in sentences."""
    shown = rows[:MAX_DIFFERENT]
    columns = {profile: tuple(row["answers"][number] for row in shown) for number, profile in enumerate(sheet.profiles)}
    return {
        "rows": shown,
        "left_out": len(rows) - len(shown),
        "columns": [
            {"answers": answers, "profiles": alike} for answers, alike in grouped(columns, columns.__getitem__).items()
        ],
        "access": [*_in_access(table)] if table is not None else (),
    }


def differing(sheet: Sheet) -> Iterator[Mapping[str, Any]]:
    """What is not answered alike under all profiles: who starts, what holds, and what was found."""
    for entry in sheet.report.enclaves:
        usable = [entry.profiles[profile].usable for profile in sheet.profiles]
        if len(set(usable)) > 1:
            yield {"enclave": entry.path, "property": "", "answers": [_STARTS[each] for each in usable]}
    for result in sheet.report.properties:
        statuses = [result.profiles[profile].status for profile in sheet.profiles if profile in result.profiles]
        if len(set(statuses)) > 1 and len(statuses) == len(sheet.profiles):
            yield {"enclave": "", "property": result.prop.statement, "answers": statuses}
    first: dict[str, Finding] = {}
    found: dict[tuple[str, tuple[str, ...]], int] = {}
    for finding in sheet.shown:
        under = tuple(profile for profile in sheet.profiles if profile in finding.profiles)
        if finding.suppressed is None and 0 < len(under) < len(sheet.profiles):
            found[finding.code, under] = found.get((finding.code, under), 0) + 1
            first.setdefault(finding.code, finding)
    for (code, under), number in found.items():
        has, none = ("✗", counted(number, "finding")), ("✓", "none")
        answers = [has if profile in under else none for profile in sheet.profiles]
        yield {"enclave": "", "property": "", "finding": first[code], "answers": answers}


def _in_access(table: AccessTable) -> Iterable[tuple[str, Sequence[str]]]:
    *others, main = table.groups
    return [(", ".join(group.profiles), [*differences(table, group, main)]) for group in others]


def certificates(issued: Issuance) -> Mapping[str, Any]:
    """Who vouches for whom: roots first, and of these those that vouch for somebody."""
    certificates = issued.certificates
    roots = [number for number, each in enumerate(certificates) if each.is_root]
    if not roots:  # authorities that issued each other
        roots = [number for number, each in enumerate(certificates) if each.issued][:1]
    return {
        "certificates": certificates,
        "roots": sorted(roots, key=lambda number: not certificates[number].issued and not certificates[number].signed),
        "roles": _roles,
        "unsigned": (
            (issued.unsigned, "whose signature none of these certificates made"),
            (issued.unread, "of which it cannot be told who signed"),
        ),
    }


def _roles(certificate: IssuedCertificate) -> str:
    """What it is for; a certificate for both roles of a CA is said to be."""
    identity, permissions = certificate.identity_ca_of, certificate.permissions_ca_of
    roles = []
    if identity and permissions:
        roles.append(f"one CA for identities and permissions, of {counted(identity, 'enclave')}")
    elif identity or permissions:
        kind = "identity" if identity else "permissions"
        roles.append(f"{kind} CA of {counted(identity or permissions, 'enclave')}")
    own = certificate.identity_of
    if own:
        roles.append("identity" if len(own) == 1 else f"identity of {len(own)} enclaves: {', '.join(own[:4])}")
    return " · ".join(roles)


def rankings(rankings: Sequence[Ranking]) -> Sequence[Mapping[str, Any]]:
    """What follows from the loss of each enclave's key, the worst first; that of the most profiles first."""
    return [_ranking(each) for each in rankings[:MAX_RANKINGS]]


def _ranking(ranking: Ranking) -> Mapping[str, Any]:
    """Enclaves with the same numbers together, where there are many."""
    few = MAX_RANKED + 2
    rows = [[each] for each in ranking.enclaves]
    if len(rows) > few:
        rows = [*grouped(ranking.enclaves, lambda each: replace(each, path="")).values()]
    seen = len(rows) if len(rows) <= few else MAX_RANKED
    return {
        "profiles": ", ".join(ranking.profiles),
        "most": max((each.enclaves_reached for each in ranking.enclaves), default=0),
        "seen": rows[:seen],
        "rest": rows[seen:MAX_ROWS],
        "rest_count": sum(map(len, rows[seen:])),
        "left_out": sum(map(len, rows[MAX_ROWS:])),
        "endless": any(each.endless for each in ranking.enclaves),
    }
