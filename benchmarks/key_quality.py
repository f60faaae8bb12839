"""Measures the rule over all keys of a run, 10,000 keys of each kind, in processor time (limit: 5 s)."""

from __future__ import annotations

import random
import secrets
import sys
import time
from collections.abc import Callable
from math import gcd, prod

from cryptography.hazmat.primitives.asymmetric import ec

from keystore_audit.keystore.key_quality import Material, Place, PublicKey, Signed, weaknesses

KEYS = 10_000
PLACE = Place(root="k", path="p", line=1)
PRIMES = [number for number in range(2, 2000) if all(number % divisor for divisor in range(2, int(number**0.5) + 1))]
SMALL = prod(PRIMES)


def ec_keys(count: int) -> list[PublicKey]:
    """On P-256, as sros2 makes them."""
    found = []
    for number in range(count):
        point = ec.generate_private_key(ec.SECP256R1()).public_key().public_numbers()
        found.append(PublicKey(key=str(number), curve="secp256r1", numbers=(point.x, point.y), place=PLACE))
    return found


def rsa_keys(count: int) -> list[PublicKey]:
    """Numbers of 2,048 bits without small factors, which cost what moduli cost and are made faster."""
    found: list[PublicKey] = []
    while len(found) < count:
        number = secrets.randbits(2048) | 1 | 1 << 2047
        if gcd(SMALL, number) == 1:
            found.append(PublicKey(key=f"r{len(found)}", curve="", numbers=(number, 65537), place=PLACE))
    return found


def signatures(count: int) -> tuple[Signed, ...]:
    """All with an r of their own."""
    rand = random.Random(1)
    return tuple(
        Signed(r=rand.getrandbits(256), s=rand.getrandbits(256), hashed=rand.randbytes(32), place=PLACE)
        for _ in range(count)
    )


CASES: dict[str, Callable[[], Material]] = {
    "5 EC keys, 6 signatures": lambda: Material(keys=tuple(ec_keys(5)), signed=signatures(6)),
    "10,000 EC keys, 20,000 signatures": lambda: Material(keys=tuple(ec_keys(KEYS)), signed=signatures(2 * KEYS)),
    "9,000 EC keys and 1,000 RSA 2048": lambda: Material(keys=(*ec_keys(9_000), *rsa_keys(1_000))),
    "2,000 RSA 2048": lambda: Material(keys=tuple(rsa_keys(2_000))),
    "10,000 RSA 2048": lambda: Material(keys=tuple(rsa_keys(KEYS))),
}


def main() -> None:
    """A line for each case; the words on the command line choose among them."""
    for name, make in CASES.items():
        if all(word in name for word in sys.argv[1:]):
            material = make()
            begin = time.process_time()
            found = sum(1 for _ in weaknesses(material))
            print(f"{name:40} {time.process_time() - begin:8.3f} s  {found} found")


if __name__ == "__main__":
    main()
