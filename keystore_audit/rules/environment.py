"""KA6: the environment that robots start with, which can make every signed document void (`--env FILE`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from keystore_audit.findings import Severity, outside
from keystore_audit.intent.environment import (
    DISTRIBUTION,
    DOMAIN,
    ENABLE,
    KEYSTORE,
    OVERRIDE,
    RMW,
    SECURE,
    STRATEGY,
    Environment,
)
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.profiles import DISTRIBUTIONS, MIDDLEWARE, facts, running
from keystore_audit.rules.registry import Context, Violation, quoted, rule
from keystore_audit.text import meant

RCL: Final = "rcl, security.c (read); ROS 2 design, DDS-Security integration"


def _environment(_keystore: Keystore, context: Context) -> Environment | None:
    return context.environment


def _found(environment: Environment, variable: str, message: str, **more: Any) -> Violation:
    key = f"{variable} {environment.value(variable)}"
    return Violation(message, (environment.place(variable),), key=key, **more)


@rule(
    "KA670",
    Severity.CRITICAL,
    RCL,
    outside("Set ROS_SECURITY_ENABLE=true for every process."),
    of=_environment,
)
def security_not_enabled(environment: Environment) -> Iterator[Violation]:
    """ROS_SECURITY_ENABLE is not exactly `true`: processes start without any security, whatever the keystore says."""
    value = environment.value(ENABLE)
    if value != SECURE[ENABLE]:
        said = f"is {quoted(value)}, not exactly 'true'" if value else "is not set"
        yield _found(environment, ENABLE, f"{ENABLE} {said}: nothing in this keystore is in force.")


@rule(
    "KA671",
    Severity.HIGH,
    RCL,
    outside("Set ROS_SECURITY_STRATEGY=Enforce for every process."),
    of=_environment,
)
def security_not_enforced(environment: Environment) -> Iterator[Violation]:
    """ROS_SECURITY_STRATEGY is not exactly `Enforce`: a process whose enclave does not load starts without security."""
    value = environment.value(STRATEGY)
    if value != SECURE[STRATEGY]:
        said = f"is {quoted(value)}, not exactly 'Enforce'" if value else "is not set"
        yield _found(
            environment,
            STRATEGY,
            f"{STRATEGY} {said}, which is Permissive: an enclave that fails to load starts unsecured.",
        )


@rule(
    "KA672",
    Severity.HIGH,
    RCL,
    outside("Set ROS_SECURITY_ENCLAVE_OVERRIDE to an enclave of the keystore, or remove it."),
    of=_environment,
)
def override_names_no_enclave(environment: Environment, context: Context) -> Iterator[Violation]:
    """The enclave that every process is to use is not in the keystore; names are compared letter by letter.

    Under Enforce nothing starts; otherwise everything starts unsecured. rcl does not check it: `..` leaves the
    keystore.
    """
    name = environment.value(OVERRIDE)
    known = [enclave.path for enclave in context.keystore.enclaves]
    if name and name not in known:
        hint = meant(name, known, "; the nearest is {}")
        yield _found(
            environment,
            OVERRIDE,
            f"{OVERRIDE} is {quoted(name)}, and there is no such enclave{hint}.",
        )


@rule(
    "KA673",
    Severity.MEDIUM,
    RCL,
    outside("Give each process its own enclave with --ros-args --enclave, and remove ROS_SECURITY_ENCLAVE_OVERRIDE."),
    of=_environment,
)
def override_for_every_process(environment: Environment, context: Context) -> Iterator[Violation]:
    """Every process in this environment has one identity and its rights, though there are several enclaves.

    Nothing that separates enclaves in this report separates those processes.
    """
    name = environment.value(OVERRIDE)
    if len(context.keystore.enclaves) > 1 and name in {enclave.path for enclave in context.keystore.enclaves}:
        yield _found(
            environment,
            OVERRIDE,
            f"Every process in this environment is {name}, one of {len(context.keystore.enclaves)} enclaves.",
            enclave=name,
        )


@rule(
    "KA674",
    Severity.HIGH,
    RCL,
    outside("Set ROS_SECURITY_KEYSTORE to the keystore's path on the robot."),
    of=_environment,
)
def no_keystore_named(environment: Environment) -> Iterator[Violation]:
    """ROS_SECURITY_KEYSTORE is not set: no process finds an enclave.

    Whether the directory that it names holds what was audited cannot be seen here.
    """
    if not environment.value(KEYSTORE):
        yield _found(environment, KEYSTORE, f"{KEYSTORE} is not set: no enclave is found.")


@rule(
    "KA675",
    Severity.HIGH,
    "rcl, domain_id.c (read); DDSI-RTPS 2.3, 9.6.1.1 (ports of a domain)",
    outside("Set ROS_DOMAIN_ID to one of 0 to 232 that the governance covers."),
    of=_environment,
)
def domain_id_invalid(environment: Environment) -> Iterator[Violation]:
    """ROS_DOMAIN_ID is no domain: no process starts.

    Rights are worked out for every governed domain instead.
    """
    if environment.domain is None:
        value = quoted(environment.value(DOMAIN))
        yield _found(environment, DOMAIN, f"{DOMAIN} is {value}; expected a number from 0 to 232.")


@rule(
    "KA676",
    Severity.HIGH,
    f"keystore-audit, README.md (what it does not do); {facts.OWN_ACCESS_CONTROL}",
    outside(f"{facts.ENFORCING}; or name the files of {facts.UNENFORCING} ({facts.NETWORK_OPTION} DIR)."),
    of=_environment,
)
def middleware_not_modelled(environment: Environment, context: Context) -> Iterator[Violation]:
    """The middleware's decisions are not known here, so this report says nothing about it.

    rmw_zenoh_cpp uses its own access control file, and enforces neither governance.p7s nor permissions.p7s. With
    `--zenoh DIR` the audit covers those files.
    """
    name = environment.value(RMW)
    unenforcing = name == facts.UNENFORCING
    if name and name not in MIDDLEWARE and not (unenforcing and context.network is not None):
        why = "enforces neither governance.p7s nor permissions.p7s" if unenforcing else "is not known here"
        yield _found(
            environment,
            RMW,
            f"{RMW} is {quoted(name)}, which {why}: this report does not cover it.",
            undecided=True,
        )


@rule(
    "KA677",
    Severity.HIGH,
    "keystore-audit, docs/profiles.md",
    outside("Name the robot's releases with --profile, or use a maintained distribution."),
    of=_environment,
)
def distribution_not_modelled(environment: Environment, context: Context) -> Iterator[Violation]:
    """The distribution's releases of DDS implementations are not known here.

    Every variant of the middleware is judged instead, including old ones that accept permissions which an enclave
    signed itself. The audit is incomplete unless profiles are chosen.
    """
    name = environment.value(DISTRIBUTION)
    if name and name not in DISTRIBUTIONS:
        assumed = running(name, environment.value(RMW))
        chosen = tuple(profile.name for profile in context.fleets) != assumed
        what = "the profiles chosen are judged instead" if chosen else "every known release is judged instead"
        yield _found(
            environment,
            DISTRIBUTION,
            f"{DISTRIBUTION} is {quoted(name)}, whose releases of DDS implementations are not known here: {what}.",
            undecided=not chosen,
        )
