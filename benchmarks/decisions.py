"""Measures the classes and all decisions of a fleet: `python -m benchmarks.decisions [ENCLAVES]`.

Every enclave, both operations, every name, for each kind of implementation among the default profiles. Reading and
verifying come before and are not counted; memory is that of the whole process.
"""

from __future__ import annotations

import gc
import resource
import sys
import time
from datetime import datetime, timezone

from benchmarks.keystores import ROOT, build
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import resolve


def expressions(keystore: Keystore) -> int:
    """How many topic expressions its permissions hold."""
    return sum(
        len(criterion.topics)
        for enclave in keystore.enclaves
        if enclave.permissions is not None
        for grant in enclave.permissions.grants
        for rule in grant.rules
        for criterion in rule.criteria
    )


def measure(enclaves: int) -> str:
    """One line."""
    keystore = read_keystore(build(ROOT, enclaves, "ec"))
    begin = time.process_time()
    at = datetime.now(timezone.utc)
    accesses = AccessViews(documents_of(keystore), at, None)
    profiles = resolve([])
    channels = SystemBuilder(keystore, profiles, at, accesses).channels
    classes = time.process_time() - begin
    rights = LocalRights(accesses, channels, at)
    kinds = {(accesses.row(profile.access), profile.local): profile for profile in profiles}.values()
    allowed = sum(
        rights.allowed(enclave, profile, operation).bit_count()
        for enclave in keystore.enclaves
        for profile in kinds
        for operation in (Operation.PUBLISH, Operation.SUBSCRIBE)
    )
    done = time.process_time() - begin
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    size = f"{enclaves} enclaves, {expressions(keystore)} expressions"
    found = f"{len(channels.channels)} classes in {classes:.1f} s, with {allowed} rights in {done:.1f} s CPU"
    return f"{size}: {found}, {memory:.0f} MB"


if __name__ == "__main__":
    gc.set_threshold(200_000, 50, 50)  # as the program does
    sys.stdout.write(measure(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000) + "\n")
