"""What the engines said of a property, per profile, and what became of each engine."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from enum import Enum
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.assumptions import Assumption
from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.blast_radius import BlastRadius, Ground
from keystore_audit.model.formal.flow import Leg
from keystore_audit.profiles import SubjectComparison, doing
from keystore_audit.text import some

# A counterexample in the user's names.


class Step(Struct, frozen=True, kw_only=True):
    """One thing that makes the counterexample possible, and the line that says so.

    `channel`: what is meant, in words (`domain 0, topic rt/chatter`); `witness`: a concrete DDS topic name
    (or enclave, certificate or document) of it. `path` and `line` as in `findings.Location`; `expression`: the
    one there that takes in the witness, where it is not the witness itself.
    """

    enclave: str | None
    channel: str | None
    witness: str
    path: str | None
    line: int | None
    expression: str = ""


class Counterexample(Struct, frozen=True, kw_only=True):
    """`text` is one sentence for people; untrusted names in it are not escaped yet."""

    text: str
    steps: tuple[Step, ...]


# A property: a named question that both engines answer about a `model.formal.system.System`.


class Role(str, Enum):
    """What an atom does in a counterexample; the value is the variable's name in the Alloy predicate."""

    TRUST_DOMAIN = "trust_domain"
    DOMAIN = "domain"
    ENCLAVE = "enclave"
    OTHER = "other"
    DOCUMENT = "document"
    CHANNEL = "channel"
    CERTIFICATE = "certificate"
    OTHER_CERTIFICATE = "other_certificate"
    OTHER_CHANNEL = "other_channel"
    PUBLISHER = "publisher"
    """An enclave, a certificate that no enclave has, or (none of both) anybody; a witness names what it is."""
    INSIDER = "insider"
    """Likewise."""
    WITH_IDENTITY = "with identity"
    """(native alone) Whether who violates it and has no name needs an identity of the CA: 1, or 0 for anybody."""


class Property(Struct, frozen=True, kw_only=True):
    """One question.

    `id` is also the name of its KA7 rule. `roles`: the quantified variables of its predicate, outermost first.
    `attacker`: who is meant to fail. `clause`: what it rests on.
    """

    id: str
    statement: str
    attacker: str
    clause: str
    roles: tuple[Role, ...]

    @property
    def predicate(self) -> str:
        """The same name in `alloy/properties.als`."""
        return "".join(word.capitalize() for word in self.id.split("-"))


class Status(str, Enum):
    """The answer to a property. UNKNOWN never counts as HOLDS."""

    HOLDS = "holds"
    VIOLATED = "violated"
    UNKNOWN = "unknown"


Witness = Mapping[Role, int]
"""A counterexample: the index of the atom that plays each role."""


Content = tuple[int | None, ...]
"""What each publishes, or what is in each slot (`model.formal.asked`): one of two values, None for nothing."""

Round = tuple[Content, Content]
"""What two runs that are compared publish in the same round, by writer."""


class Answer(Struct, frozen=True, kw_only=True):
    """One engine's answer about one system. `witnesses` is empty exactly where a property holds.

    An engine may give one witness or several, the most telling first; UNKNOWN only of determinism: within one reading
    everything else is decided. Of determinism: `rounds` are two runs that differ in the last one, in the behaviour of
    this index. Of a claim (`model.formal.asked`): `path` is a shortest flow that violates it, where its kind has
    flows. `moment`, where the engine says so, is the first at which it is violated. It is twice the index of an
    instant, plus one for the time between it and the next.
    """

    status: Status
    witnesses: tuple[Witness, ...] = ()
    path: tuple[Leg, ...] = ()
    moment: int | None = None
    rounds: tuple[Round, ...] = ()
    behaviour: int = 0


# What stolen keys open, per profile: the answer of `flow --from-compromised`.


class Stolen(str, Enum):
    """Whose private key it is."""

    ENCLAVE = "enclave"
    IDENTITY_CA = "identity-ca"
    PERMISSIONS_CA = "permissions-ca"


class ProfileRadius(Struct, frozen=True, kw_only=True):
    """The blast radius under one profile. `certain`: nothing of it depends on what could not be read."""

    radius: BlastRadius
    certain: bool


class KeyAnswer(Struct, frozen=True, kw_only=True):
    """Of one key. `name`: the enclave's path, or the subject of the authority; `location`: of its certificate.

    `with_an_enclave`: (permissions CA) of who holds the key of an enclave as well, whichever it is; else None.
    """

    stolen: Stolen
    name: str
    location: Location | None
    alone: Mapping[str, ProfileRadius]
    with_an_enclave: Mapping[str, ProfileRadius] | None


class CompromiseAnswer(Struct, frozen=True, kw_only=True):
    """What each key opens that `who` means: none where no such authority could be read.

    `enclaves`: how many there are. `doubts`: places of what could not be read, which an uncertain answer depends on.
    """

    who: str
    at: datetime
    include_ambient: bool
    ground: Ground
    enclaves: int
    keys: tuple[KeyAnswer, ...]
    doubts: tuple[Location, ...]
    declared: str = ""
    """What enclaves run that settings name."""

    @property
    def status(self) -> Status:
        """UNKNOWN where anything of it is uncertain; VIOLATED where a key opens anything of somebody else's."""
        found = [each for key in self.keys for part in (key.alone, key.with_an_enclave or {}) for each in part.values()]
        if not found or not all(each.certain for each in found):
            return Status.UNKNOWN
        return Status.VIOLATED if any(each.radius.beyond_itself for each in found) else Status.HOLDS


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

    `required`: it was asked for by name, or was started, so that its failure counts. `atoms`: the sizes of the
    largest model of the keystore, and of what the engine was asked about in its place. None where no model was made.
    """

    name: str
    version: str | None
    status: EngineStatus
    reason: str
    required: bool
    atoms: tuple[int, int] | None = None

    @property
    def failed(self) -> bool:
        """Whether it gave no answer, and one was needed."""
        return self.required and self.status is not EngineStatus.OK


class ProfileResult(Struct, frozen=True, kw_only=True):
    """The answer under one profile.

    UNKNOWN unless every engine that ran gives the same answer in both readings. `needs`: the fewest assumptions under
    which it holds (`engine/needs.py`); `survives_without`: the others that were made.
    """

    status: Status
    engines: Mapping[str, Status]
    counterexample: Counterexample | None
    needs: tuple[Assumption, ...] = ()
    survives_without: tuple[Assumption, ...] = ()


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
    def survives_without(self) -> tuple[Assumption, ...]:
        """What it does not need under some profile."""
        return tuple(dict.fromkeys(each for result in self.profiles.values() for each in result.survives_without))

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
        return f"These could pose as a permitted publisher: {'; '.join(told)}." if told else ""


FallResult = tuple[tuple[str, ...], AssertedResult]
"""Of a smallest set of participants, by their labels in order: that nothing gets through if they are compromised."""


class Right(NamedTuple):
    """An expression of allow rules of the document at `path`. `enclave`: who passes something on by it, by its path."""

    path: str
    line: int
    expression: str
    enclave: str


class Change(NamedTuple):
    """The rights to `take`, None where no such change was found. `keeps`: how many claims `able` hold as before."""

    take: tuple[Right, ...] | None
    keeps: int


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


# What fails on the way from one keystore to another: the answer of `diff --rolling`.


class Passage(Struct, frozen=True, kw_only=True):
    """A property that fails on the way, or (UNKNOWN) may fail, under these profiles.

    It does as soon as the enclaves of `updated` carry the files of NEW, while those of `waiting` carry those of OLD.
    `lasting`: it also does once all carry those of NEW, for as long as what was signed before is valid. `until`: the
    instant to which that may last (as grants have it, if they are why), and of which the example is. `reason`: why it
    is unknown, where there is more to say.
    """

    prop: Property
    status: Status = Status.UNKNOWN
    profiles: tuple[str, ...]
    updated: tuple[str, ...] = ()
    waiting: tuple[str, ...] = ()
    lasting: bool = False
    until: str | None = None
    example: Counterexample | None = None
    reason: str = ""


class RollingAnswer(Struct, frozen=True, kw_only=True):
    """What fails on the way. `changing`: enclaves of which it is free when. `passages`: by property, in order.

    `natively_alone`: where Alloy was asked, the claims about which it was not.
    """

    old: Keystore
    new: Keystore
    at: datetime
    profiles: tuple[str, ...]
    changing: tuple[str, ...]
    passages: tuple[Passage, ...]
    engines: tuple[EngineRun, ...]
    natively_alone: tuple[str, ...]

    @property
    def status(self) -> Status:
        """The worst of all: unknown, then violated, then holds."""
        statuses = {each.status for each in self.passages}
        if Status.UNKNOWN in statuses or any(each.failed for each in self.engines):
            return Status.UNKNOWN
        return Status.VIOLATED if statuses else Status.HOLDS
