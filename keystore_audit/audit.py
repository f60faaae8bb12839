"""The pipeline: read, interpret, decide, judge, report."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Protocol
from zoneinfo import ZoneInfo

from keystore_audit import __version__
from keystore_audit.engine.agreement import combine, combine_claims, combine_determinism
from keystore_audit.engine.engines import run_engines
from keystore_audit.engine.horizon import Horizon, horizon
from keystore_audit.engine.label_answers import with_label_answers
from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Finding, Result, Severity
from keystore_audit.intent.environment import Environment, read_environment
from keystore_audit.intent.intent import Intent
from keystore_audit.intent.observed import read_observed
from keystore_audit.keystore.identity import Identity
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.meaning import Meaning
from keystore_audit.model.profiles import DEFAULT, Profile, resolve, running
from keystore_audit.model.usability import Usabilities
from keystore_audit.properties import Status
from keystore_audit.properties.result import AlloyResult, EngineRun, EngineStatus
from keystore_audit.report.content import (
    ASSUMPTIONS,
    NOT_CHECKED,
    EnclaveEntry,
    Report,
    Scope,
    SettingsFile,
    Verdict,
)
from keystore_audit.report.not_checked import unread, untested
from keystore_audit.rules import BY_CODE, RULES
from keystore_audit.rules.context import Context
from keystore_audit.rules.judge import Judgement, judge
from keystore_audit.suppressions import MAX_DAYS, Acceptance, accepted_by, check_codes, check_dates, first_end, limited

if TYPE_CHECKING:
    from keystore_audit.engine.alloy.user_file import UserFile
    from keystore_audit.intent.policy import Policy
    from keystore_audit.model.drift import Drift
    from keystore_audit.model.observed import Observation
    from keystore_audit.model.wiring import WiredNode
    from keystore_audit.settings import Baseline, Settings

DEFAULT_NOTICE = timedelta(days=30)
"""How long before it ends a validity is a finding."""


class Progress(Protocol):
    """Told how far an audit is."""

    def stage(self, name: str) -> None:
        """A new stage begins."""

    def enclaves(self, done: int, total: int) -> None:
        """So many enclaves are read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What an audit is asked (interface contract: docs/reference.md).

    `at` is aware UTC; `fail_on` None: never. `launch_arguments`: values of arguments of the launch files. `overview`:
    whether the report is to hold what pictures show.
    """

    at: datetime
    at_given: bool = False
    profiles: tuple[str, ...] = ()
    domain: int | None = None
    time_zone: ZoneInfo | None = None
    policy: Path | None = None
    policy_include: Path | None = None
    """The directory below which the policy may include files; None: its own."""
    engine: str = "auto"
    offline: bool = False
    alloy_jar: Path | None = None
    timeout: float = 120.0
    fail_on: Severity | None = Severity.HIGH
    expires_within: timedelta = DEFAULT_NOTICE
    deployed: bool = False
    select: tuple[str, ...] = field(default=())
    ignore: tuple[str, ...] = field(default=())
    settings: Settings | None = None
    baseline: Baseline | None = None
    environment: Path | None = None
    """The file of variables that the robots start with: profile and domain are taken from it where not given."""
    graphs: tuple[Path, ...] = ()
    launches: tuple[Path, ...] = ()
    launch_arguments: Mapping[str, str] = field(default_factory=dict)
    alloy_properties: tuple[UserFile, ...] = ()
    overview: bool = False
    blast_radius: bool = False


def audit(
    path: str | os.PathLike[str],
    options: Options,
    *,
    progress: Progress | None = None,
    elsewhere: Sequence[Identity] | None = None,
) -> Report:
    """Audits the keystore at `path`; `elsewhere`: the identities of other keystores, to be compared with its own.

    Of those, the ones that may be its own too are enough; None: there are no other keystores.

    Raises errors.NothingToAudit where there is none, errors.UsageError for an unknown profile, for a graph or launch
    file that is none, or for findings that are accepted for too long. Whatever is wrong with the keystore or an engine
    is in the report.
    """
    environment = read_environment(options.environment) if options.environment is not None else None
    if environment is not None:
        options = _as_started(options, environment)
    profiles = resolve(options.profiles)
    acceptances = _acceptances(options)
    policy = _policy(options)
    intents = read_observed(options.graphs, options.launches, options.launch_arguments)
    claims = options.settings.claims if options.settings else ()
    declared = options.settings.declared if options.settings else None
    keystore = read_keystore(path, progress=progress.enclaves if progress else None)
    if progress:
        progress.stage("working out what the documents mean")
    accesses = AccessViews(documents_of(keystore), options.at, options.time_zone)
    usabilities = Usabilities(options.domain, accesses)
    meaning = interpret(
        keystore,
        profiles,
        options.at,
        accesses,
        usabilities,
        options.domain,
        claims,
        [place for file in options.alloy_properties for place in file.places],
        declared,
        _nodes(options, intents, policy, keystore),
    )
    native = NativeEngine(meaning.systems)
    runs, answers = run_engines(
        native,
        choice=options.engine,
        jar=options.alloy_jar,
        offline=options.offline,
        timeout=options.timeout,
        stage=progress.stage if progress else None,
    )
    names = [profile.name for profile in profiles]
    asserted = with_label_answers(claims, combine_claims(claims, meaning.systems, answers, names)) if claims else ()
    determined = combine_determinism(declared.claims, meaning.systems, answers, names) if declared else ()
    in_alloy = _in_alloy(options, meaning, runs, names, progress)
    context = Context(
        keystore=keystore,
        meaning=meaning,
        drift=_drift(keystore, policy, options, profiles, accesses) if policy is not None else None,
        results=(*combine(meaning.systems, answers, names), *asserted, *determined, *in_alloy),
        engines=runs,
        at=options.at,
        expires_within=options.expires_within,
        deployed=options.deployed,
        profiles=profiles,
        elsewhere=None if elsewhere is None else tuple(elsewhere),
        environment=environment,
        observed=_compared(intents, keystore, profiles, accesses, options),
        acceptances=acceptances,
    )
    judgement = judge(context, RULES, select=options.select, ignore=options.ignore)
    safe = horizon(keystore, native, profiles, options.at, accesses, usabilities, meaning.usability)
    report = _report(context, judgement, _while_accepted(safe, judgement, options.fail_on), options)
    return _drawn(report, context, accesses, options)


def _drawn(report: Report, context: Context, accesses: AccessViews, options: Options) -> Report:
    """The report with what no verdict rests on, where it is asked for: half as much work again, each."""
    if not (options.blast_radius or options.overview):
        return report
    from keystore_audit.model import blast_radius, overview

    about, systems = (context.keystore, context.profiles, options.at, accesses), context.meaning.systems
    ranked = blast_radius.ranked_enclaves(*about) if options.blast_radius and systems else None
    seen = overview.overview(*about, options.domain, systems) if options.overview else None
    return replace(report, blast_radius=ranked, overview=seen)


def _while_accepted(safe: Horizon, judgement: Judgement, fail_on: Severity | None) -> Horizon:
    """The horizon, sooner where a finding that would fail this gate is accepted until then."""
    ends = first_end(finding for finding in judgement.findings if fail_on and finding.severity.at_least(fail_on))
    if ends is None or (safe.instant is not None and safe.instant <= ends):
        return safe
    return replace(safe, instant=ends, why="a finding that is accepted until then counts again")


def _acceptances(options: Options) -> tuple[Acceptance, ...]:
    """The findings that the settings and the baseline accept; raises errors.UsageError for what cannot be accepted."""
    given = options.settings.acceptances if options.settings else ()
    check_codes(given, BY_CODE)
    given = limited(given, {code: rule.severity for code, rule in BY_CODE.items()})
    acceptances = (*given, *(options.baseline.acceptances if options.baseline else ()))
    check_dates(acceptances, options.at, options.settings.max_suppression_days if options.settings else MAX_DAYS)
    return acceptances


def _as_started(options: Options, environment: Environment) -> Options:
    """The options with the profiles and the domain of the environment, where none were given."""
    shipped = running(environment.value("ROS_DISTRO"), environment.value("RMW_IMPLEMENTATION"))
    return replace(
        options,
        profiles=options.profiles or shipped,
        domain=environment.domain if options.domain is None else options.domain,
    )


def _compared(
    intents: Sequence[Intent],
    keystore: Keystore,
    profiles: Sequence[Profile],
    accesses: AccessViews,
    options: Options,
) -> Observation | None:
    """What graphs and launch files show, held against the keystore; None where there are none."""
    if not intents:
        return None
    from keystore_audit.model.observed import observe

    return observe(intents, keystore, profiles, options.at, accesses, options.domain)


def _nodes(
    options: Options, intents: Sequence[Intent], policy: Policy | None, keystore: Keystore
) -> tuple[WiredNode, ...]:
    """The nodes and their wiring: for users' files alone, since nothing else asks."""
    if not options.alloy_properties or not (intents or policy):
        return ()
    from keystore_audit.model.wiring import wiring

    return wiring((*intents, *((policy.intent,) if policy else ())), keystore.layout.kind)


def _in_alloy(
    options: Options, meaning: Meaning, engines: Sequence[EngineRun], names: Sequence[str], progress: Progress | None
) -> tuple[AlloyResult, ...]:
    """What Alloy says of the users' files; raises errors.UsageError for what it refuses."""
    if not options.alloy_properties:
        return ()
    from keystore_audit.engine.alloy.user_properties import decide_files

    return decide_files(
        options.alloy_properties,
        meaning.systems,
        names,
        engines,
        jar=options.alloy_jar,
        offline=options.offline,
        timeout=options.timeout,
        stage=progress.stage if progress else None,
    )


def _report(context: Context, judgement: Judgement, safe: Horizon, options: Options) -> Report:
    verdict, exit_code = _verdict(judgement.findings, options.fail_on, complete=_complete(context, judgement))
    answered = [run for run in context.engines if run.status is EngineStatus.OK]
    agree = all(result.engines_agree for result in context.results)
    return Report(
        version=__version__,
        keystore=context.keystore.root,
        layout=context.keystore.layout.kind.value,
        digest=context.keystore.digest,
        at=options.at,
        safe_until=safe.instant,
        safe_until_why=safe.why,
        verdict=verdict,
        exit_code=exit_code,
        fail_on=options.fail_on,
        weakened=(*_weakened(options, context.profiles), *accepted_by(judgement.findings)),
        assumptions=ASSUMPTIONS,
        engines=context.engines,
        engines_agree=agree if len(answered) > 1 else None,
        enclaves=_enclaves(context),
        properties=context.results,
        findings=judgement.findings,
        outcomes=judgement.outcomes,
        scope=_scope(context),
        files=context.keystore.contents,
        settings=_settings(options.settings),
        baseline=_settings(options.baseline),
    )


def _policy(options: Options) -> Policy | None:
    """The policy; raises errors.UsageError for what is none."""
    if options.policy is None:
        return None
    from keystore_audit.intent.policy import read_policy  # an audit without a policy needs no reader

    return read_policy(options.policy, options.policy_include)


def _drift(
    keystore: Keystore, policy: Policy, options: Options, profiles: Sequence[Profile], accesses: AccessViews
) -> Drift:
    """The keystore compared with the policy."""
    from keystore_audit.model.drift import drift

    return drift(keystore, policy, profiles, options.at, accesses, options.domain)


def _settings(given: Settings | Baseline | None) -> SettingsFile | None:
    return None if given is None else SettingsFile(path=given.path, sha256=given.sha256)


def _complete(context: Context, judgement: Judgement) -> bool:
    """Whether everything was decided. Each way in which it was not is looked at by itself, whatever the rules say."""
    meaning = context.meaning
    return (
        bool(context.results)
        and not meaning.doubts
        and meaning.over_budget is None
        and all(run.status is EngineStatus.OK for run in context.engines if run.required)
        and all(result.status is not Status.UNKNOWN for result in context.results)
        and all(outcome.outcome is not Result.OPEN for outcome in judgement.outcomes)
    )


def _verdict(findings: Sequence[Finding], fail_on: Severity | None, *, complete: bool) -> tuple[Verdict, int]:
    """Incomplete outranks fail: what could not be decided is never a pass, and hides nothing that was found."""
    if not complete:
        return Verdict.INCOMPLETE, 4
    failing = fail_on is not None and any(
        finding.suppressed is None and finding.severity.at_least(fail_on) for finding in findings
    )
    return (Verdict.FAIL, 1) if failing else (Verdict.PASS, 0)


def _weakened(options: Options, profiles: Sequence[Profile]) -> tuple[str, ...]:
    """What makes this gate laxer than the default one."""
    weakened = []
    if options.fail_on is None or not Severity.HIGH.at_least(options.fail_on):
        weakened.append(f"--fail-on {options.fail_on.value if options.fail_on else 'never'}")
    weakened += [f"--ignore {code}" for code in options.ignore]
    weakened += [f"--select {code}" for code in options.select]
    if not {profile.name for profile in profiles}.issuperset(DEFAULT):
        weakened += [f"--profile {name}" for name in options.profiles]
    if options.expires_within < DEFAULT_NOTICE:
        weakened.append(f"--expires-within {options.expires_within.days}")
    if options.settings is not None and options.settings.max_suppression_days > MAX_DAYS:
        weakened.append(f"max_suppression_days = {options.settings.max_suppression_days} in {options.settings.path}")
    if options.at_given:
        weakened.append(f"--at {options.at:%Y-%m-%dT%H:%M:%SZ}")
    return tuple(weakened)


def _enclaves(context: Context) -> tuple[EnclaveEntry, ...]:
    entries = []
    for enclave in context.keystore.enclaves:
        first = enclave.certificate.first if enclave.certificate else None
        directory = enclave.files.directory
        entries.append(
            EnclaveEntry(
                path=enclave.path,
                directory=directory,
                subject=first.subject if first else None,
                profiles={p.name: context.meaning.usability[directory, p.name] for p in context.profiles},
            )
        )
    return tuple(entries)


def _scope(context: Context) -> Scope:
    meaning = context.meaning
    system = meaning.systems[0] if meaning.systems else None
    return Scope(
        certificates=len(system.certificates) if system else 0,
        documents=len(system.documents) if system else 0,
        channels=len(system.channels) if system else 0,
        rules=len(RULES),
        not_checked=(
            *meaning.idle,
            *unread(context.keystore),
            *untested(context.profiles),
            *NOT_CHECKED,
            *_not_compared(context),
        ),
    )


def _not_compared(context: Context) -> Iterator[str]:
    """What the keystore is for, where nothing that says so was named."""
    if context.drift is None:
        yield "The policy that the keystore was generated from (--policy)."
    if context.observed is None:
        yield "The nodes that will use the keystore (--graph, --launch)."
