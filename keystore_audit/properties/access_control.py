"""Whether rights are what the signed permissions grant: DDS-Security 1.1, 8.4 and 9.4."""

from __future__ import annotations

from keystore_audit.properties.property import Property, Role

GRANTS_ARE_ENFORCED = Property(
    id="grants-are-enforced",
    statement="Wherever a permissions document grants something, the governance makes peers ask for the grant.",
    attacker="insider without a grant",
    clause="DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.2.6 (join, read and write access control)",
    assertion="GrantsAreEnforced",
    roles=(Role.REALM, Role.CHANNEL),
)

NOBODY_WRITES_WITHOUT_A_GRANT = Property(
    id="nobody-writes-without-a-grant",
    statement=(
        "No enclave gets a sample taken on a topic for which the permissions CA gave it neither a publish "
        "nor a subscribe grant, or that it reads only because read access control is off."
    ),
    attacker="insider without a grant",
    clause="DDS-Security 1.1, 8.4.2.9 (check_remote_datawriter) and 9.5.3.3",
    assertion="NobodyWritesWithoutAGrant",
    roles=(Role.REALM, Role.ENCLAVE, Role.CHANNEL),
)

NOBODY_READS_WITHOUT_A_GRANT = Property(
    id="nobody-reads-without-a-grant",
    statement="No enclave reads a topic for which the permissions CA gave it no subscribe grant.",
    attacker="insider without a grant",
    clause="DDS-Security 1.1, 8.4.2.9 (check_remote_datareader) and 9.5.3.3",
    assertion="NobodyReadsWithoutAGrant",
    roles=(Role.REALM, Role.ENCLAVE, Role.CHANNEL),
)

READERS_CANNOT_FORGE = Property(
    id="readers-cannot-forge",
    statement="No enclave that may only subscribe to a topic can pass for a publisher of it.",
    attacker="insider reader",
    clause="DDS-Security 1.1, 9.5.3.3 (origin authentication)",
    assertion="ReadersCannotForge",
    roles=(Role.REALM, Role.ENCLAVE, Role.CHANNEL),
)

RELAYS_CANNOT_READ = Property(
    id="relays-cannot-read",
    statement="No enclave that may only relay a topic can read its payload.",
    attacker="insider relay",
    clause="DDS-Security 1.1, 9.5.2.1.2 and 9.4.1.2.6 (data protection kind)",
    assertion="RelaysCannotRead",
    roles=(Role.REALM, Role.ENCLAVE, Role.CHANNEL),
)

PROPERTIES = (
    GRANTS_ARE_ENFORCED,
    NOBODY_WRITES_WITHOUT_A_GRANT,
    NOBODY_READS_WITHOUT_A_GRANT,
    READERS_CANNOT_FORGE,
    RELAYS_CANNOT_READ,
)
