"""Identities beside those of the enclaves: in files of no enclave, and further certificates of an enclave's key."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.comparison import Aspect, Direction, Layer, direction_of
from keystore_audit.model.comparison_drafts import Draft, in_order
from keystore_audit.model.comparison_facts import Fact, Placed, place_of
from keystore_audit.model.comparison_sides import Sides
from keystore_audit.model.inventory import certified_again
from keystore_audit.model.stray_identity import admitted

_Identity = tuple[str, str]
"""Subject and key."""


def identities_let_in(sides: Sides) -> Iterator[Draft]:
    """Identities of no enclave that peers let in and whose private keys are there (KA668), in one keystore alone.

    A change of the keystore as a whole: what it may do is what grants give its subject.
    """
    old, new = (_admitted(keystore, sides) for keystore in sides.keystores)
    for here, there, direction, verb in (
        (new, old, Direction.GAINED, "peers let in"),
        (old, new, Direction.LOST, "peers no longer let in"),
    ):
        for identity, by_profile in here.items():
            profiles = by_profile.keys() - there.get(identity, {}).keys()
            if profiles:
                place = next(place for profile, place in by_profile.items() if profile in profiles)
                yield Draft(
                    layer=Layer.TRUST,
                    kind="identity-at-large",
                    direction=direction,
                    what=f"{verb} {identity[0]}, an identity of no enclave whose private key lies in the keystore",
                    enclaves=(),
                    profiles=in_order(profiles, sides),
                    old=None if here is new else place,
                    new=place if here is new else None,
                )


def _admitted(keystore: Keystore, sides: Sides) -> Mapping[_Identity, Mapping[str, Location | None]]:
    """By identity and profile the place of the certificate."""
    found: dict[_Identity, dict[str, Location | None]] = {}
    if keystore.identities.found:  # nearly never
        for profile in sides.profiles:
            for each in admitted(keystore, keystore.identities.found, (profile,), sides.at):
                identity = each.certificate.subject, each.certificate.key
                found.setdefault(identity, {}).setdefault(profile.name, place_of(each.certificate))
    return found


def identities_certified_again(sides: Sides) -> Iterator[tuple[str, Placed]]:
    """The enclaves of either keystore whose identity key has other certificates there than before (KA228)."""
    old, new = ({enclave.path: others for enclave, others in certified_again(each)} for each in sides.keystores)
    for path in sorted({*old, *new}):
        one, other = (_by_name(each.get(path, ())) for each in (old, new))
        gone, come = one.keys() - other.keys(), other.keys() - one.keys()
        if not gone and not come:
            continue
        direction = direction_of(gains=bool(come), losses=bool(gone))
        told = [", ".join(f"{subject}, issued by {issuer}" for _, subject, issuer in sorted(s)) for s in (gone, come)]
        aspect = Aspect(what="certified as", old=told[0] or None, new=told[1] or None, direction=direction)
        verb = {Direction.GAINED: "has further certificates", Direction.LOST: "has fewer further certificates"}
        what = f"its identity key {verb.get(direction, 'has other further certificates')}"
        # Whom grants name by these subjects, each implementation says in its own way.
        fact = Fact("identity-certified-again", direction, what, (aspect,), whole=True)
        places = [found[min(names or found)] if found else None for found, names in ((one, gone), (other, come))]
        yield path, (fact, places[0], places[1])


_Name = tuple[str, str, str]
"""Key, subject and issuer."""


def _by_name(certificates: Iterable[Certificate]) -> Mapping[_Name, Location | None]:
    """By name the place of the first certificate."""
    found: dict[_Name, Location | None] = {}
    for certificate in certificates:
        found.setdefault((certificate.key, certificate.subject, certificate.issuer), place_of(certificate))
    return found
