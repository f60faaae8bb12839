"""KA5: which identities implementations take the subject name of a grant to name (DDS-Security 1.1, 9.4.1.3)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import lru_cache
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.grouped import grouped
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.permissions import Grant
from keystore_audit.model.inventory import identities_at_large
from keystore_audit.model.subjects.comparison import matching, same_meaning
from keystore_audit.profiles import VARIANTS, Profile, SubjectComparison, implementations
from keystore_audit.remedy import Act, decision
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.subjects import PermissionsUse, permissions_uses
from keystore_audit.rules.wording import located, places, quoted

_SAFE_FORM: Final = (
    "Use subjects that every implementation reads alike: one CN, the enclave's path, whose parts are not all parts of "
    "another enclave's path; in the grant `CN=/path` to the letter, ASCII, without blanks, quotes and escapes. Issue "
    "the certificates again where that changes a subject."
)

_Named = tuple[Grant, PermissionsUse, Certificate, tuple[Profile, ...]]
"""A grant, the document that holds it, a certificate, and the variants under which the grant names it."""


def _identities(keystore: Keystore) -> dict[str, Certificate]:
    """Those of enclaves, by SHA-256."""
    firsts = (enclave.identity for enclave in keystore.enclaves)
    return {first.sha256: first for first in firsts if first is not None}


@lru_cache(maxsize=1)  # both rules ask
def _named(keystore: Keystore, at: datetime) -> tuple[_Named, ...]:
    """Of identities at large as well, of which it is known that somebody has the key."""
    at_large = {e.certificate.sha256: e.certificate for e in identities_at_large(keystore, at) if e.key is None}
    return tuple(_grants_and_identities(keystore, [*(at_large | _identities(keystore)).values()]))


def _grants_and_identities(keystore: Keystore, identities: Sequence[Certificate]) -> Iterator[_Named]:
    """Each grant of a document that may be taken, with each identity that some variants, not all, take it to name."""
    held = ((grant, use) for use in permissions_uses(keystore) if use.speaks for grant in use.document.grants)
    grants = grouped(held, lambda each: each[0].subject_name.text)
    tables = {comparison: matching(list(grants), identities, comparison) for comparison in SubjectComparison}
    for subject, holders in grants.items():
        for number in dict.fromkeys(number for table in tables.values() for number in table[subject]):
            comparisons = [comparison for comparison, table in tables.items() if number in table[subject]]
            if len(comparisons) < len(tables):
                naming = tuple(p for p in VARIANTS.values() if p.trust.subjects in comparisons)
                for grant, use in holders:
                    yield grant, use, identities[number], naming


@rule(
    "KA519",
    Severity.CRITICAL,
    clause="DDS-Security 1.1, 9.4.1.3 (subject_name); DistinguishedName.cpp of Fast DDS, access_control_utils.c of "
    "Cyclone DDS; measured",
    remedy=decision(_SAFE_FORM, Act.EDIT_PERMISSIONS),
)
def grant_names_another_subject(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Some implementation takes a grant to name an identity whose subject is another one.

    Peers take whatever validly signed document an enclave presents, so that this identity has the rights of the grant.
    Fast DDS since 2.14 counts attributes and looks each up by its type, so that a repeated one stands for others.
    Cyclone DDS cuts names at `,`, `/` and `|` and wants every piece of the certificate's in the grant's: `/robot` has
    the rights of `/robot/arm`, and `/arm/robot` as well. High where no chosen profile does so. Identities that no
    enclave has count where somebody has the key and an identity CA vouches for them (KA228, KA668).
    """
    enclaves = _identities(keystore)
    subjects = {each.subject for each in enclaves.values()}
    for grant, use, certificate, naming in _named(keystore, context.at):
        # Text of the same meaning, in another order say, is another subject where an identity has the text itself.
        to_the_letter = grant.subject_name.text in subjects and grant.subject_name.text != certificate.subject
        if same_meaning(grant.subject_name.text, certificate) and not to_the_letter:
            continue
        whoever = (
            "that enclave" if certificate.sha256 in enclaves else f"whoever has the identity in {certificate.path}"
        )
        yield Violation(
            message=f"The grant of {quoted(grant.subject_name.text)} names {quoted(certificate.subject)} too, for "
            f"{implementations(naming)}: {whoever} has its rights.",
            locations=_places(use, grant, certificate),
            severity=None if context.chose(naming) else Severity.HIGH,
            profiles=tuple(profile.name for profile in naming),
            key=f"{grant.subject_name.text}\0{certificate.subject}",
        )


@rule(
    "KA520",
    Severity.HIGH,
    clause="DDS-Security 1.1, 9.4.1.3 (subject_name); RFC 2253; measured",
    remedy=decision(
        "Write <subject_name> as the message writes the identity's subject. Where that is read "
        f"differently too: {_SAFE_FORM}",
        Act.EDIT_PERMISSIONS,
    ),
    stops=True,
)
def subject_read_differently(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A grant means an identity, and some implementations do not find it: the enclave has no rights there.

    Order, blanks, quotes, escapes, characters beyond ASCII and repeated attributes are read differently. High where a
    chosen profile does not find it, else low.
    """
    enclaves = _identities(keystore)
    for grant, use, certificate, naming in _named(keystore, context.at):
        if certificate.sha256 not in enclaves or not same_meaning(grant.subject_name.text, certificate):
            continue
        missing = [profile for profile in VARIANTS.values() if profile not in naming]
        yield Violation(
            message=f"The grant of {quoted(grant.subject_name.text)} does not name the identity "
            f"{quoted(certificate.subject)} for {implementations(missing)}, though it means that subject.",
            locations=_places(use, grant, certificate),
            severity=None if context.chose(missing) else Severity.LOW,
            profiles=tuple(profile.name for profile in missing),
            key=f"{grant.subject_name.text}\0{certificate.subject}",
        )


def _places(use: PermissionsUse, grant: Grant, certificate: Certificate) -> tuple[Location, ...]:
    return places((use.at(grant.subject_name.line), located(certificate, "the identity")))
