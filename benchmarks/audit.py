"""Measures the native audit against a shell loop of openssl and against raw signature verification."""

from __future__ import annotations

import statistics
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, padding

from benchmarks import keystores
from benchmarks.program import run
from tests.keystore.builder import authority

LOOP = r"""
set -eu
for cert in $(find "$1/enclaves" -name cert.pem); do
  d=$(dirname "$cert")
  openssl verify -CAfile "$d/identity_ca.cert.pem" "$cert" >/dev/null
  for doc in governance permissions; do
    openssl smime -verify -text -in "$d/$doc.p7s" -CAfile "$d/permissions_ca.cert.pem" >/dev/null 2>&1
  done
done
"""
"""What an engineer does today for each enclave."""


def seconds(work: Callable[[], object], repeat: int) -> float:
    """The median wall time of `work`."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def audit(store: Path) -> None:
    """One whole audit in a process of its own."""
    run("audit", "--engine", "native", "--format", "json", str(store))


def raw_verification(kind: str) -> float:
    """Seconds for one signature verification through `cryptography`."""
    made = authority(key=keystores.new_key(kind)).certificate
    public, signature, body = made.public_key(), made.signature, made.tbs_certificate_bytes

    def verify() -> None:
        for _ in range(200):
            if isinstance(public, ec.EllipticCurvePublicKey):
                public.verify(signature, body, ec.ECDSA(hashes.SHA256()))
            else:
                public.verify(signature, body, padding.PKCS1v15(), hashes.SHA256())  # type: ignore[union-attr,call-arg]

    return seconds(verify, 5) / 200


def row(kind: str, size: int, raw: float) -> str:
    """One line of the table."""
    store = keystores.build(keystores.ROOT, size, kind)
    loop = seconds(lambda: subprocess.run(["bash", "-c", LOOP, "-", str(store)], check=True), 1)
    ours = seconds(lambda: audit(store), 3)
    start = seconds(start_up, 3)
    per_enclave = (ours - start) / size / raw
    return f"| {kind} | {size} | {loop:.1f} | {ours:.2f} | {loop / ours:.1f} | {per_enclave:.1f} |"


def start_up() -> None:
    """A process that does nothing: what every audit pays once."""
    run("--help")


def main() -> None:
    """Prints one row for each kind and size."""
    print("| keys | enclaves | loop s | audit s | loop / audit | audit / enclave in raw verifications |")
    print("|---|---|---|---|---|---|")
    for kind in ("ec", "rsa"):
        raw = raw_verification(kind)
        for size in (100, 1000):
            print(row(kind, size, raw), flush=True)


if __name__ == "__main__":
    main()
