"""What changed in what trust rests on: enclaves, identities, authorities, signatures, revocations, dates."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final, TypeVar

from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.comparison.change import Aspect, Direction, Layer, direction_of
from keystore_audit.model.comparison.drafts import Draft, in_order
from keystore_audit.model.comparison.facts import Dates, Fact, Placed, dated, listing, place_of, spanned
from keystore_audit.model.comparison.form import certificate_form, document_form
from keystore_audit.model.comparison.identities import MAX_PATHS, identities_certified_again, identities_let_in
from keystore_audit.model.comparison.keys import foreign_keys, weak_keys
from keystore_audit.model.comparison.revocation import revocation_facts
from keystore_audit.model.comparison.sides import Sides
from keystore_audit.model.inventory import Typed, authorities_of, beside_enclaves, governance_apart
from keystore_audit.model.trust.authorities import authority_files
from keystore_audit.model.trust.verdicts import Acceptance, envelope, may_have_issued
from keystore_audit.text import some

ADDED: Final = "enclave-added"
AUTHORITY: Final = "authority"
REMOVED: Final = "enclave-removed"
SUBJECT: Final = "identity-subject"
FILE: Final = "file"
PERMISSIONS_CA: Final = "permissions CA"
_IDENTITY_CA: Final = "identity CA"

_Value = TypeVar("_Value")

_EVERYBODY: Final = frozenset(
    {ADDED, REMOVED, SUBJECT, FILE, "identity-key", "identity-issuer", "identity-authority", AUTHORITY, "signer"}
    | {"signature", "revocation"}
)
"""Kinds of changes that bear on what peers accept from any enclave."""

_PRESENCE: Final = {
    Role.IDENTITY_CA: "identity CA file",
    Role.CERTIFICATE: "identity certificate",
    Role.PERMISSIONS_CA: "permissions CA file",
    Role.GOVERNANCE: "governance",
}
"""Files whose absence is a change of its own. Without permissions there are no rights, which is one already."""


def trust_changes(sides: Sides) -> list[Draft]:
    """One draft for each change, of all enclaves that have it."""
    found: dict[Fact, tuple[list[str], list[tuple[Aspect, ...]], Location | None, Location | None]] = {}
    placed = [*_shared_keys(sides), *foreign_keys(sides), *identities_certified_again(sides)]
    for path in sides.common:
        old, new = (by_path[path] for by_path in sides.enclaves)
        placed.extend((path, each) for each in _facts(old, new, sides))
    for path, (fact, one, other) in placed:
        key = fact._replace(aspects=()) if fact.kind.endswith("-validity") else fact
        held = found.setdefault(key, ([], [], one, other))
        held[0].append(path)
        held[1].append(fact.aspects)
    drafts = [*_of_keystores(*sides.keystores), *_anchors(sides), *identities_let_in(sides), *_of_enclaves(sides)]
    drafts += [_draft(fact, (), one, other) for fact, one, other in weak_keys(sides)]
    for fact, (paths, aspects, one, other) in found.items():
        drafts.append(_draft(fact._replace(aspects=spanned(aspects)), tuple(dict.fromkeys(paths)), one, other))
    for draft in drafts:
        draft.profiles = draft.profiles or tuple(profile.name for profile in sides.profiles)
    return drafts


def _draft(fact: Fact, paths: tuple[str, ...], one: Location | None, other: Location | None) -> Draft:
    return Draft(
        layer=Layer.TRUST,
        kind=fact.kind,
        direction=fact.direction,
        what=fact.what,
        enclaves=paths,
        profiles=fact.profiles,
        aspects=fact.aspects,
        everybody=fact.kind in _EVERYBODY,
        touched=fact.touched,
        whole=fact.whole,
        old=one,
        new=other,
    )


def _of_keystores(old: Keystore, new: Keystore) -> Iterator[Draft]:
    """The layout, and whether the authorities' private keys are there."""
    kinds = old.layout.kind.value, new.layout.kind.value
    if kinds[0] != kinds[1]:
        aspect = Aspect(what="layout", old=kinds[0], new=kinds[1], direction=Direction.INFO)
        yield _draft(Fact("layout", Direction.INFO, "the layout", (aspect,)), (), None, None)
    keys = [_authority_keys(keystore) for keystore in (old, new)]
    for on_robots, where in ((False, ""), (True, ", among the files that robots get,")):
        what = f"the private key of an authority{where}"
        yield from _left("authority-key", what, *(each[on_robots] for each in keys))
    others = [{file.sha256 or file.place: file.place for file in _other_private_keys(k)} for k in (old, new)]
    yield from _left("private-key", "a private key that is no enclave's", others[0], others[1])
    large = [{stray.file.sha256 or stray.place: stray.place for stray in governance_apart(k)} for k in (old, new)]
    certificates = [{c.sha256: c.path for c in _certified(k)} for k in (old, new)]
    yield from _left("certificate-at-large", "a certificate of no enclave that an authority issued", *certificates)
    yield from _left("governance-at-large", "a signed governance that no enclave carries", large[0], large[1])


def _anchors(sides: Sides) -> Iterator[Draft]:
    """Authorities that came or went in files of which no enclave of both tells: in public/, or of other enclaves."""
    for role, word in ((Role.IDENTITY_CA, _IDENTITY_CA), (Role.PERMISSIONS_CA, PERMISSIONS_CA)):
        held: list[dict[str, Certificate]] = []
        for keystore in sides.keystores:
            public, read = authority_files(keystore, role)
            files = [*([public] if public else ()), *(file for file, _enclaves in read)]
            held.append({certificate.key: certificate for file in files for certificate in file.certificates})
        told = set[str]()
        for path in sides.common:
            one, other = ({c.key for c in by_path[path].trusts(role)} for by_path in sides.enclaves)
            told |= one ^ other
        gone, come = (
            [certificate for key, certificate in mine.items() if key not in others and key not in told]
            for mine, others in (held, held[::-1])
        )
        if gone or come:
            direction = direction_of(gains=bool(come), losses=bool(gone))
            aspect = Aspect(what=word, old=_told(gone), new=_told(come), direction=direction)
            what = f"the {word} in public/, or of enclaves that one keystore alone has, is another"
            fact = Fact(AUTHORITY, direction, what, (aspect,))
            yield _draft(fact, (), place_of(gone[0] if gone else None), place_of(come[0] if come else None))


def _certified(keystore: Keystore) -> Iterator[Certificate]:
    """Certificates of no enclave's key, and whose private key is not here, that an authority of the enclaves issued."""
    if not keystore.identities.keyless:  # nearly always
        return
    own = {enclave.identity.key for enclave in keystore.enclaves if enclave.identity is not None}
    authorities = {each.sha256: each for each in authorities_of(keystore)}
    for certificate in keystore.identities.keyless:
        others = (each for sha256, each in authorities.items() if sha256 != certificate.sha256)
        if certificate.key not in own and any(may_have_issued(each, certificate) for each in others):
            yield certificate


def _authority_keys(keystore: Keystore) -> Mapping[bool, Mapping[str, str]]:
    """By whether robots get it, and by key, the places of authorities' private keys."""
    beside = beside_enclaves(keystore)
    found: dict[bool, dict[str, str]] = {False: {}, True: {}}
    for each in keystore.authority_keys:
        found[beside(each.file.place)][each.key or each.file.place] = each.file.place
    return found


def _left(kind: str, what: str, old: Mapping[str, str], new: Mapping[str, str]) -> Iterator[Draft]:
    """What lies in one keystore alone: their places, by what tells them apart."""
    come, gone = _beyond(new, old), _beyond(old, new)
    if come or gone:
        verb = "is there" if not gone else ("is no longer there" if not come else "is another")
        fact = Fact(kind, direction_of(gains=bool(come), losses=bool(gone)), f"{what} {verb}", ())
        yield _draft(fact, (), *(Location(path=min(places)) if places else None for places in (gone, come)))


def _beyond(one: Mapping[str, _Value], other: Mapping[str, _Value]) -> list[_Value]:
    """What has no equal key in the other."""
    return [value for key, value in one.items() if key not in other]


def _other_private_keys(keystore: Keystore) -> Iterator[File]:
    """Files that hold a private key and are neither an enclave's key file nor read as an authority's."""
    own = {enclave.key.file.place for enclave in keystore.enclaves if enclave.key is not None}
    own |= {key.file.place for key in keystore.authority_keys}  # one too large to be read is known by its hash
    return (file for file in keystore.private_keys if file.place not in own)


def _shared_keys(sides: Sides) -> Iterator[tuple[str, Placed]]:
    """Enclaves whose identity has the key of another one: whoever holds it has the rights of both."""
    holders: list[dict[str, set[str]]] = [{}, {}]
    for found, by_path in zip(holders, sides.enclaves, strict=True):
        for path, enclave in by_path.items():
            if (first := enclave.identity) is not None:
                found.setdefault(first.key, set()).add(path)
    for path in sides.common:
        firsts = [by_path[path].identity for by_path in sides.enclaves]
        one, other = (
            found[first.key] - {path} if first is not None else set()
            for found, first in zip(holders, firsts, strict=True)
        )
        if one != other:
            direction = direction_of(gains=bool(other - one), losses=bool(one - other))
            aspect = listing("shared with", one, other, direction)
            word = "another enclave" if direction is not Direction.LOST else "another enclave no longer"
            fact = Fact("identity-shared", direction, f"its identity has the key of {word}", (aspect,))
            yield path, (fact, place_of(firsts[0]), place_of(firsts[1]))


def _of_enclaves(sides: Sides) -> Iterator[Draft]:
    """Enclaves of one keystore alone."""
    for kind, direction, here, there in (
        (ADDED, Direction.GAINED, sides.enclaves[1], sides.enclaves[0]),
        (REMOVED, Direction.LOST, sides.enclaves[0], sides.enclaves[1]),
    ):
        paths = tuple(path for path in here if path not in there)
        if paths:
            place = Location(path=here[paths[0]].files.directory)
            places = (None, place) if kind == ADDED else (place, None)
            yield _draft(Fact(kind, direction, "was added" if kind == ADDED else "was removed", ()), paths, *places)


def _facts(old: Enclave, new: Enclave, sides: Sides) -> Iterator[Placed]:
    """Everything that changed of an enclave."""
    yield from _presences(old, new)
    authorities = list(_authorities(old, new))
    yield from authorities
    changed = {each.what for fact, _one, _other in authorities for each in fact.aspects}
    yield from _identity(old, new, sides, reissued=_IDENTITY_CA in changed)
    yield from _signatures(old, new, moved=PERMISSIONS_CA in changed)
    if sides.is_read(new.path):
        yield from _forms(old, new)
    yield from revocation_facts(old, new, sides)


def _presences(old: Enclave, new: Enclave) -> Iterator[Placed]:
    for role, word in _PRESENCE.items():
        files = old.files.files[role], new.files.files[role]
        before, after = (file.status is Status.PRESENT for file in files)
        if before != after and not any(file.status.unknown for file in files):
            direction = Direction.GAINED if after else Direction.LOST
            what = f"its {word} {'is there' if after else 'is no longer there'}"
            yield Fact(FILE, direction, what, ()), Location(path=files[0].path), Location(path=files[1].path)


def _identity(old: Enclave, new: Enclave, sides: Sides, *, reissued: bool) -> Iterator[Placed]:
    """The identity certificate. `reissued`: its CA is another, so that it had to be."""
    one, other = old.identity, new.identity
    if one is None or other is None or one.sha256 == other.sha256:
        return
    places = place_of(one), place_of(other)
    facts = list(_identity_facts(one, other))
    if not reissued:
        facts += _issuer_facts(old, new, sides)
    if not facts and not reissued:
        facts.append(Fact("reissued", Direction.INFO, "its identity certificate was issued again, with its key", ()))
    for fact in facts:
        yield fact, *places


def _identity_facts(one: Certificate, other: Certificate) -> Iterator[Fact]:
    if one.key != other.key:
        yield Fact("identity-key", Direction.CHANGED, "its identity has another key", ())
    if one.subject != other.subject:
        aspect = Aspect(what="subject", old=one.subject, new=other.subject, direction=Direction.CHANGED)
        yield Fact(SUBJECT, Direction.CHANGED, "its identity has another subject", (aspect,))
    if bool(one.is_ca) != bool(other.is_ca):
        direction = Direction.GAINED if other.is_ca else Direction.LOST
        word = "is an authority" if other.is_ca else "is no longer an authority"
        yield Fact("identity-authority", direction, f"its identity {word}", ())
    yield from dated("identity-validity", "its identity certificate", _validity(one), _validity(other))
    yield from certificate_form("its identity certificate:", one, other)


def _issuer_facts(old: Enclave, new: Enclave, sides: Sides) -> Iterator[Fact]:
    """Whether another authority of the same CA file issued the identity, or none of them; and whether other enclaves
    let it in for that: whoever attacks asks nobody whether its own files do.
    """
    issuers = []
    for enclave in (old, new):
        certificate = enclave.identity
        pool = enclave.identity_ca.certificates if enclave.identity_ca else ()
        issuers.append([c for c in pool if certificate is not None and may_have_issued(c, certificate)])
    issuer = []
    if {c.key for c in issuers[0]} != {c.key for c in issuers[1]}:
        names = [_told(each) for each in issuers]
        issuer.append(Aspect(what="issuer", old=names[0], new=names[1], direction=Direction.CHANGED))
    peers: dict[tuple[frozenset[str], frozenset[str]], list[str]] = {}
    for pair, gone, come in sides.letting_in(new.path):
        peers.setdefault((gone, come), []).extend(pair.profiles)
    for (gone, come), profiles in peers.items():
        direction = direction_of(gains=bool(come), losses=bool(gone))
        told = []
        if gone | come:
            paths = [some(sorted(each), MAX_PATHS) or None for each in (gone, come)]
            told.append(Aspect(what="let in by", old=paths[0], new=paths[1], direction=direction))
        if issuer or told:
            what = "its identity was issued by another authority" if issuer else "other enclaves let its identity in"
            yield Fact("identity-issuer", direction, what, (*issuer, *told), in_order(profiles, sides))


def _validity(certificate: Certificate) -> Dates:
    return certificate.not_before, certificate.not_after


def _authorities(old: Enclave, new: Enclave) -> Iterator[Placed]:
    """The CA files; one file for both roles is one change."""
    files = {
        _IDENTITY_CA: (old.identity_ca, new.identity_ca),
        PERMISSIONS_CA: (old.permissions_ca, new.permissions_ca),
    }
    found: dict[tuple[tuple[str, ...], tuple[str, ...]], list[str]] = {}
    for role, (before, after) in files.items():
        if before is not None and after is not None:
            one, other = (tuple(c.sha256 for c in file.certificates) for file in (before, after))
            if one != other:
                found.setdefault((one, other), []).append(role)
    for roles in found.values():
        before, after = files[roles[0]]
        if before is not None and after is not None:
            for fact in _authority_facts(roles, before, after):
                yield fact, place_of(before.first), place_of(after.first)


def _authority_facts(roles: list[str], before: CertificateFile, after: CertificateFile) -> Iterator[Fact]:
    words = " and ".join(roles)
    old, new = ({certificate.key: certificate for certificate in file.certificates} for file in (before, after))
    gone, come = _beyond(old, new), _beyond(new, old)
    if gone or come:
        direction = direction_of(gains=bool(come), losses=bool(gone))
        others, have = ("are others", "have") if len(roles) > 1 else ("is another", "has")
        verb = others if gone and come else f"{have} {'more' if come else 'fewer'} keys"
        told = _told(gone), _told(come)
        aspects = tuple(Aspect(what=role, old=told[0], new=told[1], direction=direction) for role in roles)
        yield Fact(AUTHORITY, direction, f"the {words} {verb}", aspects)
        return
    reissued = list(_validity_facts(words, old, new))
    yield from reissued
    if [c.key for c in before.certificates] != [c.key for c in after.certificates]:
        yield Fact("authority-order", Direction.CHANGED, f"the {words} have another order", ())
    elif not reissued:
        yield Fact("reissued", Direction.INFO, f"the {words}: issued again, with the same key", ())


def _validity_facts(words: str, old: dict[str, Certificate], new: dict[str, Certificate]) -> Iterator[Fact]:
    for key, one in old.items():
        if one.sha256 != new[key].sha256:
            yield from dated("authority-validity", f"the {words}", _validity(one), _validity(new[key]))
            yield from certificate_form(f"the {words}:", one, new[key])


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


def _signatures(old: Enclave, new: Enclave, *, moved: bool) -> Iterator[Placed]:
    """Who signed the documents, and whether the signatures hold. `moved`: the permissions CA is another."""
    for word, one, other, places in documents(old, new):
        before, after = envelope(one.signed), envelope(other.signed)
        held, holds = (each.verdict is Acceptance.ACCEPTED for each in (before, after))
        if held != holds:
            direction = Direction.GAINED if holds else Direction.LOST
            verb = "holds" if holds else "no longer holds"
            yield Fact("signature", direction, f"the signature of its {word} {verb}", ()), *places
            continue
        signed_by = {c.key for c in before.signers}, {c.key for c in after.signers}
        if signed_by[0] == signed_by[1] or (moved and _by_authority(one, old) and _by_authority(other, new)):
            continue
        told = _told(before.signers), _told(after.signers)
        verb = "were" if word == "permissions" else "was"
        aspect = Aspect(what="signer", old=told[0], new=told[1], direction=Direction.MIXED)
        yield Fact("signer", Direction.MIXED, f"its {word} {verb} signed by somebody else", (aspect,)), *places


def _forms(old: Enclave, new: Enclave) -> Iterator[Placed]:
    """Documents in another form, where that is not what makes their signatures hold or not."""
    for word, one, other, places in documents(old, new):
        alike = envelope(one.signed).verdict is envelope(other.signed).verdict
        if alike and one.signed.file.sha256 != other.signed.file.sha256:
            for fact in document_form(word, one, other):
                yield fact, *places


def _by_authority(document: Typed, enclave: Enclave) -> bool:
    """Whether the enclave's permissions CA signed it."""
    keys = {certificate.key for certificate in enclave.permissions_ca.certificates} if enclave.permissions_ca else set()
    return all(signer.key in keys for signer in envelope(document.signed).signers)
