"""The pipeline: read, interpret, decide, judge, report."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain
from typing import TYPE_CHECKING

from msgspec.structs import replace

from keystore_audit import __version__
from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.engine.engines import (
    Answers,
    Engines,
    combine,
    combine_claims,
    combine_determinism,
    run_engines,
    with_label_answers,
)
from keystore_audit.engine.horizon import Horizon, horizon
from keystore_audit.engine.native import NativeEngine
from keystore_audit.engine.needs import solved_again, taken_for_granted, with_needs, with_rounds, with_sessions
from keystore_audit.errors import BudgetExceeded
from keystore_audit.gate import (
    assumptions,
    complete,
    inputs,
    passed_over,
    scoped,
    started_with,
    stated,
    suppressions,
    verdict,
    weakened,
    while_accepted,
)
from keystore_audit.given import GivenFile
from keystore_audit.intent import read_observed
from keystore_audit.intent.environment import Environment, read_environment
from keystore_audit.intent.intent import Intent
from keystore_audit.keystore.identity import Beside
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import certificates_of, system_documents
from keystore_audit.model.meaning import Meaning
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.trust import chain as trust
from keystore_audit.options import Options, Progress
from keystore_audit.profiles import Profile, at_work, fleets, releases, resolve, scope_of
from keystore_audit.properties.result import AlloyResult, EngineStatus, PropertyResult, Status
from keystore_audit.report.content import (
    MAX_RANKED,
    MIXED,
    NOT_CHECKED,
    OTHERWISE_MIXED,
    Anchor,
    Anchors,
    Checked,
    EnclaveEntry,
    Report,
    excerpts,
    unread,
    untested,
)
from keystore_audit.rules import RULES
from keystore_audit.rules.judge import Judgement, judge
from keystore_audit.rules.registry import Context, listed
from keystore_audit.settings.suppressions import accepted_by
from keystore_audit.zenoh.answers import routed_table
from keystore_audit.zenoh.names import written_names
from keystore_audit.zenoh.network import read_network

if TYPE_CHECKING:
    from keystore_audit.intent.policy import Policy
    from keystore_audit.model.claims.stated import Claim
    from keystore_audit.model.intended.drift import Drift
    from keystore_audit.model.intended.observed import Observation
    from keystore_audit.model.intended.observed_rights import WiredNode


def audit(
    path: str | os.PathLike[str],
    options: Options,
    *,
    progress: Progress | None = None,
    beside: Beside | None = None,
) -> Report:
    """Audits the keystore at `path`; `beside`: what is known of the other keystores of a run, None: there are none.

    Raises errors.NothingToAudit where there is none. Raises errors.UsageError for an unknown profile, an unusable graph
    or launch file, or findings that are accepted for too long. Whatever is wrong with the keystore or an engine
    is in the report.
    """
    environment = read_environment(options.environment) if options.environment is not None else None
    if environment is not None:
        options = _as_started(options, environment)
    options = scoped(options)
    profiles = fleets(resolve(options.profiles), options.settings.runs if options.settings else {})
    working, declared_runs = at_work(profiles), [scope_of((each,)) for each in profiles if each.others]
    accepted = suppressions(options)
    policy = _policy(options)
    intents = read_observed(options.graphs, options.launches, options.launch_arguments)
    claims = options.settings.claims if options.settings else ()
    declared = options.settings.declared if options.settings else None
    enclaves = progress.enclaves if progress else None
    keystore = read_keystore(path, progress=enclaves, declared=options.files)
    network = read_network(options.network, keystore, options.at) if options.network is not None else None
    if progress:
        progress.stage("working out what the documents mean")
    assumed = EVERY.difference(options.not_assumed)
    if options.authorities is not None and options.authorities.complete:
        assumed |= {Assumption.AUTHORITIES_AS_FOUND}  # nothing to assume: others are findings
    accesses = AccessViews(system_documents(keystore), options.at, options.time_zone, assumed)
    usabilities = Usabilities(options.domain, accesses)
    meaning = interpret(
        keystore,
        profiles,
        options.at,
        accesses,
        usabilities,
        claims,
        [place for file in options.alloy_properties for place in file.places],
        declared,
        _nodes(options, intents, policy, keystore),
    )
    native = NativeEngine(meaning.systems)
    stage = progress.stage if progress else None
    engines = Engines(choice=options.engine, jar=options.alloy_jar, offline=options.offline, timeout=options.timeout)
    runs, answers = run_engines(native, engines, stage)
    names = [profile.name for profile in profiles]
    asserted = with_sessions(claims, _asserted(claims, meaning, answers, names), accesses.assumed)
    determined = combine_determinism(declared.claims, meaning.systems, answers, names) if declared else ()
    determined = with_rounds(determined, meaning.systems, accesses.assumed)
    in_alloy: tuple[AlloyResult, ...] = ()
    if options.alloy_properties:
        from keystore_audit.engine.alloy.user_properties import decide_files

        in_alloy = decide_files(options.alloy_properties, meaning.systems, names, runs, engines, stage)
    declared_authorities = options.authorities or trust.Authorities()
    made = taken_for_granted(keystore, assumed, authorities_declared=declared_authorities.complete)
    results = (*_told(native, answers, names), *asserted, *determined, *in_alloy)
    results, minimal = with_needs(results, native, made)
    results, runs = solved_again(results, minimal, runs, engines, stage)
    context = Context(
        keystore=keystore,
        meaning=meaning,
        accesses=accesses,
        drift=_drift(keystore, policy, options, working, accesses) if policy is not None else None,
        results=results,
        engines=runs,
        at=options.at,
        expires_within=options.expires_within,
        deployed=options.deployed,
        profiles=working,
        fleets=profiles,
        releases=releases(options.profiles),
        claims=claims,
        beside=beside,
        environment=environment,
        network=network,
        observed=_compared(intents, keystore, working, accesses, options),
        launch_complete=options.launch_complete,
        suppressions=accepted,
        authorities=declared_authorities,
        conditions=(
            f"{options.domain}",
            f"{options.time_zone}",
            *sorted(each.value for each in accesses.assumed),
            *declared_runs,
        ),
    )
    judgement = judge(context, RULES, select=options.select, ignore=options.ignore)
    safe = horizon(keystore, native, profiles, options.at, accesses, usabilities, meaning.usability)
    read = tuple(inputs(context, policy, intents, options))
    report = _report(context, judgement, while_accepted(safe, judgement, options.fail_on), options, read)
    return _drawn(report, context, accesses, options)


def _drawn(report: Report, context: Context, accesses: AccessViews, options: Options) -> Report:
    """The report with its tables and pictures, on which no verdict rests, where asked for or cheap."""
    from keystore_audit.model import blast_radius

    about, systems = (context.keystore, context.fleets, options.at, accesses), context.meaning.systems
    few = len(context.keystore.enclaves) <= MAX_RANKED
    ranked = blast_radius.ranked_enclaves(*about) if systems and (few or options.overview) else None
    seen = said = routed = None
    if options.overview:
        from keystore_audit.model.intended.meant import meant
        from keystore_audit.model.tables import overview

        said = meant(context.drift, context.observed)
        seen = overview.overview(*about, options.domain, systems)
        if context.network is not None:
            domain = options.domain or 0
            named = written_names(context.keystore, context.network, domain)
            with suppress(BudgetExceeded):
                routed = routed_table(context.keystore, context.network, named, domain, options.at, context.releases)
    return replace(report, blast_radius=ranked, overview=seen, routed=routed, meant=said)


def _as_started(options: Options, environment: Environment) -> Options:
    """The options with the profiles and the domain of the environment, where none were given."""
    return replace(
        options,
        profiles=options.profiles or started_with(environment),
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
    from keystore_audit.model.intended.observed import observe

    return observe(intents, keystore, profiles, options.at, accesses, options.domain)


def _nodes(
    options: Options, intents: Sequence[Intent], policy: Policy | None, keystore: Keystore
) -> tuple[WiredNode, ...]:
    """The nodes and their wiring: for users' files alone, since nothing else asks."""
    if not options.alloy_properties or not (intents or policy):
        return ()
    from keystore_audit.model.intended.observed_rights import wiring

    return wiring((*intents, *((policy.intent,) if policy else ())), keystore.layout.kind)


def _told(native: NativeEngine, answers: Answers, names: Sequence[str]) -> tuple[PropertyResult, ...]:
    """What the engines say of the properties, and what violates them."""
    results = combine(native.systems, answers, names)
    if not any(result.status is Status.VIOLATED for result in results):
        return results
    from keystore_audit.engine.breaches import with_violations  # good keystores have none

    return with_violations(results, native.systems, native.answers)


def _asserted(
    claims: Sequence[Claim], meaning: Meaning, answers: Answers, names: Sequence[str]
) -> tuple[PropertyResult, ...]:
    """What the engines say of what users assert, with all that violates it."""
    if not claims:
        return ()
    from keystore_audit.engine.breaches import with_breaches  # most audits have none

    results = combine_claims(claims, meaning.systems, answers, names)
    return with_label_answers(claims, with_breaches(results, meaning.systems))


def _report(
    context: Context, judgement: Judgement, safe: Horizon, options: Options, inputs: tuple[tuple[str, GivenFile], ...]
) -> Report:
    outcome, exit_code = verdict(judgement.findings, options.fail_on, complete=complete(context, judgement))
    answered = [run for run in context.engines if run.status is EngineStatus.OK]
    anchors = trust.trusted(context.keystore, context.authorities)
    agree = all(result.engines_agree for result in context.results)
    assumed = tuple(assumptions(context, options))
    scope = scope_of(context.fleets)
    return Report(
        version=__version__,
        keystore=context.keystore.root,
        layout=context.keystore.layout.kind.value,
        digest=context.keystore.digest,
        at=options.at,
        safe_until=safe.instant,
        safe_until_why=safe.why,
        verdict=outcome,
        exit_code=exit_code,
        fail_on=options.fail_on,
        weakened=(
            *weakened(options),
            *passed_over(options, context.profiles, context.environment),
            *accepted_by(judgement.findings),
        ),
        assumptions=assumed,
        stated=tuple(stated(options, scope)),
        engines=context.engines,
        engines_agree=agree if len(answered) > 1 else None,
        enclaves=_enclaves(context),
        properties=context.results,
        findings=judgement.findings,
        authorities=tuple(map(_anchors, anchors)),
        outcomes=judgement.outcomes,
        checked=_checked(context),
        scope=scope,
        network=context.network.path if context.network is not None else "",
        others=tuple(p.name for p in context.profiles if p.name not in {each.name for each in context.fleets}),
        deployed=options.deployed,
        domain=options.domain,
        files=tuple(_files(context)),
        uncovered=context.keystore.uncovered,
        excerpts=excerpts(context.keystore, judgement.findings),
        roots=context.keystore.declared.roots,
        unread_foreign=tuple(file.place for file in context.keystore.unread_foreign),
        settings=options.settings.file if options.settings else None,
        baseline=options.baseline.file if options.baseline else None,
        inputs=inputs,
    )


def _anchors(found: trust.Anchors) -> Anchors:
    return Anchors(
        role=found.role.value.partition("_")[0],
        declared=tuple(sorted(found.declared)),
        here=tuple(Anchor(subject=c.subject, path=c.path, sha256=c.sha256, key=c.key) for c in found.certificates),
    )


def _files(context: Context) -> Iterator[tuple[str, str]]:
    """What the report speaks for, with its digests: what the same run audits apart is another report's.

    But for what is read here, too: links of enclaves, in public/ and to the shared governance may lead there.
    """
    keystore, layout = context.keystore, context.keystore.layout
    apart = context.beside.apart if context.beside is not None else frozenset()
    folders = tuple(f"{place}/" for place in apart)
    shared = (*layout.authorities, *filter(None, (layout.governance, layout.unsigned_governance)))
    read = chain(shared, *(each.files.every for each in keystore.enclaves)) if apart else ()
    ours = {file.place for file in read}
    return ((path, sha256) for path, sha256 in keystore.contents if path in ours or not path.startswith(folders))


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
    from keystore_audit.model.intended.drift import drift

    return drift(keystore, policy, profiles, options.at, accesses, options.domain)


def _enclaves(context: Context) -> tuple[EnclaveEntry, ...]:
    entries = []
    for enclave in context.keystore.enclaves:
        directory = enclave.files.directory
        entries.append(
            EnclaveEntry(
                path=enclave.path,
                directory=directory,
                subject=enclave.identity.subject if enclave.identity else None,
                profiles={p.name: context.meaning.usability[directory, p.name] for p in context.fleets},
            )
        )
    return tuple(entries)


def _checked(context: Context) -> Checked:
    meaning, keystore = context.meaning, context.keystore
    mixed = any(profile.others for profile in context.fleets)
    system = meaning.systems[0] if meaning.systems else None
    return Checked(  # systems have further certificates, for what is unread or elsewhere
        certificates=len(certificates_of(keystore, context.at)) if system else 0,
        documents=len(system.documents) if system else 0,
        channels=len(system.channels) if system else 0,
        rules=len(RULES),
        not_checked=(
            *meaning.idle,
            *unread(keystore),
            *untested(context.profiles),
            *(said for words, said in NOT_CHECKED.items() if words != MIXED or not mixed),
            *([OTHERWISE_MIXED] if mixed else []),
            *_not_compared(context),
        ),
    )


def _not_compared(context: Context) -> Iterator[str]:
    """What the keystore is for, where nothing that says so was named."""
    if context.drift is None:
        yield "The policy that the keystore was generated from (--policy)."
    if context.observed is None:
        yield "The nodes that will use the keystore (--graph, --launch)."
    elif context.observed.unused:
        unused = listed(context.observed.unused)
        yield f"What {unused} may do: no node of --graph or --launch runs there."
