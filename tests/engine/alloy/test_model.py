"""What the Alloy model says: theorems about any keystore, and what each single change to a healthy one breaks."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from keystore_audit import resources
from keystore_audit.engine.alloy.facts import KEYSTORE, MAIN, MODULES, commands, facts, write_model
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.keystore.governance import ProtectionKind
from keystore_audit.model.system import Reading, System
from keystore_audit.properties import PROPERTIES
from tests.engine import systems
from tests.engine.alloy_batch import decide_batch, outcomes
from tests.engine.systems import (
    CHATTER,
    GOVERNANCE,
    IDENTITY_CA,
    LISTENER,
    LISTENER_IDENTITY,
    LISTENER_PERMISSIONS,
    PERMISSIONS_CA,
    TALKER,
    TALKER_IDENTITY,
    TALKER_PERMISSIONS,
    Builder,
    healthy,
    healthy_builder,
)

HERE = Path(__file__).parent
NONE, SIGN, ENCRYPT = ProtectionKind.NONE, ProtectionKind.SIGN, ProtectionKind.ENCRYPT

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

Change = Callable[[Builder], object]


def on(atoms: str, index: int, **changed: Any) -> Change:
    """The change of fields of one atom."""

    def change(b: Builder) -> None:
        of = getattr(b, atoms)
        of[index] = replace(of[index], **changed)

    return change


def both(*changes: Change) -> Change:
    def change(b: Builder) -> None:
        for one in changes:
            one(b)

    return change


def unpinned(b: Builder) -> None:
    b.pins_signer = False


def may(b: Builder) -> None:
    b.reading = Reading.MAY


def stray_reader(b: Builder) -> None:
    """An enclave with an identity and no grant at all."""
    identity = b.certificate([IDENTITY_CA])
    b.enclave(0, identity, b.document([PERMISSIONS_CA]))


def earlier_deny(b: Builder) -> None:
    """A deny before the talker's allow."""
    b.rules.insert(0, replace(b.rules[0], allow=False))


def expired_first_grant(b: Builder) -> None:
    """An expired grant of nothing before the talker's: it must not be chosen."""
    b.grants.insert(0, replace(b.grants[0], not_after=1))
    b.rules[:] = [replace(rule, grant=rule.grant + 1) for rule in b.rules]


def weak_rule_first(b: Builder) -> None:
    """A topic rule without protection before the strong one."""
    weak = replace(
        b.topic_rules[0], metadata_protection_kind=NONE, data_protection_kind=NONE, enable_read_access_control=False
    )
    b.topic_rules.insert(0, weak)


def weak_rule_last(b: Builder) -> None:
    weak_rule_first(b)
    b.topic_rules.reverse()


def shared_keys(b: Builder) -> None:
    """Everything encrypted, and no origin authenticated."""
    b.domain_rules[0] = replace(b.domain_rules[0], rtps_protection_kind=ENCRYPT)
    b.topic_rules[0] = replace(b.topic_rules[0], metadata_protection_kind=ENCRYPT)


ALL_NONE = both(
    on("domain_rules", 0, rtps_protection_kind=NONE),
    on("topic_rules", 0, metadata_protection_kind=NONE, data_protection_kind=NONE),
)

AUTHENTICATION = {"identities-chain-to-the-identity-ca"}
ENCRYPTION = {"outsiders-cannot-read", "outsiders-cannot-inject"}
INSIDERS = {"nobody-writes-without-a-grant", "nobody-reads-without-a-grant"}

MUTATIONS: dict[str, tuple[Change, set[str]]] = {
    "nothing": (lambda _b: None, set()),
    # authentication
    "unauthenticated participants": (
        on("domain_rules", 0, allow_unauthenticated_participants=True),
        {"only-authenticated-participants-join"},
    ),
    "other issuer": (on("certificates", TALKER_IDENTITY, issuers=frozenset({PERMISSIONS_CA})), AUTHENTICATION),
    "issuer is no authority": (on("certificates", IDENTITY_CA, authority=False), AUTHENTICATION),
    "identity expired": (on("certificates", TALKER_IDENTITY, not_after=1), AUTHENTICATION),
    "identity not yet valid": (on("certificates", TALKER_IDENTITY, not_before=3), AUTHENTICATION),
    "identity ends at the audit instant": (on("certificates", TALKER_IDENTITY, not_before=2, not_after=2), set()),
    "identity CA expired": (on("certificates", IDENTITY_CA, not_after=1), AUTHENTICATION),
    "identity revoked": (on("realms", 0, revoked=frozenset({TALKER_IDENTITY})), AUTHENTICATION),
    "permissions CA expired": (
        on("certificates", PERMISSIONS_CA, not_after=1),
        {"documents-signed-by-the-permissions-ca"},
    ),
    "governance not intact": (on("documents", GOVERNANCE, intact=False), {"documents-signed-by-the-permissions-ca"}),
    "signed by the identity CA": (
        on("documents", TALKER_PERMISSIONS, signers=frozenset({IDENTITY_CA})),
        {"documents-signed-by-the-permissions-ca"},
    ),
    "signed by nobody": (
        on("documents", TALKER_PERMISSIONS, signers=frozenset()),
        {"documents-signed-by-the-permissions-ca"},
    ),
    "signed by two, one a stranger": (
        on("documents", TALKER_PERMISSIONS, signers=frozenset({PERMISSIONS_CA, TALKER_IDENTITY})),
        {"documents-signed-by-the-permissions-ca"},
    ),
    "one key": (on("certificates", LISTENER_IDENTITY, key=102), {"no-identity-serves-two-enclaves"}),
    "one CA, pinned": (on("realms", 0, permissions_ca=frozenset({IDENTITY_CA, PERMISSIONS_CA})), set()),
    "one CA, not pinned": (
        both(unpinned, on("realms", 0, permissions_ca=frozenset({IDENTITY_CA, PERMISSIONS_CA}))),
        {"no-enclave-grants-itself-rights"} | INSIDERS,
    ),
    "one CA, not pinned, identities unfit to sign": (
        both(
            unpinned,
            on("realms", 0, permissions_ca=frozenset({IDENTITY_CA, PERMISSIONS_CA})),
            on("certificates", TALKER_IDENTITY, fit_to_sign=False),
            on("certificates", LISTENER_IDENTITY, fit_to_sign=False),
        ),
        set(),
    ),
    # encryption
    "all kinds NONE": (ALL_NONE, ENCRYPTION | INSIDERS | {"readers-cannot-forge"}),
    "discovery clear, messages encrypted": (on("topic_rules", 0, enable_discovery_protection=False), set()),
    "discovery clear, messages signed": (
        both(
            on("topic_rules", 0, enable_discovery_protection=False),
            on("domain_rules", 0, rtps_protection_kind=ProtectionKind.SIGN_WITH_ORIGIN_AUTHENTICATION),
        ),
        {"outsiders-cannot-learn-names"},
    ),
    "discovery signed, messages signed": (
        on("domain_rules", 0, discovery_protection_kind=SIGN, rtps_protection_kind=SIGN),
        {"outsiders-cannot-learn-names"},
    ),
    "payload in clear, messages encrypted": (
        on("topic_rules", 0, metadata_protection_kind=SIGN, data_protection_kind=NONE),
        {"nobody-reads-without-a-grant"},
    ),
    # access control
    "read access control off": (
        on("topic_rules", 0, enable_read_access_control=False),
        {"grants-are-enforced", "nobody-reads-without-a-grant"},
    ),
    "write access control off": (
        on("topic_rules", 0, enable_write_access_control=False),
        {"grants-are-enforced", "nobody-writes-without-a-grant"},
    ),
    "join access control off": (on("domain_rules", 0, enable_join_access_control=False), {"grants-are-enforced"}),
    "no origin authentication": (shared_keys, {"readers-cannot-forge"}),
    "payloads encrypted, nothing else": (
        both(
            on("domain_rules", 0, rtps_protection_kind=NONE),
            on("topic_rules", 0, metadata_protection_kind=NONE, data_protection_kind=ENCRYPT),
        ),
        {"readers-cannot-forge"},
    ),
    "submessages encrypted, nothing else": (
        both(
            on("domain_rules", 0, rtps_protection_kind=NONE),
            on("topic_rules", 0, metadata_protection_kind=ENCRYPT, data_protection_kind=NONE),
        ),
        {"readers-cannot-forge"},
    ),
    "default allow": (both(on("grants", 0, default_allow=True), shared_keys), {"readers-cannot-forge"}),
    "default allow, but the only writer is denied: nobody to pass for": (
        both(on("grants", 0, default_allow=True), on("rules", 0, allow=False), shared_keys),
        set(),
    ),
    "messages encrypted for all, nothing else": (
        both(
            on("domain_rules", 0, rtps_protection_kind=ENCRYPT),
            on("topic_rules", 0, metadata_protection_kind=NONE, data_protection_kind=NONE),
        ),
        {"readers-cannot-forge"} | INSIDERS,
    ),
    "ungoverned": (on("topic_rules", 0, channels=frozenset()), set()),
    # first match and dates
    "weak topic rule first": (weak_rule_first, {"grants-are-enforced", "nobody-reads-without-a-grant"}),
    "weak topic rule last": (weak_rule_last, set()),
    "all kinds NONE, and the talker denied before it is allowed: nothing to read": (
        both(earlier_deny, ALL_NONE),
        {"outsiders-cannot-inject"} | INSIDERS,
    ),
    "expired grant first": (
        both(expired_first_grant, on("topic_rules", 0, enable_write_access_control=False)),
        {"grants-are-enforced", "nobody-writes-without-a-grant"},
    ),
    # what could not be read
    "opaque governance": (
        both(may, on("documents", GOVERNANCE, intact=False, opaque=True)),
        {prop.id for prop in PROPERTIES}
        - {"identities-chain-to-the-identity-ca", "no-identity-serves-two-enclaves", "no-enclave-grants-itself-rights"},
    ),
    "opaque permissions": (
        both(may, on("documents", TALKER_PERMISSIONS, intact=False, opaque=True)),
        {"documents-signed-by-the-permissions-ca", "no-enclave-grants-itself-rights"} | INSIDERS,
    ),
    "opaque enclave": (
        both(may, on("enclaves", TALKER, identity=None, opaque=True)),
        {
            "identities-chain-to-the-identity-ca",
            "no-identity-serves-two-enclaves",
            "no-enclave-grants-itself-rights",
        }
        | INSIDERS,
    ),
}


def mutated(change: Change) -> System:
    builder = healthy_builder()
    change(builder)
    return builder.system()


def test_every_change_breaks_exactly_the_properties_that_it_should() -> None:
    found = decide_batch([mutated(change) for change, _broken in MUTATIONS.values()])
    wrong = {}
    for (name, (_change, broken)), answers in zip(MUTATIONS.items(), found, strict=True):
        violated = {identifier for identifier, holds in answers.items() if not holds}
        if violated != broken:
            wrong[name] = (sorted(violated - broken), sorted(broken - violated))
    assert wrong == {}


def test_every_property_is_broken_by_some_change_of_something_that_was_read() -> None:
    read = (broken for name, (_change, broken) in MUTATIONS.items() if "opaque" not in name)
    assert set().union(*read) == {prop.id for prop in PROPERTIES}


@pytest.mark.slow
def test_theorems_hold_of_any_keystore_and_every_property_can_fail_and_hold(tmp_path: Path, analyzer: Engine) -> None:
    """The Analyzer's own `expect` decides; without it a theorem would count as proved by a file that does not run."""
    for name in MODULES:
        shutil.copy(resources.alloy() / name, tmp_path)
    for name in ("keystore.als", "theorems.als"):
        shutil.copy(HERE / "any_keystore" / name, tmp_path)
    done = execute(analyzer, tmp_path, "theorems.als", "-t", "none")
    assert done.returncode == 0, done.stderr
    commands_given = (tmp_path / "theorems.als").read_text().count(" expect ")
    assert len([line for line in done.stderr.splitlines() if line.endswith("SAT")]) == commands_given


def execute(analyzer: Engine, folder: Path, main: str, *options: str) -> subprocess.CompletedProcess[str]:
    command = [str(analyzer.java), f"-Djava.io.tmpdir={folder}", "-XX:+UseSerialGC", "-jar", str(analyzer.jar)]
    command += ["exec", "-f", "-s", "sat4j", "-o", "out", *options, main]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=1200, env={"PATH": os.defpath})


@pytest.mark.parametrize("module", [*MODULES, KEYSTORE, MAIN])
def test_each_module_opens_and_runs_by_itself(module: str, tmp_path: Path) -> None:
    """With the example of the source tree as facts, and a command of the test's."""
    modules = {path.name: path.read_text() for path in resources.alloy().glob("*.als")}
    name = module.removesuffix(".als")
    modules["alone.als"] = f"module alone\nopen {name}\nrun nothing {{ no none }} for 0\n"
    assert outcomes(tmp_path, modules, "alone.als") == {"nothing": True}


def test_an_exported_model_runs_as_it_is(tmp_path: Path, analyzer: Engine) -> None:
    write_model([systems.stock()], tmp_path / "model")
    done = execute(analyzer, tmp_path / "model", MAIN, "-t", "none", "-d", "0")
    assert done.returncode == 0, done.stderr
    assert "ReadersCannotForge" in next(
        line for line in done.stderr.splitlines() if line.endswith(" SAT") and "check" in line
    )


def test_families_without_an_object_say_so(tmp_path: Path) -> None:
    """No grant at all: nothing to enforce; nothing governed: nothing to protect either."""
    modules = {path.name: path.read_text() for path in resources.alloy().glob("*.als")}
    modules[MAIN] = commands(PROPERTIES)

    def exercised(change: Change) -> list[bool]:
        found = outcomes(tmp_path, modules | {KEYSTORE: facts(mutated(change))})
        return [found[f"{family}IsExercised"] for family in ("Authentication", "Encryption", "AccessControl")]

    assert exercised(lambda _b: None) == [True, True, True]
    assert exercised(on("topic_rules", 0, channels=frozenset())) == [True, False, False]
    no_grants = both(
        lambda b: b.rules.clear(),
        on("topic_rules", 0, enable_read_access_control=False),
        on("domain_rules", 0, enable_join_access_control=False),
    )
    assert exercised(no_grants) == [True, True, False]
    anonymous = both(on("enclaves", TALKER, identity=None), on("enclaves", LISTENER, identity=None))
    assert exercised(anonymous) == [False, False, False]


def test_a_contradiction_in_the_model_is_seen(tmp_path: Path) -> None:
    modules = {path.name: path.read_text() for path in resources.alloy().glob("*.als")}
    modules |= {MAIN: commands(PROPERTIES), KEYSTORE: facts(healthy()) + "\nfact { no Enclave }\n"}
    assert not any(outcomes(tmp_path, modules).values())


def test_the_talker_and_the_listener_keep_their_indices() -> None:
    """What the mutations above rely on."""
    system = healthy()
    assert (system.enclaves[TALKER].label, system.enclaves[LISTENER].label) == ("/talker", "/listener")
    assert system.enclaves[LISTENER].permissions == LISTENER_PERMISSIONS
    assert system.channels[CHATTER].topic == "rt/chatter"
