"""The example model of ../shared/examples/alloy, for TurtleSim as it stands there or as many enclaves and topics."""

from __future__ import annotations

import random
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.keystores import READERS, ROOT
from tests.keystore.builder import sros2
from tests.keystore.documents import grant, permissions, pub, rule, sub

EXAMPLE = Path(__file__).resolve().parents[2] / "shared" / "examples" / "alloy"
_ROWS = 100
"""Those of a relation in one function: more are slow to parse (facts/alloy.md, section 3)."""

_SIGS = {"Enclave": "E", "Topic": "T", "Certificate": "C", "Document": "P"}

_REST = """
one sig D0 extends Domain {{}}
one sig I0, I1 extends Instant {{}}
fun identity_ca: set Certificate {{ C{ca} }}
fun permissions_ca: set Certificate {{ C{ca} }}
fun authority: set Certificate {{ C{ca} }}
fun in_force: set Certificate {{ Certificate }}
fun issuer: Certificate -> Certificate {{ Certificate -> C{ca} }}
fun same_key: Certificate -> Certificate {{ none -> none }}
fun expires: Certificate -> Instant {{ C{ca} -> I0 + (Certificate - C{ca}) -> I1 }}
fun following: Instant -> Instant {{ I0 -> I1 }}
fun signer: Document -> Certificate {{ Document -> C{ca} }}
fun well_formed: set Document {{ Document }}
fun governance: Enclave -> Document {{ Enclave -> P{ca} }}
fun allow_unauthenticated_participants: set Domain {{ none }}
fun enable_join_access_control: set Domain {{ D0 }}
fun rtps_protection_kind: Domain -> ProtectionKind {{ D0 -> SIGN }}
fun discovery_protection_kind: Domain -> ProtectionKind {{ D0 -> ENCRYPT }}
fun liveliness_protection_kind: Domain -> ProtectionKind {{ D0 -> ENCRYPT }}
fun domain: Topic -> Domain {{ Topic -> D0 }}
fun enable_discovery_protection: set Topic {{ Topic }}
fun enable_liveliness_protection: set Topic {{ Topic }}
fun enable_read_access_control: set Topic {{ Topic }}
fun enable_write_access_control: set Topic {{ Topic }}
fun metadata_protection_kind: Topic -> ProtectionKind {{ Topic -> ENCRYPT }}
fun data_protection_kind: Topic -> ProtectionKind {{ Topic -> ENCRYPT }}
fun join: Enclave -> Domain {{ Enclave -> D0 }}
fun relay: Enclave -> Topic {{ none -> none }}
fun sensitive: set Topic {{ T0 + T1 }}
"""
"""The governance of sros2, one authority and nothing that differs from one enclave to the next."""

CLAIMS = """
[[property]]
name = "first"
no_flow = { from = "/part0", to = "/part2", attacker = "source" }
[[property]]
name = "second"
no_flow = { from = "/part1", to = "/part0", attacker = "source" }
"""
"""The two flows that the example asks about, as settings."""


def build_both(enclaves: int, topics: int) -> tuple[Path, Path, Path]:
    """The example model with so many atoms, a keystore of sros2 that grants the same, and settings that ask the same.

    Each topic has a writer and readers that are drawn at random, and one more has all enclaves as writers.
    """
    chance, writes, reads = random.Random(enclaves * topics), {}, {}
    for number in range(enclaves):
        writes[number], reads[number] = [topics], list[int]()
    for topic in range(topics):
        writer, *readers = chance.sample(range(enclaves), 1 + READERS)
        writes[writer].append(topic)
        for reader in readers:
            reads[reader].append(topic)
    place = ROOT / f"example-{enclaves}-{topics}"
    shutil.rmtree(place, ignore_errors=True)
    model, keystore, settings = (place / name for name in ("model", "keystore", "settings.toml"))
    shutil.copytree(EXAMPLE, model)
    sizes = {"Enclave": enclaves, "Topic": topics + 2, "Certificate": enclaves + 1, "Document": enclaves + 1}
    lines = ["module keystore", "open dds_security", *(_sigs(name, size) for name, size in sizes.items())]
    lines += [_REST.format(ca=enclaves), _relation("publish", "Topic", writes), _relation("subscribe", "Topic", reads)]
    own = {number: [number] for number in range(enclaves)}
    lines += [_relation("identity", "Certificate", own), _relation("permissions", "Document", own)]
    (model / "keystore.als").write_text("\n".join(lines))
    audit = model / "audit.als"
    asked = audit.read_text().replace("E0_display, E2_turtlesim", "E0, E2").replace("E1_teleop, E0_display", "E1, E0")
    audit.write_text(asked)

    def document(path: str) -> str:
        number = int(path.removeprefix("/part"))
        told = [
            made(*(f"rt/t{topic}" for topic in of[number])) for made, of in ((pub, writes), (sub, reads)) if of[number]
        ]
        return permissions(grant(path, rule(*told), name=path))

    sros2(keystore, [f"/part{number}" for number in range(enclaves)], document=document, split=True)
    settings.write_text(CLAIMS)
    return model, keystore, settings


def _sigs(name: str, size: int) -> str:
    groups = [range(first, min(size, first + 50)) for first in range(0, size, 50)]
    return "\n".join(
        f"private abstract sig {name}_{group[0]} extends {name} {{}}\n"
        f"one sig {', '.join(f'{_SIGS[name]}{each}' for each in group)} extends {name}_{group[0]} {{}}"
        for group in groups
    )


def _relation(name: str, kind: str, pairs: Mapping[int, Sequence[int]]) -> str:
    rows = [f"E{one} -> ({' + '.join(f'{_SIGS[kind]}{each}' for each in to)})" for one, to in pairs.items() if to]
    parts = [rows[first : first + _ROWS] for first in range(0, len(rows), _ROWS)]
    functions = [f"private fun {name}_{n}: Enclave -> {kind} {{ {_union(part)} }}" for n, part in enumerate(parts)]
    whole = " + ".join(f"{name}_{n}" for n in range(len(parts)))
    return "\n".join([*functions, f"fun {name}: Enclave -> {kind} {{ {whole} }}"])


def _union(parts: Sequence[str]) -> str:
    """Balanced, which is faster to parse."""
    half = len(parts) // 2
    return f"({_union(parts[:half])} + {_union(parts[half:])})" if half else parts[0]
