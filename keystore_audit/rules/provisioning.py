"""KA6: what a robot is given beside its keystore, what robots share, and how long it lasts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from os.path import abspath, basename, relpath
from typing import Final

from keystore_audit.findings import Location, Severity, decision
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.identity import Identity, LooseKey, alike, compared_of
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.rules.permissions import own_grants
from keystore_audit.rules.registry import Context, Violation, located, more_like, quoted, rule
from keystore_audit.rules.subjects import instant_of, permissions_uses
from keystore_audit.text import counted, instant

LONGEST: Final = timedelta(days=2 * 366)
"""How long an identity or a grant may last: NIST SP 800-57 part 1 has one to two years for authentication keys."""

_LATER: Final = timedelta(days=1)
"""How much later than its certificate an enclave's permissions are signed where both were made in one go."""

_ASTRAY: Final = decision(
    "Delete the key where it does not belong. Whoever had that robot may have a copy: give the key's enclave a new "
    "identity. Revoke the old certificate, or let no grant name its subject."
)

_Shared = tuple[Enclave, Certificate, Identity]


def _deployed(_keystore: Keystore, context: Context) -> bool:
    return context.deployed


@rule(
    "KA665",
    Severity.LOW,
    "NIST SP 800-57 part 1 revision 5, 5.3.6 (one to two years for authentication keys)",
    decision(
        "Issue identities for a year or two (`openssl x509 -req -days 365`), not for ten as sros2 does. Set "
        "<not_after> in permissions.xml likewise before you sign it, and renew both in time."
    ),
    applies=_deployed,
)
def long_validity(keystore: Keystore) -> Iterator[Violation]:
    """Identities or grants are valid for more than two years.

    A lost, sold or compromised robot keeps its identity and rights until they end. Without revocation lists, which no
    run time demands, nothing else ends them. Checked only with --deployed. Not checked: authorities, which have to
    outlast what they issue, and grants for others than the enclaves that carry them.
    """
    certificates = [each for each in _identities(keystore) if each[1].not_after - each[1].not_before > LONGEST]
    lasting = [(c.not_after, e.path, located(c)) for e, c in certificates]
    grants = list(_long_grants(keystore))
    if lasting or grants:
        end, whose, _place = max([*lasting, *grants], key=lambda found: found[0])
        told = [counted(len(lasting), "identity", "identities")] if lasting else []
        told += [counted(len(grants), "grant")] if grants else []
        yield Violation(
            f"Valid for more than two years: {' and '.join(told)}, the longest until {instant(end)} ({whose}).",
            [place for _end, _whose, place in (*lasting, *grants)],
            key="\n".join(sorted(f"{whose} {instant(end)}" for end, whose, _place in (*lasting, *grants))),
        )


def _identities(keystore: Keystore) -> Iterator[tuple[Enclave, Certificate]]:
    for enclave in keystore.enclaves:
        if enclave.identity is not None:
            yield enclave, enclave.identity


def _long_grants(keystore: Keystore) -> Iterator[tuple[datetime, str, Location]]:
    """Grants of enclaves that last too long: their end, the enclave's path and their line."""
    for use in permissions_uses(keystore):
        for grant in own_grants(use) if use.speaks else ():
            start, end = instant_of(grant.not_before), instant_of(grant.not_after)
            if start is not None and end is not None and end - start > LONGEST:
                place = use.at(grant.not_after.line)
                yield end, use.enclaves[0].path, place


@rule(
    "KA666",
    Severity.HIGH,
    "DDS-Security 1.1, 9.3.1 (the identity of a participant); CWE-321",
    decision("Give every robot its own keys and subjects, for example /robot1/talker and /robot2/talker."),
    applies=lambda _keystore, context: context.beside is not None,
)
def identity_shared_by_robots(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave here and one in another keystore of this run share an identity key, or a subject under one CA.

    With one key, whoever takes one robot passes for the other, and revoking one certificate stops both. The same holds
    if one's key lies in the other keystore, as in a backup. With one subject (medium), a grant for either is one for
    both, since peers find grants by subject. Only keystores of one run are compared. If an audit reads other identities
    than were compared, it is incomplete.
    """
    beside = context.beside
    if beside is None:
        return
    if beside.compared != compared_of(keystore):
        yield Violation(
            "The identities here have changed since they were compared with the other keystores': who shares "
            "them is unknown.",
            (Location("."),),
            remedy=decision("Run the audit again while nobody writes into the keystore."),
            undecided=True,
            key="changed",
        )
    by_key, by_subject = defaultdict(list), defaultdict(list)
    for other in beside.shared.identities:
        by_key[other.key].append(other)
        by_subject[other.subject_alike].append(other)
    same_key: list[_Shared] = []
    same_subject: list[_Shared] = []
    for enclave, certificate in _identities(keystore):
        keys = {authority.key for authority in enclave.trusts(Role.IDENTITY_CA)}
        same_key += [(enclave, certificate, other) for other in by_key[certificate.key]]
        same_subject += [
            (enclave, certificate, other)
            for other in by_subject[alike(certificate.subject)]
            if other.key != certificate.key and keys & other.authorities
        ]
    says = "have one identity key: each passes for the other, and revoking one stops both"
    yield from _shared(keystore, same_key, says, "the same key")
    says = "have one subject under one identity CA: a grant for either is one for both"
    yield from _shared(keystore, same_subject, says, "the same subject", severity=Severity.MEDIUM)
    own = {certificate.key: (enclave, certificate) for enclave, certificate in _identities(keystore)}
    inside = tuple(f"{path}/" for path in beside.apart)
    here = [loose for loose in beside.compared.keys if loose.key not in own and not loose.path.startswith(inside)]
    yield from _astray(keystore, [(loose, other) for loose in here for other in by_key[loose.key]])
    yield from _lying_elsewhere(
        keystore, [(*own[loose.key], loose) for loose in beside.shared.keys if loose.key in own]
    )


def _astray(keystore: Keystore, found: Sequence[tuple[LooseKey, Identity]]) -> Iterator[Violation]:
    """One violation for all keys of other robots' enclaves that lie here."""
    if found:
        loose, other = found[0]
        whose = (Location(o.beside, o.line, message="its certificate", beside=True) for _key, o in found)
        yield Violation(
            f"{quoted(loose.path)} holds the identity key of {other.enclave} in {quoted(other.root)}"
            f"{more_like(found, '')}: whoever takes this robot passes for that one.",
            (*(Location(loose.path) for loose, _other in found), *whose),
            remedy=_ASTRAY,
            key="\n".join(sorted(f"{k.path} {relpath(o.root, keystore.root)} {o.path} {k.key}" for k, o in found)),
        )


def _lying_elsewhere(keystore: Keystore, found: Sequence[tuple[Enclave, Certificate, LooseKey]]) -> Iterator[Violation]:
    """The same where keys of enclaves here lie there."""
    if found:
        enclave, _certificate, loose = found[0]
        ours = (Location(certificate.path, certificate.line) for _enclave, certificate, _key in found)
        theirs = (Location(key.beside, message="its key", beside=True) for _enclave, _certificate, key in found)
        yield Violation(
            f"The identity key of {enclave.path} lies in {quoted(loose.root)}, too, in {quoted(loose.path)}"
            f"{more_like(found, '')}: whoever takes that robot passes for this one.",
            (*ours, *theirs),
            remedy=_ASTRAY,
            enclave=enclave.path if len({each.path for each, _certificate, _key in found}) == 1 else None,
            key="\n".join(sorted(f"{e.path} {relpath(k.root, keystore.root)} {k.path}" for e, _cert, k in found)),
        )


def _shared(
    keystore: Keystore, found: Sequence[_Shared], says: str, why: str, severity: Severity | None = None
) -> Iterator[Violation]:
    """One violation for all enclaves that share something with others."""
    if not found:
        return
    enclave, _certificate, other = found[0]
    locations = []
    for _enclave, certificate, twin in found:
        locations.append(located(certificate))
        locations.append(Location(twin.beside, twin.line, message=why, beside=True))
    yield Violation(
        f"{enclave.path} and {other.enclave} in {quoted(other.root)} {says}{more_like(found, '')}.",
        locations,
        enclave=enclave.path if len({shared[0].path for shared in found}) == 1 else None,
        severity=severity,
        key="\n".join([why, basename(abspath(keystore.root)), *sorted(_twins(keystore, found))]),
    )


def _twins(keystore: Keystore, found: Sequence[_Shared]) -> set[str]:
    """What is shared with whom; keystores by where they lie beside this one, wherever the run looks for them."""
    return {
        f"{enclave.path} {relpath(twin.root, keystore.root)} {twin.path} {twin.key}" for enclave, _own, twin in found
    }


@rule(
    "KA667",
    Severity.INFO,
    "RFC 5652, 11.3 (signingTime); DDS-Security 1.1, 9.4.1.3 (grants name a subject, and have dates)",
    decision(
        "Issue the identity again under another subject if rights were taken away, or wait until older "
        "documents have expired."
    ),
    applies=_deployed,
)
def certificate_older_than_permissions(keystore: Keystore) -> Iterator[Violation]:
    """Permissions were signed more than a day after their certificate was issued.

    So it is if rights changed and the identity was kept. Earlier permissions, if there were any, count until their
    dates end. The signer itself states the time. Checked only with --deployed, if the permissions CA signed.
    """
    later: dict[str, tuple[datetime, datetime, Location]] = {}
    for use in permissions_uses(keystore):
        times = [signature.signing_time for signature in use.signed.signatures if signature.signing_time is not None]
        for enclave in use.enclaves if times and use.genuine_everywhere else ():
            first = enclave.identity
            if first is not None and min(times) - first.not_before > _LATER:
                later[enclave.path] = (first.not_before, min(times), use.at(None))
    if later:
        path, (issued, signed, _place) = next(iter(later.items()))
        yield Violation(
            f"{path} has a certificate of {instant(issued)} and permissions that were signed at "
            f"{instant(signed)}{more_like(later, '')}: if there were others before, they still count.",
            [place for _issued, _signed, place in later.values()],
            key="\n".join(sorted(f"{each} {issued} {signed}" for each, (issued, signed, _place) in later.items())),
            enclave=path if len(later) == 1 else None,
        )
