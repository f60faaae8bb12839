"""KA4 and KA5: the domains that documents name (DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.3; RTPS 2.5, 9.6.2.3)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.document import MAX_DOMAIN, DomainRange
from keystore_audit.keystore.permissions import Grant
from keystore_audit.model.domains import covered, describe, domain_bits
from keystore_audit.profiles import VARIANTS
from keystore_audit.remedy import Act, decision
from keystore_audit.rules.context import Context
from keystore_audit.rules.permissions import about
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import in_governance, in_permissions
from keystore_audit.rules.subjects import DocumentUse, GovernanceUse, PermissionsUse, speaks, taken
from keystore_audit.rules.wording import sole


def meet(some: Iterable[DomainRange], others: Iterable[DomainRange]) -> bool:
    """Whether they share a domain."""
    return bool(domain_bits(covered(some)) & domain_bits(covered(others)))


def _open_range(domains: DomainRange) -> str | None:
    """What an `<id_range>` with one bound means to whom, None where it has both."""
    if domains.high is None and domains.low is not None:
        return (
            f"<id_range> has no <max>: Fast DDS and Cyclone DDS read domain {domains.low} alone, the specification and "
            "OpenDDS everything from it on"
        )
    if domains.low is None and domains.high is not None:
        return f"<id_range> has no <min>: Cyclone DDS refuses the document, the others read 0 to {domains.high}"
    return "<id_range> has no bounds: implementations differ in what they read" if domains.low is None else None


@rule(
    "KA419",
    Severity.MEDIUM,
    clause="DDS-Security 1.1, 9.4.1.2.4 and its governance XSD (id_range); measured",
    remedy=in_governance("Write both <min> and <max>"),
    applies=speaks,
)
def domain_range_open(use: GovernanceUse, _context: Context) -> Iterator[Violation]:
    """An <id_range> lacks <min> or <max>, and implementations read different domains in it (measured)."""
    for domains in use.document.domains:
        why = _open_range(domains)
        if why is not None:
            yield Violation(
                message=f"{why}.",
                locations=(use.at(domains.line),),
                enclave=sole(use.enclaves),
                key=f"{domains.low} {domains.high}",
            )


_LIMITED: Final = tuple(profile for profile in VARIANTS.values() if profile.access.highest_domain is not None)
_HIGHEST: Final = min(filter(None, (profile.access.highest_domain for profile in _LIMITED)))
"""Cyclone DDS, access_control_parser.c: it refuses the whole document above it (measured)."""


@rule(
    "KA420",
    Severity.MEDIUM,
    clause="RTPS 2.5, 9.6.2.3 (ports of a domain); measured on Cyclone DDS",
    remedy=decision("Use domain ids up to 230.", Act.EDIT),
    applies=taken,
    stops=True,
)
def domain_above_230(use: DocumentUse, context: Context) -> Iterator[Violation]:
    """A governance or permissions document names a domain above 230.

    Cyclone DDS refuses the whole document, so that its enclaves start in no domain: high where it is among the chosen
    profiles. Above 232 there are no ports.
    """
    for domains in _ranges(use):
        highest = max(domains.low or 0, domains.high or 0)
        if highest > _HIGHEST:
            yield Violation(
                message=f"Domain {highest}, expected at most {_HIGHEST} (ports end at {MAX_DOMAIN}): "
                "Cyclone DDS refuses the whole document.",
                locations=(use.at(domains.line),),
                enclave=sole(use.enclaves),
                severity=Severity.HIGH if context.chose(_LIMITED) else None,
                profiles=tuple(profile.name for profile in _LIMITED) if highest <= MAX_DOMAIN else (),
                key=f"{domains.low} {domains.high}",
            )


def _ranges(use: DocumentUse) -> Iterator[DomainRange]:
    """Every range of domains of the document."""
    if isinstance(use, GovernanceUse):
        yield from use.document.domains
    if isinstance(use, PermissionsUse):
        for grant in use.document.grants:
            for permission_rule in grant.rules:
                yield from permission_rule.domains


@rule(
    "KA508",
    Severity.HIGH,
    clause="DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.3 (domains)",
    remedy=decision(
        "Let both name one domain, that of ROS_DOMAIN_ID on the robots, in the .xml. If enclaves carry "
        "different governances (KA416), begin there.",
        Act.EDIT,
    ),
    applies=speaks,
    stops=True,
)
def grant_outside_governance_domains(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """No allow rule of the enclave's grant names a domain that its governance covers, so that it can take part in none.

    Fast DDS creates the participant all the same, and peers refuse its endpoints (measured).
    """
    grants: dict[str, Grant] = {}
    for grant in use.document.grants:
        grants.setdefault(grant.subject_name.text, grant)
    for enclave in use.enclaves:
        file, first = enclave.governance, enclave.identity
        own = grants.get(first.subject) if first is not None else None
        if file is None or file.governance is None or own is None or own.default_allow:
            continue
        governed, allowed = file.domains, own.allowed_domains
        if allowed and not meet(governed, allowed):
            yield Violation(
                message=f"{enclave.path} can take part in no domain: its grant allows domain "
                f"{describe(covered(allowed))}, its governance covers {describe(covered(governed))}.",
                locations=(
                    use.at(own.line),
                    Location(path=file.signed.file.place, line=file.governance.line, message="the governance"),
                ),
                enclave=enclave.path,
                key=own.subject_name.text,
            )


@rule(
    "KA515",
    Severity.MEDIUM,
    clause="DDS-Security 1.1, 9.4.1.3 and its permissions XSD (id_range); measured",
    remedy=in_permissions("Write both <min> and <max>"),
    applies=speaks,
)
def rule_domain_range_open(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """An <id_range> of a rule lacks <min> or <max>, and implementations read different domains in it (measured).

    Critical without <min>: evaluating such a rule crashes Cyclone DDS 0.10.2 (measured with its plugin). Permissions
    come from peers too, so that one signed document takes others down.
    """
    for grant in use.document.grants:
        for permission_rule in grant.rules:
            for domains in permission_rule.domains:
                why = _open_range(domains)
                if why is not None:
                    key = f"{grant.subject_name.text} {domains.low} {domains.high}"
                    crashes = domains.low is None
                    message = (
                        f"{why}.{' Cyclone DDS 0.10 dies when it comes to the rule (measured).' if crashes else ''}"
                    )
                    severity = Severity.CRITICAL if crashes else None
                    yield about(use, grant, domains.line, message, key=key, severity=severity)
