"""What enclaves may do, asked by name: `can`, and whoever wants the answers as values."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

from keystore_audit.circumstances import Circumstances
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.channels import Point, governed_domains
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.domains import Interval
from keystore_audit.model.formal.rights import EffectiveRights
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.question import Answer, Question, Usability, joint
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import Profile, Release
from keystore_audit.truth import Truth

if TYPE_CHECKING:
    from pathlib import Path

    from keystore_audit.model.tables.access_table import AccessTable
    from keystore_audit.zenoh.answers import RoutedAnswers, RoutedTable


class Access:
    """The answers about one keystore to questions known beforehand.

    Raises errors.NothingToAudit where there is no keystore and
    errors.BudgetExceeded where it has more certificates and authorities than chains can be checked for.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        questions: Sequence[Question],
        given: Circumstances,
    ) -> None:
        keystore = given.keystore(path)
        self._profiles = given.profiles
        self._at = given.at
        self._enclave = cache(keystore.enclave)
        self._accesses = given.accesses(keystore)
        points: dict[Point, int] = {}
        for question in questions:
            points.setdefault(question.point, len(points))
        self._points = points
        builder = SystemBuilder(keystore, given.profiles, given.at, self._accesses, tuple(points))
        self._channels = builder.channels
        self._local = LocalRights(self._accesses, builder.channels, given.at)
        self._effective = EffectiveRights(builder.systems())
        self._usabilities = Usabilities(None, self._accesses)

    def enclave(self, path: str) -> Enclave:
        """The enclave of that path. Raises UsageError, with the nearest one, for an unknown path."""
        return self._enclave(path)

    def governed(self, path: str) -> tuple[Interval, ...]:
        """The domains that the enclave's governance covers; none where it was not read."""
        return governed_domains(self._accesses.by_row(self._profiles, [self.enclave(path).governance]))

    def answers(self, question: Question) -> Mapping[str, Answer]:
        """By profile. Raises UsageError for an unknown enclave."""
        enclave = self.enclave(question.enclave)
        channel = self._channels.of_point(question.domain, self._points[question.point])
        usabilities = self._usabilities.in_domain(question.domain)
        by_kind: dict[object, Answer] = {}
        answers = {}
        for profile in self._profiles:
            unclear = self._accesses.unclear_name(question.topic, question.partitions, profile)
            kind = (usabilities.kind(profile), unclear)  # profiles of one kind read everything here alike
            if kind not in by_kind:
                usability = usabilities.of(enclave, self._at, profile)
                by_kind[kind] = self._answer(enclave, question, channel, profile, usability, unclear)
            answers[profile.name] = by_kind[kind]
        return answers

    def joint(self, questions: Sequence[Question]) -> Mapping[str, Answer]:
        """By profile, one answer to whether all of it may be done: that of the channel which stands in the way."""
        each = [self.answers(question) for question in questions]
        return {
            profile.name: joint(questions, [answers[profile.name] for answers in each]) for profile in self._profiles
        }

    def _answer(
        self,
        enclave: Enclave,
        question: Question,
        channel: int,
        profile: Profile,
        usability: Usability,
        unclear: str | None,
    ) -> Answer:
        location: Location | None = None
        if unclear is not None and usability.usable.may:
            decision, reason = Truth.UNKNOWN, unclear
        elif usability.usable.must:
            local = self._local.decide(enclave, profile, question.operation, channel, question.point)
            decision, reason, location = Truth.YES if local.allow else Truth.NO, local.reason, local.location
        else:
            decision = usability.usable
            doubtful = "whether a participant starts cannot be told"
            known = doubtful if decision.may else "no participant starts"
            reason = f"{known}: {'; '.join(usability.reasons)}"
        accepted = self._effective.accepted(enclave.path, profile.name, question.operation)
        return Answer(
            usable=usability.usable,
            decision=decision,
            effective=accepted.holds(channel) if unclear is None else Truth.UNKNOWN,
            reason=reason,
            location=location,
        )


def routed(
    path: str | os.PathLike[str],
    words: tuple[str, str, str],
    folder: Path,
    given: Circumstances,
    releases: Sequence[Release],
) -> RoutedAnswers:
    """What the files of sessions and routers in the folder say: `words` are enclave, operation and a name of ROS 2.

    Raises UsageError for an unknown enclave, errors.NothingToAudit where there is no keystore or no such file.
    """
    from keystore_audit.zenoh.answers import Rights, RoutedAnswers, channels, plain
    from keystore_audit.zenoh.network import read_network

    keystore = given.keystore(path)
    named, operation, name = words
    enclave = keystore.enclave(named)
    rights, domain = Rights(read_network(folder, keystore, given.at)), given.domain or 0
    return RoutedAnswers(
        enclave=named,
        operation=operation,
        name=name,
        domain=domain,
        at=given.at,
        folder=os.fspath(folder),
        keys=tuple(plain(key) for _role, key in channels(operation, name, domain)),
        answers={each.name: rights.answer(enclave, operation, name, domain, each) for each in releases},
        doubts=rights.doubts,
    )


def routed_tables(
    sides: Sequence[tuple[str | os.PathLike[str], Path]], given: Circumstances, releases: Sequence[Release]
) -> tuple[RoutedTable, ...]:
    """What every enclave of each keystore may do by the files of its folder. It covers every topic and service that
    permissions and files of any of them name.

    Raises errors.NothingToAudit where there is no keystore or no such file, errors.BudgetExceeded for too many rights.
    """
    from keystore_audit.zenoh.answers import routed_table
    from keystore_audit.zenoh.names import Named, written_names
    from keystore_audit.zenoh.network import read_network

    domain = given.domain or 0
    keystores = [given.keystore(path) for path, _folder in sides]
    networks = [
        read_network(folder, keystore, given.at) for (_p, folder), keystore in zip(sides, keystores, strict=True)
    ]
    named = [written_names(*side, domain) for side in zip(keystores, networks, strict=True)]
    asked = tuple(dict.fromkeys(right for each in named for right in each.rights))
    return tuple(
        routed_table(keystore, network, Named(asked, names.patterns), domain, given.at, releases)
        for keystore, network, names in zip(keystores, networks, named, strict=True)
    )


def read_access_table(path: str | os.PathLike[str], given: Circumstances) -> AccessTable:
    """Who may do what in the keystore at `path`: every enclave, every name.

    Where no domain is known it is the lowest that some governance covers. Raises errors.NothingToAudit, or
    errors.BudgetExceeded where
    there are too many classes of names.
    """
    from keystore_audit.model.tables.access_table import TableBuilder  # single questions need none of it

    keystore = given.keystore(path)
    return TableBuilder(keystore, given.profiles, given.at, given.accesses(keystore), given.domain).table()
