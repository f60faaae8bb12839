/**
 * The properties that keystore-audit asserts of every keystore, by name: see `keystore-audit explain PROPERTY`.
 *
 * Each begins with `all`, and the names of its variables are roles: in a counterexample they tell who does what to
 * whom. A family is worth something only where it has something to speak of: see the module `vacuity`.
 */
module properties
open capabilities

-- authentication: who may take part (8.3 and 9.3)

/** Only participants that the identity CA vouches for join a domain. */
assert OnlyAuthenticatedParticipantsJoin {
	all realm: Realm, domain: Domain | domain not in realm.unauthenticated_allowed
}

/** Every enclave's identity is vouched for by its identity CA, in force and not revoked. */
assert IdentitiesChainToTheIdentityCa {
	all enclave: Enclave |
		enclave not in opaque and (some enclave.identity implies enclave in enclave.in_realm.authentic_in_force)
}

/** Every governance and permissions document is signed by the permissions CA itself, in force. */
assert DocumentsSignedByThePermissionsCa {
	all enclave: Enclave, document: enclave.permissions + enclave.in_realm.governance |
		document in enclave.in_realm.genuine and document.signer in in_force
}

/** No identity key serves two enclaves. */
assert NoIdentityServesTwoEnclaves {
	all enclave, other: Enclave | enclave not in opaque and other not in enclave.one_key
}

/** No enclave can sign a permissions document that its peers obey, or holds one that not the CA has signed. */
assert NoEnclaveGrantsItselfRights {
	all realm: Realm, enclave: Enclave |
		enclave not in realm.self_granting and no enclave.permissions & (realm.accepted - realm.genuine)
}

-- encryption: what somebody without any key of the keystore can do (9.5)

/** Channels whose payloads anybody can read who sees the packets. */
fun readable_outside: Realm -> Channel {
	governed & written
	- message_protection[encrypting] - submessage_protection[encrypting] - payload_protection[encrypting]
}

/** No payload is readable without a key of this keystore. */
assert OutsidersCannotRead {
	all realm: Realm, channel: Channel | channel not in realm.readable_outside
}

/** Channels whose names anybody learns who sees the packets of discovery. */
fun announced_outside: Realm -> Channel {
	governed & (written + read) - message_protection[encrypting] - discovery_encrypted
}

/** No topic name is readable in discovery without a key of this keystore. */
assert OutsidersCannotLearnNames {
	all realm: Realm, channel: Channel | channel not in realm.announced_outside
}

/**
 * Channels whose readers take samples from anybody who can send packets. Where unauthenticated participants are
 * allowed, their messages come in the clear, whatever protects those of the others (measured on Cyclone DDS).
 */
fun injectable_outside: Realm -> Channel {
	governed & read & (message_protection[NONE] + unauthenticated_allowed.~in_domain)
		& submessage_protection[NONE] & payload_protection[NONE]
}

/** No reader takes a sample that was made without a key of this keystore. */
assert OutsidersCannotInject {
	all realm: Realm, channel: Channel | channel not in realm.injectable_outside
}

-- access control: whether rights are what the signed permissions grant (8.4 and 9.4)

/** Channels on which some enclave has a grant that the governance makes nobody ask for. */
fun unenforced: Realm -> Channel {
	{ realm: Realm, channel: realm.governed |
		let publishers = granted[realm, publish_allowed].channel,
		    subscribers = granted[realm, subscribe_allowed].channel {
			some publishers and channel in realm.write_uncontrolled
			or some subscribers and channel in realm.read_uncontrolled
			or some publishers + subscribers and channel.in_domain in realm.join_uncontrolled
		} }
}

/** Wherever a permissions document grants something, the governance makes peers ask for the grant. */
assert GrantsAreEnforced {
	all realm: Realm, channel: Channel | channel not in realm.unenforced
}

/** Channels on which an enclave has its samples taken, without a grant to publish or, where it forges, to subscribe. */
fun writes_without_a_grant[realm: Realm]: Enclave -> Channel {
	may_write[realm] + (forges[realm] - granted[realm, subscribe_allowed]) - granted[realm, publish_allowed]
}

/** No enclave gets a sample taken on a topic for which the permissions CA gave it no grant at all. */
assert NobodyWritesWithoutAGrant {
	all realm: Realm, enclave: Enclave, channel: Channel | channel not in enclave.(writes_without_a_grant[realm])
}

/** Channels that an enclave reads, as a reader or from packets, without a grant to subscribe. */
fun reads_without_a_grant[realm: Realm]: Enclave -> Channel {
	may_read[realm] + overhears[realm] - granted[realm, subscribe_allowed]
}

/** No enclave reads a topic for which the permissions CA gave it no subscribe grant. */
assert NobodyReadsWithoutAGrant {
	all realm: Realm, enclave: Enclave, channel: Channel | channel not in enclave.(reads_without_a_grant[realm])
}

/** Channels that are written, and on which an enclave, granted to subscribe only, can pass for a writer. */
fun forged_by_readers[realm: Realm]: Enclave -> Channel {
	(forges[realm] & granted[realm, subscribe_allowed] & Enclave -> realm.written) - granted[realm, publish_allowed]
}

/** No enclave that may only subscribe to a topic can pass for a publisher of it. */
assert ReadersCannotForge {
	all realm: Realm, enclave: Enclave, channel: Channel | channel not in enclave.(forged_by_readers[realm])
}
