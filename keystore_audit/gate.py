"""The gate: what is accepted, whether everything was decided, the verdict, and what makes it laxer than usual."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from msgspec.structs import replace

from keystore_audit.assumptions import EVERY, Assumption, Needed
from keystore_audit.engine.horizon import Horizon
from keystore_audit.engine.needs import taken_for_granted
from keystore_audit.errors import UsageError
from keystore_audit.findings import Finding, Result, Severity
from keystore_audit.given import GivenFile
from keystore_audit.intent.environment import DISTRIBUTION, DOMAIN, RMW, Environment
from keystore_audit.intent.intent import Intent, Origin
from keystore_audit.options import DEFAULT_NOTICE, Options
from keystore_audit.profiles import Profile, facts, implementations, resolve, running, scope_of
from keystore_audit.properties import Status
from keystore_audit.properties.result import EngineStatus
from keystore_audit.report.content import PEERS_IN_SCOPE, Verdict, answered_if, conditions_of
from keystore_audit.rules import BY_CODE
from keystore_audit.rules.judge import Judgement
from keystore_audit.rules.registry import Context
from keystore_audit.settings.suppressions import MAX_DAYS, Suppression, check_codes, check_dates, first_end, limited
from keystore_audit.text import shorten, terminal
from keystore_audit.zenoh.answers import rights_in

if TYPE_CHECKING:
    from keystore_audit.intent.policy import Policy

MAX_ARGUMENT: Final = 200
"""Characters of an argument of launch files in a report."""


def suppressions(options: Options) -> tuple[Suppression, ...]:
    """The findings that the settings and the baseline accept; raises errors.UsageError for what cannot be accepted."""
    given = options.settings.suppressions if options.settings else ()
    check_codes(given, BY_CODE)
    given = limited(given, {code: rule.severity for code, rule in BY_CODE.items()})
    suppressions = (*given, *(options.baseline.suppressions if options.baseline else ()))
    check_dates(suppressions, options.at, options.settings.max_suppression_days if options.settings else MAX_DAYS)
    return suppressions


def complete(context: Context, judgement: Judgement) -> bool:
    """Whether everything was decided. Each way in which it was not is checked by itself, whatever the rules say."""
    meaning = context.meaning
    return (
        bool(context.results)
        and not meaning.doubts
        and (context.network is None or not rights_in(context.network).doubts)
        and meaning.over_budget is None
        and all(run.status is EngineStatus.OK for run in context.engines if run.required)
        and all(result.status is not Status.UNKNOWN for result in context.results)
        and not judgement.outcomes.some(Result.OPEN)
    )


def verdict(findings: Sequence[Finding], fail_on: Severity | None, *, complete: bool) -> tuple[Verdict, int]:
    """Incomplete outranks fail: what could not be decided is never a pass, and hides nothing that was found."""
    if not complete:
        return Verdict.INCOMPLETE, 4
    failing = any(finding.fails(fail_on) for finding in findings)
    return (Verdict.FAIL, 1) if failing else (Verdict.PASS, 0)


def inputs(
    context: Context, policy: Policy | None, intents: Sequence[Intent], options: Options
) -> Iterator[tuple[str, GivenFile]]:
    """The files beside the keystore that were read, but for settings and baseline."""
    if context.environment is not None:
        yield "--env", context.environment.file
    for process in context.network.processes if context.network is not None else ():
        yield facts.NETWORK_OPTION, process.file
    for file in policy.files if policy is not None else ():
        yield "--policy", file
    for intent in intents:
        option = "--graph" if intent.origin is Origin.GRAPH else "--launch"
        yield from ((option, file) for file in intent.files)
    for asked in options.alloy_properties:
        yield "--alloy-property", asked.file


def started_with(environment: Environment) -> tuple[str, ...]:
    """The profiles that robots with these variables may start with."""
    return running(environment.value(DISTRIBUTION), environment.value(RMW))


def weakened(options: Options) -> tuple[str, ...]:
    """What makes this gate laxer than the default one. A narrower scope does not: it is another question."""
    weakened = []
    if options.fail_on is None or not Severity.HIGH.at_least(options.fail_on):
        weakened.append(f"--fail-on {options.fail_on.value if options.fail_on else 'never'}")
    weakened += [f"--ignore {code}" for code in options.ignore]
    weakened += [f"--select {code}" for code in options.select]
    if options.expires_within < DEFAULT_NOTICE:
        weakened.append(f"--expires-within {options.expires_within.days}")
    settings = options.settings
    if settings is not None and settings.max_suppression_days > MAX_DAYS:
        weakened.append(f"max_suppression_days = {settings.max_suppression_days} in {settings.file.path}")
    if options.settings_passed_over:
        weakened.append(options.settings_passed_over)
    if options.at_given:
        weakened.append(f"--at {options.at:%Y-%m-%dT%H:%M:%SZ} (dates are judged as of then)")
    return tuple(weakened)


def passed_over(options: Options, profiles: Sequence[Profile], environment: Environment | None) -> tuple[str, ...]:
    """What robots start with, by the file of their variables, that options override."""
    if environment is None:
        return ()
    found = []
    domain = environment.value(DOMAIN)
    if domain and environment.domain != options.domain:
        found.append(f"--domain {options.domain} in place of {DOMAIN}={domain} in {environment.file.path}")
    named = environment.value(DISTRIBUTION) or environment.value(RMW)
    missing = set(started_with(environment)) - {profile.name for profile in profiles} if named else ()
    if missing:
        left_out = ", ".join(sorted(missing))
        found.append(f"--profile leaves out {left_out}, which robots of {environment.file.path} may run")
    return tuple(found)


def while_accepted(safe: Horizon, judgement: Judgement, fail_on: Severity | None) -> Horizon:
    """The horizon, sooner where a finding that would fail this gate is accepted until then."""
    ends = first_end(finding for finding in judgement.findings if fail_on and finding.severity.at_least(fail_on))
    if ends is None or (safe.instant is not None and safe.instant <= ends):
        return safe
    return replace(safe, instant=ends, why="a finding that is accepted until then counts again")


def assumptions(context: Context, options: Options) -> Iterator[Needed]:
    """What this audit takes for granted: first what properties need, then the rest."""
    declared = options.settings.assumptions if options.settings else {}
    assumed = EVERY.difference(options.not_assumed)
    made = taken_for_granted(context.keystore, assumed, authorities_declared=context.authorities.complete)
    needed = conditions_of(context.results)
    left = made.difference(each.assumption for each in needed)
    names = (profile.name for profile in context.profiles)
    for each in (*needed, *answered_if(names, (one for one in Assumption if one in left))):
        yield replace(each, declared=declared.get(each.assumption))


def scoped(options: Options) -> Options:
    """The options with the scope that the settings declare, where the command says nothing.

    Raises errors.UsageError where the command leaves out what they declare.
    """
    settings = options.settings
    if settings is None or not settings.scope:
        return options
    if not options.profiles:
        return replace(options, profiles=settings.scope)
    chosen = {profile.name for profile in resolve(options.profiles)}
    missing = [name for name in settings.scope if name not in chosen]
    if missing:
        declared = (
            f"{settings.file.path} declares the scope {scope_of(resolve(settings.scope)) or 'of all distributions'}"
        )
        raise UsageError(f"{declared}: the command leaves out {implementations(missing)}.")
    return options


def stated(options: Options, scope: str) -> Iterator[str]:
    """What options say of the robots: what they run, the zone in which dates are read, arguments of launch files."""
    if scope:
        yield f"{PEERS_IN_SCOPE[0].upper()}{PEERS_IN_SCOPE[1:]}: {scope}."
    if options.network is not None:
        yield facts.ROUTED_STATED.format(shorten(terminal(f"{options.network}"), MAX_ARGUMENT))
    if options.time_zone is not None:
        where = f"Robots are in the time zone {options.time_zone.key} (--time-zone)"
        yield f"{where}: some implementations read the dates of grants in local time."
    given = [shorten(terminal(f"{name}:={value}"), MAX_ARGUMENT) for name, value in options.launch_arguments.items()]
    if given:
        yield f"Launch files are started with {', '.join(given)} (--launch-argument)."
