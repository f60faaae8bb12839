"""Who may take part: DDS-Security 1.1, 8.3 and 9.3."""

from __future__ import annotations

from keystore_audit.properties.property import Property, Role

ONLY_AUTHENTICATED_JOIN = Property(
    id="only-authenticated-participants-join",
    statement="Only participants that the identity CA vouches for join a domain.",
    attacker="unauthenticated participant",
    clause="DDS-Security 1.1, 9.4.1.2.4 (allow_unauthenticated_participants)",
    assertion="OnlyAuthenticatedParticipantsJoin",
    roles=(Role.REALM, Role.DOMAIN),
)

IDENTITIES_CHAIN = Property(
    id="identities-chain-to-the-identity-ca",
    statement="Every enclave's identity certificate is vouched for by its identity CA, in force and not revoked.",
    attacker="impostor",
    clause="DDS-Security 1.1, 9.3.2.1; RFC 5280, 6.1",
    assertion="IdentitiesChainToTheIdentityCa",
    roles=(Role.ENCLAVE,),
)

DOCUMENTS_SIGNED = Property(
    id="documents-signed-by-the-permissions-ca",
    statement="Every governance and permissions document is signed by the permissions CA itself.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.4.1.1",
    assertion="DocumentsSignedByThePermissionsCa",
    roles=(Role.ENCLAVE, Role.DOCUMENT),
)

NO_SHARED_IDENTITY = Property(
    id="no-identity-serves-two-enclaves",
    statement="No identity key serves two enclaves.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.3.1.1",
    assertion="NoIdentityServesTwoEnclaves",
    roles=(Role.ENCLAVE, Role.OTHER),
)

NO_SELF_GRANTED_RIGHTS = Property(
    id="no-enclave-grants-itself-rights",
    statement="No enclave can sign a permissions document that its peers accept.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.4.1.1; CVE-2023-24010, CVE-2023-24011, CVE-2023-24012",
    assertion="NoEnclaveGrantsItselfRights",
    roles=(Role.REALM, Role.ENCLAVE),
)

ONE_CA_FOR_ONE_ROLE = Property(
    id="one-ca-for-one-role",
    statement="No key serves as identity CA and as permissions CA.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.3.1 and 9.4.1.1; CVE-2023-24010",
    assertion="OneCaForOneRole",
    roles=(Role.REALM, Role.CERTIFICATE, Role.OTHER_CERTIFICATE),
)

NO_SHARED_SUBJECT = Property(
    id="no-subject-serves-two-enclaves",
    statement="No grant names the identities of two enclaves.",
    attacker="compromised enclave",
    clause="DDS-Security 1.1, 9.4.1.3.2.1 (subject_name)",
    assertion="NoSubjectServesTwoEnclaves",
    roles=(Role.ENCLAVE, Role.OTHER),
)

PROPERTIES = (
    ONLY_AUTHENTICATED_JOIN,
    IDENTITIES_CHAIN,
    DOCUMENTS_SIGNED,
    NO_SHARED_IDENTITY,
    NO_SELF_GRANTED_RIGHTS,
    ONE_CA_FOR_ONE_ROLE,
    NO_SHARED_SUBJECT,
)
