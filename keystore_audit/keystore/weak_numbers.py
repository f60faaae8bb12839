"""Public keys that give their private ones away, as numbers: what anybody can compute who has the public half.

All of it is linear or n log² n in the number of keys. Private values are found on the way and never handed out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import MAX_EMAX, MAX_PREC, MIN_EMIN, Context, Decimal, localcontext
from functools import cache
from itertools import islice
from math import gcd, isqrt, prod
from typing import Final

from cryptography.hazmat.primitives.asymmetric import ec

SMALL_SCALAR: Final = 1 << 8
"""Private scalars up to this are found, and negative ones: what counts up or stands in examples, in 5 ms a curve."""

SMALL_FACTOR: Final = 1 << 16
"""Prime factors below this are found."""

MAX_LOOKED_FOR: Final = 1_000
"""Common factors that are tried on a modulus of which all factors are in others."""

FERMAT_STEPS: Final = 100
"""Steps in which primes that lie close to each other are found: half of their bits alike take one."""


@cache
def small_points(curve: type[ec.EllipticCurve]) -> frozenset[int]:
    """The first coordinates of the points with a scalar of at most SMALL_SCALAR, which their negatives have, too."""
    private = (ec.derive_private_key(scalar, curve()) for scalar in range(1, SMALL_SCALAR + 1))
    return frozenset(each.public_key().public_numbers().x for each in private)


def has_close_primes(modulus: int) -> bool:
    """Whether Fermat's method finds two factors in FERMAT_STEPS."""
    if modulus % 2 == 0:
        return False  # a small factor
    middle = isqrt(modulus - 1) + 1
    square = middle * middle - modulus
    for _ in range(FERMAT_STEPS):
        if square & 63 in _SQUARES and isqrt(square) ** 2 == square:
            return True
        square += 2 * middle + 1
        middle += 1
    return False


_SQUARES: Final = frozenset(number * number & 63 for number in range(64))


def has_small_factor(modulus: int) -> bool:
    """Whether a prime below SMALL_FACTOR divides it."""
    return gcd(modulus, _primorial() % modulus) != 1


@cache
def _primorial() -> int:
    return _product(_primes(SMALL_FACTOR))


def _primes(limit: int) -> list[int]:
    sieve = bytearray([1]) * limit
    for number in range(2, isqrt(limit) + 1):
        if sieve[number]:
            sieve[number * number :: number] = bytes(len(range(number * number, limit, number)))
    return [number for number in range(2, limit) if sieve[number]]


def _product(numbers: Sequence[int]) -> int:
    """By halves: factors of like size are multiplied fast."""
    return prod(numbers) if len(numbers) < 8 else _product(numbers[::2]) * _product(numbers[1::2])


_GENERATOR: Final = 65537
_ROCA_PRIMES: Final = 39
"""Primes of the smallest M, up to 167; those of longer keys are multiples of it."""


@cache
def _logarithms() -> list[tuple[int, dict[int, int]]]:
    """For each prime the exponents of the generator's powers modulo it."""
    found = []
    for prime in _primes(168)[1:_ROCA_PRIMES]:  # modulo 2 there is one
        powers, power = dict[int, int](), 1
        while power not in powers:
            powers[power] = len(powers)
            power = power * _GENERATOR % prime
        found.append((prime, powers))
    return found


def has_roca_fingerprint(modulus: int) -> bool:
    """Whether the modulus is a power of 65537 modulo the product of the first 39 primes.

    Keys of Infineon's RSALib are; others by chance in one of 2^154. Source: Nemec, Sys, Svenda, Klinec, Matyas, "The
    Return of Coppersmith's Attack" (ACM CCS 2017), 2.3. The logarithm is put together from those modulo each prime.
    """
    exponent, order = 0, 1
    for prime, powers in _logarithms():
        here = powers.get(modulus % prime)
        if here is None:
            return False
        common = gcd(order, len(powers))
        if (here - exponent) % common:
            return False
        step = (here - exponent) // common * pow(order // common, -1, len(powers) // common)
        exponent += order * (step % (len(powers) // common))
        order *= len(powers) // common
    return True


def with_common_factors(moduli: Iterable[int]) -> list[tuple[int, ...]]:
    """Groups of the moduli that have a factor in common (Bernstein's batch gcd); of two such factors, one is enough.

    Each node of the tree has the product of its moduli, and the sum of that product divided by each of them. Modulo
    one of them the sum is the product of all others. Decimal multiplies and divides long numbers in n log n.
    """
    every = sorted(set(moduli))
    if len(every) < 2:
        return []
    with localcontext(Context(prec=MAX_PREC, Emax=MAX_EMAX, Emin=MIN_EMIN, traps=[])):
        tree = [[(Decimal(modulus), Decimal(1)) for modulus in every]]
        while len(tree[-1]) > 1:
            level = tree[-1]
            tree.append([_joined(level[place : place + 2]) for place in range(0, len(level), 2)])
        rest = [tree[-1][0][1]]
        for level in reversed(tree[:-1]):
            rest = [rest[place // 2] % product for place, (product, _others) in enumerate(level)]
        common = {modulus: gcd(modulus, int(others)) for modulus, others in zip(every, rest, strict=True)}
    groups: dict[int, list[int]] = {}
    whole = []
    for modulus, factor in common.items():
        if factor == modulus:  # with each of its factors
            whole.append(modulus)
        elif factor != 1:
            groups.setdefault(factor, []).append(modulus)
    for modulus in whole:
        known = next((factor for factor in islice(groups, MAX_LOOKED_FOR) if modulus % factor == 0), modulus)
        groups.setdefault(known, []).append(modulus)
    return [tuple(group) for group in groups.values()]


def _joined(pair: Sequence[tuple[Decimal, Decimal]]) -> tuple[Decimal, Decimal]:
    if len(pair) == 1:
        return pair[0]
    (left, beside_left), (right, beside_right) = pair
    return left * right, beside_left * right + beside_right * left
