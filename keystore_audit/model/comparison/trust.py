"""What changed in what trust rests on: enclaves, identities, authorities, signatures, their form and their dates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Final

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.public_key import is_weak_algorithm, is_weak_kind
from keystore_audit.model.comparison.change import Aspect, Direction, direction_of, joint_direction
from keystore_audit.model.comparison.facts import (
    ADDED,
    AUTHORITY,
    FILE,
    REMOVED,
    SUBJECT,
    Draft,
    dated,
    fact,
    folded,
    listing,
    parted,
    place_of,
    placed,
    turned,
)
from keystore_audit.model.comparison.identities import (
    MAX_PATHS,
    foreign_keys,
    identities_certified_again,
    identities_let_in,
    shared_keys,
    weak_keys,
)
from keystore_audit.model.comparison.revocation import revocation_facts
from keystore_audit.model.comparison.sides import Sides
from keystore_audit.model.inventory import Typed, authorities_of, beside_enclaves, governance_apart
from keystore_audit.model.trust.chain import authority_files
from keystore_audit.model.trust.verdicts import envelope, may_have_issued
from keystore_audit.text import some
from keystore_audit.truth import Truth

FORM: Final = "document-form"
_AUTHORITIES: Final = {Role.IDENTITY_CA: "identity CA", Role.PERMISSIONS_CA: "permissions CA"}
_PRESENCE: Final = {
    Role.IDENTITY_CA: "identity CA file",
    Role.CERTIFICATE: "identity certificate",
    Role.PERMISSIONS_CA: "permissions CA file",
    Role.GOVERNANCE: "governance",
}
"""Files whose absence is a change of its own. Missing permissions already show as missing rights."""


def trust_changes(sides: Sides) -> Iterator[Draft]:
    """One draft for each change, of all enclaves that have it."""
    yield from _of_keystores(sides)
    yield from _anchors(sides)
    yield from identities_let_in(sides)
    yield from _of_enclaves(sides)
    yield from weak_keys(sides)
    of_enclaves = (replace(each, enclaves=(path,)) for path in sides.common for each in _facts(path, sides))
    found = chain(shared_keys(sides), foreign_keys(sides), identities_certified_again(sides), of_enclaves)
    yield from folded(found, sides, complete=True)


def _of_keystores(sides: Sides) -> Iterator[Draft]:
    """The layout, and what only one keystore has, by what identifies it, with the place of the first."""
    kinds = [keystore.layout.kind.value for keystore in sides.keystores]
    if kinds[0] != kinds[1]:
        yield fact("layout", Direction.INFO, "the layout", Aspect("layout", kinds[0], kinds[1], Direction.INFO))
    tables: tuple[dict[str, dict[str, str]], ...] = {}, {}
    kinds_of: dict[str, str] = {}
    for table, keystore in zip(tables, sides.keystores, strict=True):
        for kind, what, key, place in _lying(keystore):
            table.setdefault(what, {})[key] = place
            kinds_of[what] = kind
    for what, kind in kinds_of.items():
        gone, come, direction = parted(*(table.get(what, {}) for table in tables))
        if gone or come:
            verb = "is there" if not gone else ("is no longer there" if not come else "is another")
            places = (Location(path=min(each)) if each else None for each in (gone, come))
            yield from placed([fact(kind, direction, f"{what} {verb}")], places)


def _lying(keystore: Keystore) -> Iterator[tuple[str, str, str, str]]:
    """What lies in the keystore that no enclave owns: kind of change and words, key or digest, place."""
    beside = beside_enclaves(keystore)
    for each in keystore.authority_keys:
        what = (
            f"the private key of an authority{', among the files that robots get,' if beside(each.file.place) else ''}"
        )
        yield "authority-key", what, each.key or each.file.place, each.file.place
    own = {enclave.key.file.place for enclave in keystore.enclaves if enclave.key is not None}
    own |= {key.file.place for key in keystore.authority_keys}  # one too large to be read is known by its hash
    for file in keystore.private_keys:
        if file.place not in own:
            yield "private-key", "a private key that is no enclave's", file.sha256 or file.place, file.place
    for certificate in _certified(keystore):
        what = "a certificate of no enclave that an authority issued"
        yield "certificate-at-large", what, certificate.sha256, certificate.path
    for file in (each.file for each in governance_apart(keystore)):
        what = "a signed governance that no enclave carries"
        yield "governance-at-large", what, file.sha256 or file.place, file.place


def _certified(keystore: Keystore) -> Iterator[Certificate]:
    """Certificates that an authority of the enclaves issued, of no enclave's key and without a private key here."""
    if not keystore.identities.keyless:  # nearly always
        return
    own = {enclave.identity.key for enclave in keystore.enclaves if enclave.identity is not None}
    authorities = {each.sha256: each for each in authorities_of(keystore)}
    for certificate in keystore.identities.keyless:
        others = (each for sha256, each in authorities.items() if sha256 != certificate.sha256)
        if certificate.key not in own and any(may_have_issued(each, certificate) for each in others):
            yield certificate


def _anchors(sides: Sides) -> Iterator[Draft]:
    """Authorities that came or went only in files of no common enclave: in public/, or of other enclaves."""
    for role, word in _AUTHORITIES.items():
        told = set[str]()
        for path in sides.common:
            one, other = ({c.key for c in by_path[path].trusts(role)} for by_path in sides.enclaves)
            told |= one ^ other
        held = []
        for keystore in sides.keystores:
            public, read = authority_files(keystore, role)
            files = [*([public] if public else ()), *(file for file, _enclaves in read)]
            held.append({c.key: c for file in files for c in file.certificates if c.key not in told})
        gone, come, direction = parted(*held)
        if gone or come:
            what = f"the {word} in public/, or of enclaves that only one keystore has, is another"
            found = fact(AUTHORITY, direction, what, Aspect(word, _told(gone), _told(come), direction))
            yield from placed([found], (place_of(next(iter(each), None)) for each in (gone, come)))


def _of_enclaves(sides: Sides) -> Iterator[Draft]:
    """Enclaves of one keystore alone."""
    old, new = sides.enclaves
    for gained, kind, verb, here, there in (
        (True, ADDED, "was added", new, old),
        (False, REMOVED, "was removed", old, new),
    ):
        paths = [path for path in here if path not in there]
        if paths:
            place = Location(path=here[paths[0]].files.directory)
            found = fact(kind, Direction.GAINED if gained else Direction.LOST, verb)
            yield from placed([found], (None, place) if gained else (place, None), *paths)


def _facts(path: str, sides: Sides) -> Iterator[Draft]:
    """Everything that changed of an enclave."""
    old, new = (by_path[path] for by_path in sides.enclaves)
    yield from _presences(old, new)
    authorities = list(_authorities(old, new))
    yield from authorities
    changed = {aspect.what for each in authorities for aspect in each.aspects}
    yield from _identity(old, new, sides, reissued=_AUTHORITIES[Role.IDENTITY_CA] in changed)
    for word, one, other, places in documents(old, new):
        authority = (
            _AUTHORITIES[Role.PERMISSIONS_CA] in changed and _by_authority(one, old) and _by_authority(other, new)
        )
        found = [
            *_signature(word, one, other, moved=authority),
            *(_form(word, one, other) if sides.is_read(path) else ()),
        ]
        yield from placed(found, places)
    yield from revocation_facts(old, new, sides)


def _presences(old: Enclave, new: Enclave) -> Iterator[Draft]:
    for role, word in _PRESENCE.items():
        files = old.files.files[role], new.files.files[role]
        if not any(file.status.unknown for file in files):
            there = (file.status is Status.PRESENT for file in files)
            found = turned(FILE, f"its {word}", "is there", "is no longer there", *there)
            yield from placed(found, (Location(path=file.path) for file in files))


def _identity(old: Enclave, new: Enclave, sides: Sides, *, reissued: bool) -> Iterator[Draft]:
    """The identity certificate. `reissued`: its CA is another, so that the identity had to be another too."""
    one, other = old.identity, new.identity
    if one is None or other is None or one.sha256 == other.sha256:
        return
    facts = [*_identity_facts(one, other), *(() if reissued else _issuer_facts(old, new, sides))]
    if not facts and not reissued:
        facts.append(fact("reissued", Direction.INFO, "its identity certificate was issued again, with its key"))
    yield from placed(facts, (place_of(one), place_of(other)))


def _identity_facts(one: Certificate, other: Certificate) -> Iterator[Draft]:
    changed = Direction.CHANGED
    if one.key != other.key:
        yield fact("identity-key", changed, "its identity has another key")
    if one.subject != other.subject:
        aspect = Aspect("subject", one.subject, other.subject, changed)
        yield fact(SUBJECT, changed, "its identity has another subject", aspect)
    words = "its identity", "is an authority", "is no longer an authority"
    yield from turned("identity-authority", *words, one.is_ca, other.is_ca)
    yield from _issued_again("identity-validity", "its identity certificate", one, other)


def _issuer_facts(old: Enclave, new: Enclave, sides: Sides) -> Iterator[Draft]:
    """Whether another authority of the same CA file issued the identity, or none of them. Also whether other enclaves
    let it in for that: an attacker's own files do not matter.
    """
    issuers = [
        [c for c in enclave.trusts(Role.IDENTITY_CA) if enclave.identity and may_have_issued(c, enclave.identity)]
        for enclave in (old, new)
    ]
    issuer = []
    if {c.key for c in issuers[0]} != {c.key for c in issuers[1]}:
        issuer.append(Aspect("issuer", _told(issuers[0]), _told(issuers[1]), Direction.CHANGED))
    peers = gathered(((gone, come), name) for pair, gone, come in sides.letting_in(new.path) for name in pair.profiles)
    for (gone, come), profiles in peers.items():
        direction = direction_of(come, gone)
        paths = [some(sorted(each), MAX_PATHS) or None for each in (gone, come)]
        told = [Aspect("let in by", paths[0], paths[1], direction)] if gone | come else []
        if issuer or told:
            what = "its identity was issued by another authority" if issuer else "other enclaves let its identity in"
            yield replace(fact("identity-issuer", direction, what, *issuer, *told), profiles=sides.in_order(profiles))


def _authorities(old: Enclave, new: Enclave) -> Iterator[Draft]:
    """The CA files; one file for both roles is one change."""
    roles = (
        ("identity CA", old.identity_ca, new.identity_ca),
        ("permissions CA", old.permissions_ca, new.permissions_ca),
    )
    files = ((word, before, after) for word, before, after in roles if before is not None and after is not None)
    found = gathered(
        (tuple(tuple(c.sha256 for c in file.certificates) for file in (before, after)), (word, before, after))
        for word, before, after in files
    )
    for (one, other), several in found.items():
        _word, before, after = several[0]
        if one != other:
            facts = _authority_facts([word for word, _before, _after in several], before, after)
            yield from placed(facts, (place_of(before.first), place_of(after.first)))


def _authority_facts(roles: list[str], before: CertificateFile, after: CertificateFile) -> Iterator[Draft]:
    words = " and ".join(roles)
    old, new = ({certificate.key: certificate for certificate in file.certificates} for file in (before, after))
    gone, come, direction = parted(old, new)
    if gone or come:
        others, have = ("are others", "have") if len(roles) > 1 else ("is another", "has")
        verb = others if gone and come else f"{have} {'more' if come else 'fewer'} keys"
        aspects = (Aspect(role, _told(gone), _told(come), direction) for role in roles)
        yield fact(AUTHORITY, direction, f"the {words} {verb}", *aspects)
        return
    reissued = [
        each for key, one in old.items() for each in _issued_again("authority-validity", f"the {words}", one, new[key])
    ]
    yield from reissued
    if [c.key for c in before.certificates] != [c.key for c in after.certificates]:
        yield fact("authority-order", Direction.CHANGED, f"the {words} have another order")
    elif not reissued:
        yield fact("reissued", Direction.INFO, f"the {words}: issued again, with the same key")


def _told(certificates: Iterable[Certificate]) -> str | None:
    """Subjects with the beginning of the key's hash: all authorities of sros2 have one name."""
    return ", ".join(f"{c.subject} (key {c.key[:12]})" for c in certificates) or None


def documents(old: Enclave, new: Enclave) -> Iterator[tuple[str, Typed, Typed, tuple[Location, Location]]]:
    """Each document that both have, and where."""
    for word, one, other in (
        ("governance", old.governance, new.governance),
        ("permissions", old.permissions, new.permissions),
    ):
        if one is not None and other is not None:
            yield word, one, other, (Location(path=one.signed.file.place), Location(path=other.signed.file.place))


def _signature(word: str, one: Typed, other: Typed, *, moved: bool) -> Iterator[Draft]:
    """Whether the signature holds, and who made it. `moved`: the permissions CA did, and is another."""
    before, after = envelope(one.signed), envelope(other.signed)
    holds = [each.verdict is Truth.YES for each in (before, after)]
    yield from turned("signature", f"the signature of its {word}", "holds", "no longer holds", *holds)
    if holds[0] == holds[1] and not moved and {c.key for c in before.signers} != {c.key for c in after.signers}:
        aspect = Aspect("signer", _told(before.signers), _told(after.signers), Direction.MIXED)
        verb = "were" if word == "permissions" else "was"
        yield fact("signer", Direction.MIXED, f"its {word} {verb} signed by somebody else", aspect)


def _by_authority(document: Typed, enclave: Enclave) -> bool:
    """Whether the enclave's permissions CA signed it."""
    keys = {certificate.key for certificate in enclave.trusts(Role.PERMISSIONS_CA)}
    return all(signer.key in keys for signer in envelope(document.signed).signers)


def _form(word: str, one: Typed, other: Typed) -> Iterator[Draft]:
    """A document signed again in another form, unless that decides whether its signature holds.

    A weak digest is less protection: others may have the signature.
    """
    alike = envelope(one.signed).verdict is envelope(other.signed).verdict
    if not alike or one.signed.file.sha256 == other.signed.file.sha256:
        return
    digests = [", ".join(sorted({each.digest for each in file.signed.signatures})) or None for file in (one, other)]
    defects = [{each.kind for each in (*file.signed.defects, *file.defects)} for file in (one, other)]
    weak = [Kind.WEAK_DIGEST in each for each in defects]
    aspects = []
    if digests[0] != digests[1] or weak[0] != weak[1]:
        aspects.append(_weaker("digest", digests[0], digests[1], *weak))
    gone, come = ({each.value for each in defects[n] - defects[1 - n] - {Kind.WEAK_DIGEST}} for n in (0, 1))
    if gone or come:
        aspects.append(listing("out of order", gone, come, Direction.CHANGED))
    if aspects:
        yield fact(FORM, joint_direction(aspects), f"its {word}: signed again in another form", *aspects)


def _issued_again(kind: str, what: str, old: Certificate, new: Certificate) -> Iterator[Draft]:
    """Dates and form of a certificate issued again; a weak key or signature is less protection."""
    if old.sha256 == new.sha256:
        return
    yield from dated(kind, what, (old.not_before, old.not_after), (new.not_before, new.not_after))
    aspects = [
        _weaker(name, one, other, is_weak(one), is_weak(other))
        for name, one, other, is_weak in (
            ("key", old.key_kind, new.key_kind, is_weak_kind),
            ("signature algorithm", old.signature_algorithm, new.signature_algorithm, is_weak_algorithm),
        )
        if one != other
    ]
    if bool(old.is_ca) == bool(new.is_ca):  # else that is a change of its own, and accounts for the rest
        forms = [_form_of(certificate) for certificate in (old, new)]
        differ = (name for name in forms[0] if forms[0][name] != forms[1][name])
        aspects += [Aspect(name, forms[0][name], forms[1][name], Direction.CHANGED) for name in differ]
    if aspects:
        yield fact("certificate-form", joint_direction(aspects), f"{what}: another form than before", *aspects)


def _weaker(what: str, old: str | None, new: str | None, was_weak: bool, is_weak: bool) -> Aspect:
    """Which of two weak ones is worse is not judged: replacing one by another is both a gain and a loss."""
    return Aspect(what, old, new, direction_of(is_weak, was_weak))


def _form_of(certificate: Certificate) -> dict[str, str | None]:
    return {
        "key usage": _listed(certificate.key_usage),
        "extended key usage": _listed(certificate.extended_key_usage),
        "path length": None if certificate.path_length is None else str(certificate.path_length),
        "constraints": _listed(certificate.constraints),
        "unknown critical extensions": _listed(certificate.unknown_critical),
    }


def _listed(values: Iterable[str] | None) -> str | None:
    return None if values is None else ", ".join(sorted(values)) or "nothing"
