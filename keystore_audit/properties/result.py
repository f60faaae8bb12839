"""What the engines said of a property, per profile, and what became of each engine."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Final

from msgspec import Struct

from keystore_audit.assumptions import Assumption
from keystore_audit.findings import Location, Severity
from keystore_audit.profiles import SubjectComparison, doing
from keystore_audit.properties.counterexample import Counterexample
from keystore_audit.properties.property import Property, Status
from keystore_audit.text import some

ANYBODY: Final = "anybody on the network"
"""Among those who could forge: whoever has no key."""

MAX_FORGERS: Final = 5
"""Those named who could forge; the rest are counted."""


class EngineStatus(str, Enum):
    """What became of an engine; only OK engines have answered."""

    OK = "ok"
    MISSING = "missing"
    FAILED = "failed"
    TIMEOUT = "timeout"
    OUT_OF_SCALE = "out_of_scale"
    NOT_RUN = "not_run"


class EngineRun(Struct, frozen=True, kw_only=True):
    """An engine and how it fared.

    `required`: it was asked for by name, or was started, so that its failure counts. `atoms`: the size of the largest
    model of the keystore, and of what the engine was asked about in its place; None where no model was made.
    """

    name: str
    version: str | None
    status: EngineStatus
    reason: str
    required: bool
    atoms: tuple[int, int] | None = None


class ProfileResult(Struct, frozen=True, kw_only=True):
    """The answer under one profile.

    UNKNOWN unless every engine that ran gives the same answer in both readings. `needs`: what has to be so for it to
    hold (`assumptions.CONDITIONS`).
    """

    status: Status
    engines: Mapping[str, Status]
    counterexample: Counterexample | None
    needs: tuple[Assumption, ...] = ()


class PropertyResult(Struct, frozen=True, kw_only=True):
    """A property and its answer under each chosen profile (canonical names).

    `violations`: what violates it and under which profile; of many, some. `vacuous`: what it speaks of does not exist,
    as some implementation reads the keystore (of users' own in Alloy).
    """

    prop: Property
    profiles: Mapping[str, ProfileResult]
    violations: tuple[str, ...] = ()
    vacuous: bool = False

    @property
    def status(self) -> Status:
        """The worst over the profiles: unknown, then violated, then holds."""
        statuses = {result.status for result in self.profiles.values()}
        if Status.UNKNOWN in statuses or not statuses:
            return Status.UNKNOWN
        return Status.VIOLATED if Status.VIOLATED in statuses else Status.HOLDS

    @property
    def needs(self) -> tuple[Assumption, ...]:
        """What has to be so for it to hold under all profiles."""
        return tuple(dict.fromkeys(each for result in self.profiles.values() for each in result.needs))

    @property
    def engines_agree(self) -> bool:
        """Whether, under every profile, all engines that answered gave the same answer."""
        return all(len(set(result.engines.values())) <= 1 for result in self.profiles.values())

    @property
    def beside(self) -> str:
        """What is to be known beside the answer, whichever it is: a sentence, mostly none."""
        return ""


class UserResult(PropertyResult, frozen=True, kw_only=True):
    """A property that a user asserts, and its answers. `location`: where it is asserted, beside the keystore.

    `meaning`: what is asserted, apart from its name and its words. `reason`: why it is unknown, where there is more to
    say: a sentence without its full stop. `breaches`: all that violates it, a text each, for telling one violation from
    another; None where that is not known.
    """

    severity: Severity
    location: Location
    meaning: str = ""
    reason: str = ""
    breaches: tuple[str, ...] | None = None


class AssertedResult(UserResult, frozen=True, kw_only=True):
    """One that the settings assert. `forgers`: where only some may publish a topic, who could pass for one of them with
    the keys they hold, ANYBODY last. `also_named`: by subject_name of a grant there, a subject that nobody here has and
    that Cyclone DDS takes it for; both None of other properties.
    """

    forgers: tuple[str, ...] | None = None
    also_named: Mapping[str, str] | None = None

    @property
    def beside(self) -> str:
        """Who could pass for a permitted publisher, and who may be one by a grant that tells another subject."""
        return " ".join(filter(None, (self._forging, self._named)))

    @property
    def _named(self) -> str:
        also = self.also_named or {}
        told = some((f"{subject} by the grant of {text}" for text, subject in also.items()), MAX_FORGERS)
        who = doing("subjects", SubjectComparison.PIECES_WITHIN, SubjectComparison.TRIMMED_PIECES_WITHIN)
        return f"{who} lets shorter subjects publish too, where there are such: {told}." if told else ""

    @property
    def _forging(self) -> str:
        named = [who for who in self.forgers or () if who != ANYBODY]
        told = [f"{some(named, MAX_FORGERS)}, with the keys they hold"] if named else []
        if self.forgers and ANYBODY in self.forgers:
            told.append(f"{ANYBODY}, without any key")
        return f"Could pass for a permitted publisher: {'; '.join(told)}." if told else ""


class AlloyResult(UserResult, frozen=True, kw_only=True):
    """One that a user asserts in Alloy, decided by Alloy alone; `location` is that of the command."""

    @property
    def beside(self) -> str:
        """That nothing was checked."""
        return "It holds of nothing: there is nothing that its `all` ranges over (vacuous)." if self.vacuous else ""


class LabelResult(UserResult, frozen=True, kw_only=True):
    """Whether what is labelled `source` stays away from what is labelled `target`; `location`: of the lattice."""

    source: str
    target: str
