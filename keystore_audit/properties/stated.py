"""The properties of every keystore, each stated once; in report order."""

from __future__ import annotations

from keystore_audit.properties.result import Property, Role

# Who may take part: DDS-Security 1.1, 8.3 and 9.3.

ONLY_AUTHENTICATED_JOIN = Property(
    id="only-authenticated-participants-join",
    statement="Only participants that the identity CA vouches for join a domain.",
    attacker="unauthenticated participant",
    clause="DDS-Security 1.1, 9.4.1.2.4 (allow_unauthenticated_participants)",
    roles=(Role.TRUST_DOMAIN, Role.DOMAIN),
)

IDENTITIES_CHAIN = Property(
    id="identities-chain-to-the-identity-ca",
    statement="Every enclave's identity certificate is vouched for by its identity CA, in force and not revoked.",
    attacker="impostor",
    clause="DDS-Security 1.1, 9.3.2.1; RFC 5280, 6.1",
    roles=(Role.ENCLAVE,),
)

DOCUMENTS_SIGNED = Property(
    id="documents-signed-by-the-permissions-ca",
    statement="Every governance and permissions document is signed by the permissions CA itself.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.4.1.1",
    roles=(Role.ENCLAVE, Role.DOCUMENT),
)

NO_SHARED_IDENTITY = Property(
    id="no-identity-serves-two-enclaves",
    statement="No identity key serves two enclaves.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.3.1.1",
    roles=(Role.ENCLAVE, Role.OTHER),
)

NO_SELF_GRANTED_RIGHTS = Property(
    id="no-enclave-grants-itself-rights",
    statement="No enclave can sign a permissions document that its peers accept.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.4.1.1; CVE-2023-24010, CVE-2023-24011, CVE-2023-24012",
    roles=(Role.TRUST_DOMAIN, Role.ENCLAVE),
)

ONE_CA_FOR_ONE_ROLE = Property(
    id="one-ca-for-one-role",
    statement="No key serves as identity CA and as permissions CA.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.3.1 and 9.4.1.1; CVE-2023-24010",
    roles=(Role.TRUST_DOMAIN, Role.CERTIFICATE, Role.OTHER_CERTIFICATE),
)

NO_SHARED_SUBJECT = Property(
    id="no-subject-serves-two-enclaves",
    statement="No grant names the identities of two enclaves.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.4.1.3.2.1 (subject_name)",
    roles=(Role.ENCLAVE, Role.OTHER),
)

# What somebody without any key of the keystore can do: DDS-Security 1.1, 9.5.

OUTSIDERS_CANNOT_READ = Property(
    id="outsiders-cannot-read",
    statement="No payload is readable without a key of this keystore.",
    attacker="passive outsider",
    clause="DDS-Security 1.1, 9.4.1.2.5.5 and 9.4.1.2.6 (metadata and data protection kinds)",
    roles=(Role.TRUST_DOMAIN, Role.CHANNEL),
)

OUTSIDERS_CANNOT_LEARN_NAMES = Property(
    id="outsiders-cannot-learn-names",
    statement="No topic name is readable in discovery without a key of this keystore.",
    attacker="passive outsider",
    clause="DDS-Security 1.1, 9.4.1.2.5.3 and 9.4.1.2.6.2 (discovery protection)",
    roles=(Role.TRUST_DOMAIN, Role.CHANNEL),
)

OUTSIDERS_CANNOT_INJECT = Property(
    id="outsiders-cannot-inject",
    statement="No reader takes a sample that was made without a key of this keystore.",
    attacker="active outsider",
    clause="DDS-Security 1.1, 9.4.1.2.5.5 and 9.4.1.2.6 (rtps, metadata and data protection kinds)",
    roles=(Role.TRUST_DOMAIN, Role.CHANNEL),
)

OUTSIDERS_CANNOT_REPLAY = Property(
    id="outsiders-cannot-replay",
    statement="No reader takes a recorded sample for a new one, nor a HEARTBEAT or GAP made without a key.",
    attacker="active outsider",
    clause="DDS-Security 1.1, 9.5.3.3 and 9.4.1.2.6 (rtps and metadata protection kinds)",
    roles=(Role.TRUST_DOMAIN, Role.CHANNEL),
)

OUTSIDERS_CANNOT_FORGE_LIVELINESS = Property(
    id="outsiders-cannot-forge-liveliness",
    statement="Nobody without a key of this keystore can assert that a writer is alive.",
    attacker="active outsider",
    clause="DDS-Security 1.1, 9.4.1.2.5.4 and 9.4.1.2.6.3 (liveliness protection)",
    roles=(Role.TRUST_DOMAIN, Role.CHANNEL),
)

# Whether rights are what the signed permissions grant: DDS-Security 1.1, 8.4 and 9.4.

GRANTS_ARE_ENFORCED = Property(
    id="grants-are-enforced",
    statement="Wherever a permissions document grants something, the governance makes peers ask for the grant.",
    attacker="insider without a grant",
    clause="DDS-Security 1.1, 9.4.1.2.4 and 9.4.1.2.6 (join, read and write access control)",
    roles=(Role.TRUST_DOMAIN, Role.CHANNEL),
)

NOBODY_WRITES_WITHOUT_A_GRANT = Property(
    id="nobody-writes-without-a-grant",
    statement=(
        "No enclave can publish a topic, so that peers accept it, without a publish grant from the permissions CA. "
        "Whether its readers can forge it is another property, readers-cannot-forge."
    ),
    attacker="insider without a grant",
    clause="DDS-Security 1.1, 8.4.2.9 (check_remote_datawriter) and 9.5.3.3",
    roles=(Role.TRUST_DOMAIN, Role.ENCLAVE, Role.CHANNEL),
)

NOBODY_READS_WITHOUT_A_GRANT = Property(
    id="nobody-reads-without-a-grant",
    statement="No enclave reads a topic for which the permissions CA gave it no subscribe grant.",
    attacker="insider without a grant",
    clause="DDS-Security 1.1, 8.4.2.9 (check_remote_datareader) and 9.5.3.3",
    roles=(Role.TRUST_DOMAIN, Role.ENCLAVE, Role.CHANNEL),
)

READERS_CANNOT_FORGE = Property(
    id="readers-cannot-forge",
    statement="No enclave that may only subscribe to a topic can pass for a publisher of it.",
    attacker="insider reader",
    clause="DDS-Security 1.1, 9.5.3.3 (origin authentication of submessages)",
    roles=(Role.TRUST_DOMAIN, Role.ENCLAVE, Role.CHANNEL),
)

RELAYS_CANNOT_READ = Property(
    id="relays-cannot-read",
    statement="No enclave that may only relay a topic can read its payload.",
    attacker="insider relay",
    clause="DDS-Security 1.1, 9.5.2.1.2 and 9.4.1.2.6 (data protection kind)",
    roles=(Role.TRUST_DOMAIN, Role.ENCLAVE, Role.CHANNEL),
)

# Where data can get to: from one domain into another (docs/model.md, information flow).

NO_BRIDGES = Property(
    id="no-enclave-bridges-domains",
    statement="No enclave can read in one domain and write in another one to which other rules apply.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.4.1.2.3 and 9.4.1.3.2.3 (domains of rules)",
    roles=(Role.TRUST_DOMAIN, Role.ENCLAVE, Role.CHANNEL, Role.OTHER_CHANNEL),
)

PROPERTIES: tuple[Property, ...] = (
    ONLY_AUTHENTICATED_JOIN,
    IDENTITIES_CHAIN,
    DOCUMENTS_SIGNED,
    NO_SHARED_IDENTITY,
    NO_SELF_GRANTED_RIGHTS,
    ONE_CA_FOR_ONE_ROLE,
    NO_SHARED_SUBJECT,
    OUTSIDERS_CANNOT_READ,
    OUTSIDERS_CANNOT_LEARN_NAMES,
    OUTSIDERS_CANNOT_INJECT,
    OUTSIDERS_CANNOT_REPLAY,
    OUTSIDERS_CANNOT_FORGE_LIVELINESS,
    GRANTS_ARE_ENFORCED,
    NOBODY_WRITES_WITHOUT_A_GRANT,
    NOBODY_READS_WITHOUT_A_GRANT,
    READERS_CANNOT_FORGE,
    RELAYS_CANNOT_READ,
    NO_BRIDGES,
)
