"""The finished report: a value that every format renders and none computes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from enum import Enum
from itertools import chain
from typing import TYPE_CHECKING, Final

from msgspec import Struct, field

from keystore_audit.assumptions import CONDITIONS, Assumption, Needed, holds_if
from keystore_audit.findings import Finding, Outcomes, Severity
from keystore_audit.given import GivenFile
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.question import Usability
from keystore_audit.profiles import VARIANTS, Evidence, Profile
from keystore_audit.properties.result import EngineRun, EngineStatus, PropertyResult, Status
from keystore_audit.text import counted, shorten

if TYPE_CHECKING:  # most reports draw nothing
    from keystore_audit.model.blast_radius import Ranking
    from keystore_audit.model.intended.meant import Meant
    from keystore_audit.model.tables.overview import Overview
    from keystore_audit.zenoh.answers import RoutedTable


def conditions_of(results: Iterable[PropertyResult]) -> tuple[Needed, ...]:
    """What those results need that hold: the conditions first."""
    holding = [result for result in results if result.status is Status.HOLDS]
    found: list[Needed] = []
    for each in dict.fromkeys((*CONDITIONS, *Assumption)):
        needing = [result for result in holding if each in result.needs]
        under = dict.fromkeys(n for r in needing for n, answer in r.profiles.items() if each in answer.needs)
        if needing:
            needed_by = tuple(result.prop.id for result in needing)
            found.append(Needed(assumption=each, needed_by=needed_by, unchecked=_unchecked(each, under)))
    return tuple(found)


def answered_if(profiles: Iterable[str], conditions: Iterable[Assumption] = CONDITIONS) -> tuple[Needed, ...]:
    """What a "no" under some of these profiles rests on."""
    names = tuple(profiles)
    needed = (Needed(assumption=each, unchecked=_unchecked(each, names)) for each in conditions)
    return tuple(each for each in needed if each.unchecked or each.assumption is not Assumption.TRUTHFUL_ANNOUNCEMENTS)


def _unchecked(assumption: Assumption, profiles: Iterable[str]) -> tuple[str, ...]:
    """The implementations among them that check it of nobody, by the names of their families."""
    asked = profiles if assumption is Assumption.TRUTHFUL_ANNOUNCEMENTS else ()
    trusting = [VARIANTS[n].title for n in asked if n in VARIANTS and VARIANTS[n].trust.trusts_declarations]
    return tuple(dict.fromkeys(title.rpartition(" ")[0] for title in trusting))


MIXED: Final = "mixed DDS fleets"
OTHERWISE_MIXED: Final = "Fleets that are mixed otherwise than [enclaves] declares."
"""What is not looked at of them where some are declared."""

NOT_CHECKED: Final = {
    MIXED: (
        "Robots of several DDS implementations together: each profile is judged as if all ran it. What one sends and "
        "another accepts may be more than either alone."
    ),
    "file ownership": (
        "Who may write the files and directories, apart from their modes here: owners, groups, access control lists, "
        "folders above. Who can write them on a robot can replace authorities and documents."
    ),
    "what handshakes tell listeners": (
        "What participants tell whoever listens: their enclave's name in clear, and in the handshake the whole "
        "permissions document (DDS-Security 1.1, 8.3 and 9.3.2)."
    ),
    "node code": (
        "What nodes do with their rights: a flow counts where rights let it pass, unless settings say what a node "
        "forwards."
    ),
    "documents kept elsewhere": (
        "Signed documents that are kept elsewhere than in this directory, or in archives in it, though peers take "
        "whatever valid document is presented to them."
    ),
    "flows nobody asked about": (
        "Flows that no property of the settings asks about, and signals without data: timing, acknowledgements, "
        "matching."
    ),
}
"""What this version does not look at, each behind a few words for it."""

MAX_RANKED: Final = 100
"""Enclaves up to which every report ranks them; a page for people has more."""


PEERS_IN_SCOPE: Final = "every robot in the domain runs what the scope names"
"""What a verdict about less than everything rests on."""


class Verdict(str, Enum):
    """The audit's answer: pass (exit code 0), fail (1), incomplete (4)."""

    PASS = "pass"  # noqa: S105 - a verdict, not a password
    FAIL = "fail"
    INCOMPLETE = "incomplete"


WORST_FIRST: Final = (Verdict.INCOMPLETE, Verdict.FAIL, Verdict.PASS)
STATUSES: Final = (Status.UNKNOWN, Status.VIOLATED, Status.HOLDS)
"""Of properties, the worst first too."""


class EnclaveEntry(Struct, frozen=True, kw_only=True):
    """An enclave in the report; `subject` is its certificate's, None where unreadable.

    `profiles` by canonical name.
    """

    path: str
    directory: str
    subject: str | None
    profiles: Mapping[str, Usability]


class Anchor(Struct, frozen=True, kw_only=True):
    """A trusted authority; `sha256` of the certificate and `key` of its public key (SubjectPublicKeyInfo)."""

    subject: str
    path: str
    sha256: str
    key: str


class Anchors(Struct, frozen=True, kw_only=True):
    """Who is trusted in a role (`identity` or `permissions`): the fingerprints `declared` and the authorities `here`.

    These are those of the CA files that were declared; where none were, the one found.
    """

    role: str
    declared: tuple[str, ...]
    here: tuple[Anchor, ...]


def none_here(anchors: Anchors) -> str:
    """Why no authority of a role is listed."""
    declared = ", ".join(f"sha256:{each}" for each in anchors.declared)
    return f"none of those declared is here ({declared})" if declared else "none that can be told"


class Checked(Struct, frozen=True, kw_only=True):
    """What was looked at, and what was not: the last lines of a report.

    Counts of what was read; `rules`: how many rules ran; `not_checked`: sentences.
    """

    certificates: int
    documents: int
    channels: int
    rules: int
    not_checked: tuple[str, ...]


class NoReport(Struct, frozen=True, kw_only=True):
    """A keystore, or a directory that may hold some, of which there is no report, beside others that have one.

    `reason`: why, raw text. `exit_code`: what it alone makes the run exit with, never 0.
    """

    path: str
    reason: str
    exit_code: int


class Report(Struct, frozen=True, kw_only=True):
    """One audited keystore (interface contract: docs/reference.md, `schemas/report.schema.json`).

    `at` and `safe_until` are aware UTC; `safe_until` is the first later instant at which a verdict or
    usability changes and `safe_until_why` says what changes then. `fail_on` None: never. `findings` are
    sorted, worst first.
    """

    version: str
    keystore: str
    layout: str
    digest: str
    at: datetime
    safe_until: datetime | None
    safe_until_why: str
    verdict: Verdict
    exit_code: int
    fail_on: Severity | None
    weakened: tuple[str, ...]
    assumptions: tuple[Needed, ...]
    stated: tuple[str, ...]
    """What options say of the robots, beside."""
    engines: tuple[EngineRun, ...]
    engines_agree: bool | None
    enclaves: tuple[EnclaveEntry, ...]
    properties: tuple[PropertyResult, ...]
    findings: tuple[Finding, ...]
    authorities: tuple[Anchors, ...]
    outcomes: Outcomes
    checked: Checked
    scope: str = ""
    """What the verdict is about, `Jazzy with Fast DDS 2.14`; empty: all that supported distributions ship."""
    network: str = ""
    """The folder of the files of sessions and routers that were audited too; empty: none."""
    others: tuple[str, ...] = ()
    """Variants that only enclaves run of which settings say so."""
    settings: GivenFile | None = None
    baseline: GivenFile | None = None
    inputs: tuple[tuple[str, GivenFile], ...] = ()
    """Other files that the audit was made with, each behind the option that led to it."""
    deployed: bool = False
    """Whether it was judged as a tree that goes on a robot."""
    domain: int | None = None
    """The only domain that robots use; None: any."""
    files: tuple[tuple[str, str], ...] = ()
    """Path (relative to the keystore) and SHA-256, in hexadecimal, of every file, by path."""
    uncovered: tuple[str, ...] = ()
    """Files and directories of which no digest holds what is in them: no statement speaks for all of the keystore."""
    excerpts: Mapping[tuple[str, int], str] = field(default_factory=dict)
    """Lines of signed documents, by path and number: those that findings of at least medium severity name first."""
    roots: tuple[str, ...] = ()
    """Further directories that links of the keystore might lead into."""
    unread_foreign: tuple[str, ...] = ()
    """Files of which nobody read what is in them, and that nobody accepted (`Keystore.unread_foreign`)."""
    overview: Overview | None = None
    """What pictures show; None where the audit was not asked for it."""
    routed: RoutedTable | None = None
    """What sessions let enclaves do; None where there is no `network`, nobody asked, or too many rights are named."""
    meant: Meant | None = None
    """What a policy and graphs say beside what is granted; None where none were named."""
    blast_radius: tuple[Ranking, ...] | None = None
    """Enclaves by what their keys open; None where there are more than MAX_RANKED and no page asks, none where it was
    too much work."""

    @property
    def authorities_declared(self) -> bool:
        """Whether somebody said of both roles who is trusted."""
        return all(each.declared for each in self.authorities)

    @property
    def summary(self) -> dict[Severity, int]:
        """Unsuppressed findings by severity, all five of them."""
        counts = dict.fromkeys(Severity, 0)
        for finding in self.findings:
            if finding.suppressed is None:
                counts[finding.severity] += 1
        return counts

    @property
    def holds_if(self) -> str:
        """The conditions of what holds, a line; empty where nothing holds under one."""
        needed = (each for each in self.assumptions if each.needed_by)
        return holds_if(each for each in needed if each.assumption in CONDITIONS)

    @property
    def failing(self) -> tuple[Finding, ...]:
        """Findings that fail the gate."""
        return tuple(finding for finding in self.findings if finding.fails(self.fail_on))

    @property
    def holding(self) -> tuple[PropertyResult, ...]:
        """Properties that hold under every profile."""
        return tuple(result for result in self.properties if result.status is Status.HOLDS)

    @property
    def answered(self) -> tuple[EngineRun, ...]:
        """Engines that gave answers."""
        return tuple(run for run in self.engines if run.status is EngineStatus.OK)

    @property
    def silent(self) -> tuple[EngineRun, ...]:
        """Engines that were asked, and did not answer."""
        return tuple(run for run in self.engines if run.status not in (EngineStatus.OK, EngineStatus.NOT_RUN))

    @property
    def accepted(self) -> tuple[Finding, ...]:
        """Findings that somebody accepts."""
        return tuple(finding for finding in self.findings if finding.suppressed is not None)

    def shown(self, least: Severity) -> tuple[Finding, ...]:
        """Findings of a severity or a worse one."""
        return tuple(finding for finding in self.findings if finding.severity.at_least(least))

    @property
    def given_files(self) -> tuple[tuple[str, GivenFile], ...]:
        """Every file beside the keystore that the audit was made with, each behind what it is."""
        set_by = (("settings", self.settings), ("baseline", self.baseline))
        return (*((what, file) for what, file in set_by if file is not None), *self.inputs)

    @property
    def judged_profiles(self) -> tuple[str, ...]:
        """The profiles that this audit judged under: of a keystore without enclaves, those of its properties."""
        judged = [entry.profiles for entry in self.enclaves] + [result.profiles for result in self.properties]
        return tuple(dict.fromkeys(name for profiles in judged for name in profiles))


class View(Struct, frozen=True, kw_only=True):
    """How to show a report; nothing here changes what it says.

    `width` in columns. `min_severity` hides findings below it, and the report says how many. `quiet`: the
    verdict and the causes that brought it about. `verbose`: all that is known.
    """

    width: int = 80
    color: bool = False
    quiet: bool = False
    verbose: bool = False
    min_severity: Severity = Severity.INFO


PLAIN: Final = View()


# What a report takes from the keystore while it is at hand: lines that findings show, and what was not looked at.


MAX_EXCERPT: Final = 200
"""Characters of a line."""


def excerpts(keystore: Keystore, findings: Sequence[Finding]) -> dict[tuple[str, int], str]:
    """The lines of signed documents that findings name first: nothing of a file in which a private key may be."""
    files = chain((keystore.layout.governance,), *(each.files.every for each in keystore.enclaves))
    documents = {each.place: each for each in files if each is not None and each.place.endswith(".p7s")}
    split: dict[str, list[bytes]] = {}
    found = {}
    for finding in findings:
        place = place_of(finding)
        if place is None or not finding.severity.at_least(Severity.MEDIUM):
            continue
        path, number = place
        file = documents.get(path)
        if file is None or file.content is None or file.holds_private_key:
            continue
        lines = split.get(path) or split.setdefault(path, file.content.split(b"\n"))
        line = lines[number - 1].decode("utf-8", "replace").strip() if number <= len(lines) else ""
        if line.startswith("<") and not line.startswith("<!"):  # of the XML, and of no signature, nor of a DTD
            found[place] = shorten(line, MAX_EXCERPT)
    return found


def place_of(finding: Finding) -> tuple[str, int] | None:
    """The path and the number of the line that the finding names first; None where it names none."""
    return next(((each.path, each.line) for each in finding.locations if each.line is not None), None)


def unread(keystore: Keystore) -> Iterator[str]:
    """Files that were not read, and what no digest speaks of."""
    files = keystore.unread_foreign
    if files:
        yield (
            f"{counted(len(files), 'file')} that could not be read and that nobody accepted, {files[0].place} first. "
            "This report holds if they contain no key, certificate or document. No statement passes."
        )
    uncovered = keystore.uncovered
    if uncovered:
        yield (
            f"{len(uncovered)} files or directories are in no digest, {uncovered[0]} first: they could not be read or "
            "are too large. A later change there changes no digest. No statement passes."
        )


def untested(profiles: Sequence[Profile]) -> Iterator[str]:
    """How the profiles are known whose rows this project's tests do not ask the real implementation about."""
    measured = [profile.name for profile in profiles if profile.evidence is Evidence.MEASURED]
    read = [profile.name for profile in profiles if profile.evidence is Evidence.READ and profile.name != "spec"]
    if measured:
        yield (
            f"Whether {', '.join(measured)} still do what was measured once on each release: the tool's tests do not "
            "ask them (docs/profiles.md)."
        )
    if read:
        yield f"Whether {', '.join(read)} do what their source says (docs/profiles.md)."
