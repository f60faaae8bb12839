"""What is odd about the rules of a keystore's documents, each as the chosen implementations read it.

`anomalies.rules`: rules that never fire, that change nothing, or whose order decides. `anomalies.expressions`:
expressions that no name matches. `anomalies.counterparts`: topics with nobody at the other end. `anomalies.governance`:
governance rules that apply to nothing. Compared are the rules as peers take them, since rights come from these. Of an
implementation's further checks on its own endpoints, only this counts: whether a rule without effect on peers has one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import GovernanceFile
from keystore_audit.model.access_view import AccessViews, ReadDocument
from keystore_audit.model.anomalies.anomaly import Anomaly, AnomalyKind, Effort
from keystore_audit.model.anomalies.governance import Counterparts, governance_anomalies
from keystore_audit.model.anomalies.grants import (
    counterpart_anomalies,
    expression_anomalies,
    has_ordinary_rules,
    order_anomalies,
    ungoverned_rules,
)
from keystore_audit.model.anomalies.rules import Own
from keystore_audit.model.domains import domain_bits
from keystore_audit.model.inventory import Typed, documents_of
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.profiles import SPEC, Access, Profile, TopicCheck

_ORDER = {kind: number for number, kind in enumerate(AnomalyKind)}


class _Reading(Struct, frozen=True):
    """One way to read a document, and the profiles that read it so."""

    document: ReadDocument
    access: Access
    profiles: tuple[str, ...]


def anomalies(keystore: Keystore, profiles: Sequence[Profile], accesses: AccessViews) -> dict[str, tuple[Anomaly, ...]]:
    """The anomalies of every readable document by its place, by kind and line; places without any are left out.

    Where there is too much to compare, the document has one of kind NOT_WORKED_OUT beside what was found before.
    """
    return _Anomalies(keystore, profiles, accesses).found()


class _Anomalies:
    """The anomalies of one keystore in the making."""

    def __init__(self, keystore: Keystore, profiles: Sequence[Profile], accesses: AccessViews) -> None:
        self._accesses = accesses
        self._rows: dict[Access, tuple[str, ...]] = {}
        self._profiles = profiles
        self._chosen = frozenset(profile.name for profile in profiles)
        # What the specification makes of a denial tells whether it was meant: it is looked at beside the others.
        for profile in profiles if SPEC in profiles else (SPEC, *profiles):
            row = accesses.row(profile.access)
            self._rows[row] = (*self._rows.get(row, ()), profile.name)
        self._keystore = keystore
        self._files = [document.file for document in documents_of(keystore)]
        self._effort = Effort.of(len(self._files))
        self._governed = {row: self._governed_domains(row) for row in self._rows}

    def found(self) -> dict[str, tuple[Anomaly, ...]]:
        """The anomalies by place."""
        counterparts = self._counterparts()
        found = {}
        for file in self._files:
            if file is not None and (odd := self._of_file(file, counterparts)):
                found[file.signed.file.place] = odd
        return found

    def _counterparts(self) -> Counterparts | None:
        """None where nobody can be said to be missing: a document is unread, or there is only one enclave."""
        row = next(iter(self._rows), None)
        files = [file for file in self._files if file is not None]
        enclaves = self._keystore.enclaves
        if row is None or len(enclaves) < 2 or len(files) < len(self._files):
            return None
        if any(enclave.permissions is None for enclave in enclaves):
            return None
        read = [self._accesses.read(file, row) for file in files]
        if not all(document.is_readable for document in read):
            return None
        governances = [file for file in files if isinstance(file, GovernanceFile)]
        return Counterparts(read, governances, row.matcher, Effort.of(len(self._files)))

    def _governed_domains(self, row: Access) -> int | None:
        """The domains that some governance covers, as bits; None where one cannot be read."""
        if any(enclave.governance is None for enclave in self._keystore.enclaves):
            return None
        covered = 0
        for file in self._files:
            if isinstance(file, GovernanceFile):
                read = self._accesses.read(file, row)
                if read.domain_rules is None:
                    return None
                for rule in read.domain_rules:
                    covered |= domain_bits(rule.domains)
        return covered or None

    def _of_file(self, file: Typed, counterparts: Counterparts | None) -> tuple[Anomaly, ...]:
        readings = self._readings(file)
        everybody = tuple(name for reading in readings for name in reading.profiles)
        collected = _Collected(everybody, self._chosen)
        if isinstance(file, GovernanceFile):
            for each in readings:
                rules, matcher = each.document.domain_rules or (), each.access.matcher
                if len(rules) > 1 or any(len(rule.topic_rules) > 1 for rule in rules):
                    collected.add(each.profiles, governance_anomalies(rules, matcher, self._effort))
        elif readings:
            self._of_permissions(readings, collected, counterparts)
        return collected.all()

    def _readings(self, file: Typed) -> list[_Reading]:
        """The ways in which the chosen profiles read the document; equal ones are one."""
        found: list[_Reading] = []
        for row, names in self._rows.items():
            document = self._accesses.read(file, row)
            if document.is_readable:
                same = next((n for n, each in enumerate(found) if _is_same(each, document, row)), None)
                if same is None:
                    found.append(_Reading(document, row, names))
                else:
                    found[same] = replace(found[same], profiles=(*found[same].profiles, *names))
        return found

    def _of_permissions(
        self,
        readings: Sequence[_Reading],
        collected: _Collected,
        counterparts: Counterparts | None,
    ) -> None:
        asked = [reading for reading in readings if not self._chosen.isdisjoint(reading.profiles)]
        matchers = tuple(dict.fromkeys(reading.access.matcher for reading in asked))
        effort = self._effort
        for reading in readings:
            governed = self._governed[reading.access]
            alike = [profile for profile in self._profiles if profile.name in reading.profiles]
            own = Own(
                everywhere=not all(profile.local.binds_domains for profile in alike),
                any_operation=any(profile.access.topic_check is TopicCheck.FIRST_RULE for profile in alike),
            )
            for grant in _counting(reading.document.grants or ()):
                if not has_ordinary_rules(grant):
                    matcher = reading.access.matcher
                    collected.add(reading.profiles, order_anomalies(grant, matcher, effort, own))
                if governed is not None:
                    collected.add(reading.profiles, ungoverned_rules(grant, governed))
        for grant in _counting(readings[0].document.grants or ()) if asked else ():  # else each of them refuses it
            collected.add((), expression_anomalies(grant, matchers, effort))
            if counterparts is not None:  # what is missed there is of low severity
                collected.add((), counterpart_anomalies(grant, counterparts.missing(grant)), serious=False)


def _is_same(reading: _Reading, document: ReadDocument, row: Access) -> bool:
    """Whether two readings give the same rules; dates do not matter here."""
    known = reading.document
    if known is document:
        return True
    if reading.access.matcher is not row.matcher or known.domain_rules != document.domain_rules:
        return False
    ours, theirs = known.grants or (), document.grants or ()
    return len(ours) == len(theirs) and all(
        one.default_allow == other.default_allow and one.rules == other.rules
        for one, other in zip(ours, theirs, strict=True)
    )


def _counting(grants: Sequence[ReadGrant]) -> Iterator[ReadGrant]:
    """The first grant of each subject: later ones do not count, which has a rule of its own."""
    seen: set[str] = set()
    for grant in grants:
        subject = grant.grant.subject_name.text
        if subject not in seen:
            seen.add(subject)
            yield grant


class _Collected:
    """The anomalies of one document, each with the profiles under which it is one."""

    def __init__(self, everybody: tuple[str, ...], chosen: frozenset[str]) -> None:
        self._everybody = everybody
        self._chosen = chosen.intersection(everybody)
        self._found: dict[tuple[object, ...], tuple[Anomaly, set[str]]] = {}

    def add(self, profiles: tuple[str, ...], of: Iterator[Anomaly], *, serious: bool = True) -> None:
        """What `of` gives under the profiles (none given: under all of them).

        `serious`: whether something serious may be missed where it gives up.
        """
        names = profiles or self._everybody
        try:
            for anomaly in of:
                self._note(anomaly, names)
        except BudgetExceeded as exceeded:
            self._note(_not_worked_out(exceeded.message, serious=serious), names)

    def _note(self, anomaly: Anomaly, names: Sequence[str]) -> None:
        key = anomaly.kind, anomaly.subject, anomaly.key, anomaly.line
        self._found.setdefault(key, (anomaly, set()))[1].update(names)

    def all(self) -> tuple[Anomaly, ...]:
        """All of them, by kind and line. What is no denial to the specification is not seriously void to others."""
        made = []
        for anomaly, names in self._found.values():
            chosen = names & self._chosen
            meant = SPEC.name in names or SPEC.name not in self._everybody
            shown = tuple(name for name in self._everybody if name in chosen) if chosen < self._chosen else ()
            if chosen and (shown or (anomaly.serious and not meant)):
                made.append(replace(anomaly, profiles=shown, serious=anomaly.serious and meant))
            elif chosen:
                made.append(anomaly)
        return tuple(sorted(made, key=lambda each: (_ORDER[each.kind], each.line or 0, each.subject, each.key)))


def _not_worked_out(why: str, *, serious: bool) -> Anomaly:
    return Anomaly(kind=AnomalyKind.NOT_WORKED_OUT, line=None, other_text=why, key=why, serious=serious)
