"""Certificates of what holds (docs/certificates.md): the audit says what does, the checker gives the reasons."""

from __future__ import annotations

from pathlib import Path

from msgspec.structs import replace

from keystore_audit.certificate.checking import Checker, Compartment, Given, Implementation, Property, encoded
from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.engines import combine_claims
from keystore_audit.findings import Location
from keystore_audit.flow import posed
from keystore_audit.model.claims.stated import Claim
from keystore_audit.properties.result import AssertedResult, Status
from keystore_audit.settings.claims import FORMS
from keystore_audit.settings.document import Source


def prove(path: Path, asked: Property, given: Circumstances, told: Given) -> tuple[AssertedResult, bytes | None]:
    """What the native engine answers about the keystore at `path`; and the certificate, None unless it certainly
    holds.

    `told` is what the checker is to be told.
    Raises certificate.errors.NotAccepted where the checker cannot follow, and what `flow.posed` raises.
    """
    result = answered(path, asked, given)
    if result.status is not Status.HOLDS:
        return result, None
    checker = Checker(path, asked, told)
    alike: dict[Compartment, list[str]] = {}
    for name in told.profiles:
        implementation = checker.implementation(name)
        alike.setdefault(implementation.compartment(within(implementation)), []).append(name)
    compartments = tuple(replace(each, profiles=tuple(names)) for each, names in alike.items())
    content = encoded(checker.certificate(compartments))
    checker.check(content)
    return result, content


def answered(path: Path, asked: Property, given: Circumstances) -> AssertedResult:
    """What the native engine answers. Raises what `flow.posed` raises."""
    form = FORMS[str(asked.__struct_config__.tag).replace("-", "_")](asked, Source("", {}))
    claim = Claim(id="proved", location=Location("", beside=True), place="", **form)
    _keystore, _accesses, engine = posed(path, (claim,), given)
    [result] = combine_claims((claim,), engine.systems, {"native": engine.claim_answers()}, given.names)
    return result


def within(implementation: Implementation) -> set[str]:
    """The smallest compartment: participants that the property names, and all who get something of theirs."""
    inside, before = {*implementation.source}, -1
    while before < len(inside):
        before = len(inside)
        for peers, name in implementation.places:
            for _way, held, whom in implementation.hops(peers, name, inside):
                inside |= {who for who, does in whom.items() if held and does} & implementation.free
    return inside
