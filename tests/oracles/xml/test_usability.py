"""What we call usable starts on the real plugin, for every enclave of every sample.

The access control plugin of Cyclone DDS 0.10.2 looks at the permissions CA, the certificate's subject and both
documents, in domain 0 and at the time of the clock; identities are asked about elsewhere (tests/oracles/pkits).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path

import pytest

from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import VARIANTS
from keystore_audit.truth import Truth
from tests.oracles.xml.plugins import Plugin

pytestmark = pytest.mark.xdist_group("xml-oracle")

ASKED_ELSEWHERE = ("identity", "private key", "key of kind", "signed with", "revocation list")
"""Words of reasons that this plugin has no part in."""


def samples(repository: Path) -> Iterator[tuple[str, Path, Keystore]]:
    root = repository / "sample_keystores"
    for pattern in ("healthy/*/", "stock/*/", "unknown/*/", "rules/*/*/"):
        for store in sorted(root.glob(pattern)):
            with suppress(NothingToAudit):
                yield str(store.relative_to(root)), store, read_keystore(store)


def test_what_is_usable_starts_and_what_is_refused_does_not(plugins: dict[str, Plugin], repository: Path) -> None:
    now = datetime.now(timezone.utc)
    optimistic, pessimistic, compared = {}, {}, 0
    for name, store, keystore in samples(repository):
        usabilities = Usabilities(0, AccessViews(documents_of(keystore), now, None))
        for enclave in keystore.enclaves:
            try:
                refused = plugins["cyclone"].ask_enclave(store / enclave.files.directory).refused
            except OSError:  # a file is missing, which is a reason of its own
                continue
            compared += 1
            ours = usabilities.of(enclave, now, VARIANTS["cyclonedds-0.10"])
            if ours.usable.must and refused is not None:
                optimistic[name] = refused
            reasons = [reason for reason in ours.reasons if not any(word in reason for word in ASKED_ELSEWHERE)]
            if ours.usable is Truth.NO and refused is None and reasons:
                pessimistic[name] = reasons
    assert compared > 250
    assert optimistic == {}
    assert pessimistic == {}
