/**
 * What enclaves can do beyond what the permissions CA granted them (DDS-Security 1.1, 8.4 and 9.4).
 */
module enforcement
open outsiders

/** Channels on which some enclave has a grant, or may have one, that the governance makes nobody ask for. */
fun unenforced: Realm -> Channel {
	{ realm: Realm, channel: realm.governed |
		let publishers = may_be_granted[realm, publish_allowed].channel,
		    subscribers = may_be_granted[realm, subscribe_allowed].channel {
			some publishers and channel in realm.write_uncontrolled
			or some subscribers and channel in realm.read_uncontrolled
			or some publishers + subscribers and channel.in_domain in realm.join_uncontrolled
		} }
}

/**
 * Channels on which an enclave has its samples taken without a grant to publish. Who forges with keys that a grant to
 * subscribe brought along is left to `forged_by_readers`: there only authentication of the origin helps.
 */
fun writes_without_a_grant[realm: Realm]: Enclave -> Channel {
	may_write[realm] + (forges[realm] - granted[realm, subscribe_allowed]) - granted[realm, publish_allowed]
}

/** Channels that an enclave reads, as a reader or from packets, without a grant to subscribe. */
fun reads_without_a_grant[realm: Realm]: Enclave -> Channel { knows[realm] - granted[realm, subscribe_allowed] }

/** Channels that are written, and on which an enclave, granted to subscribe only, can pass for a writer. */
fun forged_by_readers[realm: Realm]: Enclave -> Channel {
	{ e: Enclave, c: e.(forges[realm] & may_be_granted[realm, subscribe_allowed]) & realm.written }
	- granted[realm, publish_allowed]
}

/** Channels that an enclave is there to relay, and reads without a grant to subscribe: the payload is in the clear. */
fun read_by_relays[realm: Realm]: Enclave -> Channel {
	{ e: Enclave, c: e.(relays[realm]) - realm.(payload_protection[encrypting]) }
	- granted[realm, subscribe_allowed]
}

/**
 * Channels of which an enclave learns what members of `sending` write, and which it could carry into another domain: it
 * feeds some channel there, whose readers are members of `receiving`, as whomever its key lets it act. Who learns
 * something as another need not be asked about: that one carries the same.
 */
fun carried_across[sending, receiving: Realm]: Enclave -> Channel {
	knows[sending] & acts_as.(feeds[receiving]).in_domain.(Domain -> Domain - iden).~in_domain
}
