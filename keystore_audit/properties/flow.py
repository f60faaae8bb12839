"""Where data can get to: from one domain into another (docs/model.md, information flow)."""

from __future__ import annotations

from keystore_audit.properties.property import Property, Role

NO_BRIDGES = Property(
    id="no-enclave-bridges-domains",
    statement="No enclave can read in one domain and write in another that the documents tell apart from it.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.4.1.2.3 and 9.4.1.3.2.3 (domains of rules)",
    assertion="NoEnclaveBridgesDomains",
    roles=(Role.REALM, Role.ENCLAVE, Role.CHANNEL, Role.OTHER_CHANNEL),
)

PROPERTIES = (NO_BRIDGES,)
