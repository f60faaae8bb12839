/**
 * The properties that keystore-audit asserts of every keystore, by name: see `keystore-audit explain PROPERTY`.
 *
 * Each begins with `all`, and the names of its variables are roles: in a counterexample they tell who does what to
 * whom. A family is worth something only where it has something to speak of: see the module `vacuity`. Above each
 * family stand its clauses of DDS-Security 1.1.
 */
module properties
open enforcement

-- Of trust domains those count that enclaves are of. Where only unmanaged identities are, who comes there wants it so.

-- authentication: who may take part (8.3 and 9.3)

/** Only participants that the identity CA vouches for join a domain. */
pred OnlyAuthenticatedParticipantsJoin {
	all trust_domain: of_enclaves, domain: Domain | domain not in trust_domain.unauthenticated_allowed
}

/** Every enclave's identity is vouched for by its identity CA, in force and not revoked. */
pred IdentitiesChainToTheIdentityCa {
	all enclave: Enclave - Unmanaged |
		enclave not in anybody
		and (some enclave.identity implies enclave in enclave.in_trust_domain.introduced_in_force)
}

/** Every governance and permissions document is signed by the permissions CA itself, in force. */
pred DocumentsSignedByThePermissionsCa {
	all enclave: Enclave - Unmanaged,
		document: enclave.permissions & enclave.in_trust_domain.reading + enclave.in_trust_domain.governance |
		document in enclave.in_trust_domain.genuine and document.signer in in_force
}

/** No identity key serves two enclaves. */
pred NoIdentityServesTwoEnclaves {
	all enclave, other: Enclave | other not in enclave.shares_identity
}

/** No subject that permissions documents grant rights to is the subject of two enclaves. */
pred NoSubjectServesTwoEnclaves {
	all enclave, other: Enclave | other not in enclave.shares_subject
}

/** No enclave can sign a permissions document that its peers obey, or holds one that not the CA has signed. */
pred NoEnclaveGrantsItselfRights {
	all trust_domain: of_enclaves, enclave: Enclave |
		enclave not in trust_domain.self_granting and no enclave.permissions & (trust_domain.accepted - trust_domain.genuine)
}

/**
 * Who vouches for identities does not sign permissions: no key is that of an identity CA and of a permissions CA. Who
 * steals such a key has everything at once; and where signers are not pinned, identities fit to sign sign permissions.
 */
pred OneCaForOneRole {
	all trust_domain: of_enclaves, certificate: trust_domain.identity_ca, other_certificate: trust_domain.permissions_ca |
		certificate.public_key != other_certificate.public_key
}

-- encryption: what somebody without any key of the keystore can do (9.5)

/** No payload is readable without a key of this keystore. */
pred OutsidersCannotRead {
	all trust_domain: of_enclaves, channel: Channel | channel not in trust_domain.readable_outside
}

/** No topic name is readable in discovery without a key of this keystore. */
pred OutsidersCannotLearnNames {
	all trust_domain: of_enclaves, channel: Channel | channel not in trust_domain.announced_outside
}

/** No reader takes a sample that was made without a key of this keystore. */
pred OutsidersCannotInject {
	all trust_domain: of_enclaves, channel: Channel | channel not in trust_domain.injectable_outside
}

/** No reader takes an old sample for a new one from somebody without a key of this keystore. */
pred OutsidersCannotReplay {
	all trust_domain: of_enclaves, channel: Channel | channel not in trust_domain.replayable_outside
}

/** No reader believes somebody without a key of this keystore that a writer lives, or has gone. */
pred OutsidersCannotForgeLiveliness {
	all trust_domain: of_enclaves, channel: Channel | channel not in trust_domain.liveliness_forgeable_outside
}

-- access control: whether rights are what the signed permissions grant (8.4 and 9.4)

/** Wherever a permissions document grants something, the governance makes peers ask for the grant. */
pred GrantsAreEnforced {
	all trust_domain: of_enclaves, channel: Channel | channel not in trust_domain.unenforced
}

/** No enclave gets a sample taken on a topic for which the permissions CA gave it no grant at all. */
pred NobodyWritesWithoutAGrant {
	all trust_domain: of_enclaves, enclave: Enclave, channel: Channel |
		channel not in enclave.(writes_without_a_grant[trust_domain])
}

/** No enclave reads a topic for which the permissions CA gave it no subscribe grant. */
pred NobodyReadsWithoutAGrant {
	all trust_domain: of_enclaves, enclave: Enclave, channel: Channel |
		channel not in enclave.(reads_without_a_grant[trust_domain])
}

/** No enclave that may only subscribe to a topic can pass for a publisher of it. */
pred ReadersCannotForge {
	all trust_domain: of_enclaves, enclave: Enclave, channel: Channel |
		channel not in enclave.(forged_by_readers[trust_domain])
}

/** No enclave that is granted to relay a topic, and not to subscribe to it, reads what it relays. */
pred RelaysCannotRead {
	all trust_domain: of_enclaves, enclave: Enclave, channel: Channel |
		channel not in enclave.(read_by_relays[trust_domain])
}

/**
 * No enclave reads in one domain and writes in another, as whomever and in whatever trust domains; domains of one class
 * (`Domain`) are one. `carried_across` decides; the second channel is asked for so that a counterexample names both
 * ends of the bridge.
 */
pred NoEnclaveBridgesDomains {
	all trust_domain: of_enclaves, other_trust_domain: of_enclaves, enclave: Enclave,
		channel: enclave.(carried_across[trust_domain, other_trust_domain]),
		other_channel: enclave.acts_as.(feeds[other_trust_domain]) | channel.in_domain = other_channel.in_domain
}
