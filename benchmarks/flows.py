"""Information flow among 10,000 enclaves, natively: CPU seconds from the documents that were read to three answers."""

from __future__ import annotations

import gc
import resource
import sys
import time
from datetime import datetime, timezone
from pathlib import Path
from tempfile import gettempdir

from keystore_audit.engine.native import NativeEngine
from keystore_audit.flow import FlowQuestion, questions
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.claims import with_claims
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.profiles import resolve
from keystore_audit.model.systems import SystemBuilder

if __package__:
    from benchmarks.keystores import build
else:
    from keystores import build


def measure(enclaves: int, profiles_named: list[str]) -> str:
    """One line."""
    keystore = read_keystore(build(Path(gettempdir()) / "keystore-audit-benchmarks", enclaves, "ec"))
    begin = time.process_time()
    at = datetime.now(timezone.utc)
    accesses = AccessViews(documents_of(keystore), at, None)
    profiles = resolve(profiles_named)
    first, last = keystore.enclaves[0].path, keystore.enclaves[-1].path
    claims = questions(FlowQuestion(source=first, target=last))
    builder = SystemBuilder(keystore, profiles, at, accesses, claims=claims)
    classes = time.process_time() - begin
    native = NativeEngine(with_claims(builder.systems(), claims, builder.channels, keystore, {}))
    facts = time.process_time() - begin
    answers = native.claim_answers()
    done = time.process_time() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    found = [{answer.property_id: answer.status.value for answer in each.values()} for each in answers]
    return (
        f"{enclaves} enclaves, {len(builder.channels.channels)} classes, {len(answers)} kinds of implementation: "
        f"classes {classes:.1f} s, facts {facts - classes:.1f} s, three flows for each {done - facts:.1f} s CPU, "
        f"together {done:.1f} s, {memory:.0f} MB\n{found}"
    )


if __name__ == "__main__":
    gc.set_threshold(200_000, 50, 50)  # as the program does
    sys.stdout.write(measure(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000, sys.argv[2:]) + "\n")
