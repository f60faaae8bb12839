"""KA2: keys whose private half others have or can compute, by one rule over all keys and signatures of a run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.key_quality import (
    Material,
    Place,
    material_of_keystore,
    published_keys,
    weaknesses,
)
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.remedy import decision
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.wording import places
from keystore_audit.text import counted

_ANEW: Final = decision(
    "Make every such key anew with a random generator that you trust, and let nothing accept the old one any more: an "
    "enclave's by `explain KA209 --for KEYSTORE` (its old cert.pem and key.pem taken away), an authority's with all "
    "that it issued and signed."
)


@rule(
    "KA230",
    Severity.CRITICAL,
    clause="NIST SP 800-57 Part 1, 5.6 and 6.2; FIPS 186-5, A.1 to A.3; CWE-330, CWE-323, CWE-321",
    remedy=_ANEW,
)
def private_key_others_have(keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Anybody can have the private half of a key: it is that identity, or issues and signs as that authority.

    Looked at are the keys of all certificates that were read, and the ECDSA signatures in certificates, revocation
    lists and documents, with those of the other keystores of the run. Found are: signatures by one key over different
    content that share r (the key of an authority was computed from two public .p7s files), in as far as a key here made
    them; EC scalars within about 2^16 of zero, on P-256, P-384, P-521 and secp256k1; points that are negatives of each
    other; RSA with an exponent below 65537, with a prime factor below 2^16, with primes that Fermat's method finds in
    100 steps, with a factor that another key of the run has, and with the fingerprint of ROCA (Nemec and others, CCS
    2017). No private value is in any report. Published keys are those of the samples of keystore-audit: info where
    keystores are made, since a sample is what it says it is, and critical in a tree that goes on a robot (--deployed).
    Debian's weak keys of 2008 are not among them, since no package of Debian has the list any more; and a key that was
    made badly in another way looks like any other.
    """
    own, others = material_of_keystore(keystore), context.beside.shared.material if context.beside else Material()
    keys = {each.key for each in own.keys}
    for weakness in weaknesses(Material(keys=own.keys + others.keys, signed=own.signed + others.signed)):
        here = [place for place in weakness.places if place.root == keystore.root]
        if keys.isdisjoint(weakness.keys) and not here:
            continue
        yield Violation(
            message=f"A key {weakness.fact}.",
            locations=_locations(weakness.places, keystore.root),
            undecided=weakness.undecided,
            key=f"{weakness.fact} {' '.join(sorted(weakness.keys))}",
        )
    published = [each for each in own.keys if each.key in published_keys()]
    if published:
        what = "a key of" if len(published) == 1 else f"{counted(len(published), 'key')} of"
        yield Violation(
            message=f"The keystore has {what} a published sample: anybody has the private half.",
            locations=_locations((each.place for each in published), keystore.root),
            severity=None if context.deployed else Severity.INFO,
            key=f"published {' '.join(sorted(each.key for each in published))}",
        )


def _locations(found: Iterable[Place], root: str) -> tuple[Location, ...]:
    """Here first; those of other keystores by where they lie."""
    ordered = sorted(found, key=lambda place: (place.root != root, place.root, place.path, place.line or 0))
    return places(
        Location(path=place.path, line=place.line)
        if place.root == root
        else Location(path=f"{place.root.rstrip('/')}/{place.path}", line=place.line, beside=True)
        for place in ordered
    )
