"""Enclaves whose key is that of an identity CA: what they can do, and what they are meant to do; by both engines."""

from __future__ import annotations

from itertools import product

from msgspec.structs import replace

from keystore_audit.engine.counterexample import describe
from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import BY_ID, Status
from keystore_audit.properties.result import Role
from tests.engine.alloy.flow_builders import THIRD, at, chain, claim, issuing, shut_out, unknown
from tests.engine.alloy_batch import decide_batch, decide_claims
from tests.engine.systems import CHATTER, IDENTITY_CA, LISTENER, PERMISSIONS_CA, TALKER, TALKER_IDENTITY


def granted_to(*, own: bool, issues: bool, asked: bool) -> System:
    """The third's document also grants somebody to join and to write: itself, or another."""
    b = shut_out()
    b.topic_rules[0] = replace(b.topic_rules[0], enable_write_access_control=asked)
    document, identity = b.enclaves[THIRD].document, b.enclaves[THIRD].identity
    assert document is not None
    assert identity is not None
    b.rule(b.grant(document, [identity if own else b.certificate([IDENTITY_CA])]), [0], publish=[CHATTER])
    able = claim(at(THIRD), at(LISTENER), Attacker.HONEST, kind=ClaimKind.ABLE)
    return replace((issuing(b, THIRD) if issues else b).system(), claims=(able,))


def test_able_is_by_the_enclaves_own_grants_whatever_its_key_issues() -> None:
    """Whether writers are asked for grants or not: it has to join."""
    cases = list(product((True, False), repeat=3))
    built = [granted_to(own=own, issues=issues, asked=asked) for own, issues, asked in cases]
    expected = [Status.HOLDS if own else Status.VIOLATED for own, _issues, _asked in cases]
    assert [found["asked"] for found in decide_claims(built)] == expected
    assert [NativeEngine([system]).answers[0]["asked"].status for system in built] == expected


def stranger(*, issues: bool, authority: frozenset[int], signs: bool = False, pins_signer: bool = False) -> System:
    """No CA issued the talker's identity. Its key may be that of an identity CA, which `authority` issued.

    `signs`: and that of the permissions CA.
    """
    b = unknown(chain(), TALKER)
    b.pins_signer = pins_signer
    if signs:
        key = b.certificates[PERMISSIONS_CA].key
        b.certificates[TALKER_IDENTITY] = replace(b.certificates[TALKER_IDENTITY], key=key)
    if issues:
        issuing(b, TALKER)
        b.certificates[-1] = replace(b.certificates[-1], issuers=authority)
    return b.system()


def test_who_issues_itself_identities_grants_itself_rights_by_its_key() -> None:
    """Whoever issued the identity that it has here: with the key of the permissions CA, or of an authority below it."""
    below, beside = frozenset({PERMISSIONS_CA}), frozenset({IDENTITY_CA})
    cases = [
        (stranger(issues=True, signs=True, authority=beside, pins_signer=True), False),
        (stranger(issues=False, signs=True, authority=beside, pins_signer=True), True),
        (stranger(issues=True, authority=beside, pins_signer=True), True),
        (stranger(issues=True, authority=below), False),
        (stranger(issues=False, authority=below), True),
        (stranger(issues=True, authority=beside), True),
        (stranger(issues=True, authority=below, pins_signer=True), True),
    ]
    asked, expected = "no-enclave-grants-itself-rights", [holds for _system, holds in cases]
    systems = [system for system, _holds in cases]
    assert [found[asked] for found in decide_batch(systems)] == expected
    answers = [NativeEngine([system]).answers[0][asked] for system in systems]
    assert [answer.status is Status.HOLDS for answer in answers] == expected


def test_the_counterexample_says_by_which_key() -> None:
    told = describe(
        stranger(issues=True, authority=frozenset({PERMISSIONS_CA})),
        BY_ID["no-enclave-grants-itself-rights"],
        {Role.TRUST_DOMAIN: 0, Role.ENCLAVE: TALKER},
    )
    assert told.text == (
        "/talker can sign its own permissions: the permissions CA also issued a certificate of its key (certificate "
        "5), and these implementations accept any signer that the CA issued."
    )
