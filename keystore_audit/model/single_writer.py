"""Topics that one enclave alone may publish: which it is now."""

from __future__ import annotations

from keystore_audit.model.attacker import realm_views
from keystore_audit.model.permission import bits
from keystore_audit.model.system import System


def some_writer(system: System, channels: frozenset[int]) -> frozenset[int]:
    """One enclave that may write one of the channels at the audit instant, none where nobody may.

    One that could be read is taken rather than one that may be anybody, and none that is no enclave's identity. That
    nobody else writes there is not said.
    """
    asked = bits(channels)
    views = realm_views(system)
    enclaves = [number for number, enclave in enumerate(system.enclaves) if not enclave.at_large]
    for number in sorted(enclaves, key=lambda number: system.enclaves[number].opaque):
        if any(view.abilities(number).may_write & asked for view in views):
            return frozenset({number})
    return frozenset()
