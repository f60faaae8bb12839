"""Information flow among 10,000 enclaves, natively: seconds from the documents that were read to three answers.

By the clock, as `flow` does it, with copies of the process where there is more than one processor; in brackets
processor seconds, those of the copies included.
"""

from __future__ import annotations

import gc
import os
import resource
import sys
import time
from datetime import datetime, timezone

from benchmarks.keystores import ROOT, build
from keystore_audit.engine.native import NativeEngine
from keystore_audit.flow import FlowQuestion, questions
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.claims.claims import with_claims
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import resolve


def measure(enclaves: int, profiles_named: list[str]) -> str:
    """One line."""
    keystore = read_keystore(build(ROOT, enclaves, "ec"))
    begin = _seconds()
    at = datetime.now(timezone.utc)
    accesses = AccessViews(documents_of(keystore), at, None)
    profiles = resolve(profiles_named)
    first, last = keystore.enclaves[0].path, keystore.enclaves[-1].path
    claims = questions(FlowQuestion(source=first, target=last))
    builder = SystemBuilder(keystore, profiles, at, accesses, claims=claims)
    classes = _seconds()
    native = NativeEngine(with_claims(builder.systems(), claims, builder.channels, keystore, {}))
    facts = _seconds()
    answers = native.claim_answers()
    done = _seconds()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    found = [{name: answer.status.value for name, answer in each.items()} for each in answers]
    return (
        f"{enclaves} enclaves, {len(builder.channels.channels)} classes, {len(answers)} kinds of implementation: "
        f"classes {_shown(begin, classes)}, facts {_shown(classes, facts)}, three flows for each "
        f"{_shown(facts, done)}, together {_shown(begin, done)}, {memory:.0f} MB\n{found}"
    )


def _seconds() -> tuple[float, float]:
    """By the clock, and of processors: this process's and those of its copies that have ended."""
    spent = os.times()
    return time.perf_counter(), spent.user + spent.system + spent.children_user + spent.children_system


def _shown(begin: tuple[float, float], end: tuple[float, float]) -> str:
    return f"{end[0] - begin[0]:.1f} s ({end[1] - begin[1]:.1f} s)"


if __name__ == "__main__":
    gc.set_threshold(200_000, 50, 50)  # as the program does
    sys.stdout.write(measure(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000, sys.argv[2:]) + "\n")
