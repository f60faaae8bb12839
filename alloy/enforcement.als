/**
 * What enclaves can do beyond what the permissions CA granted them (DDS-Security 1.1, 8.4 and 9.4).
 */
module enforcement
open outsiders

/** Channels on which some enclave has a grant, or may have one, that the governance makes nobody ask for. */
fun unenforced: TrustDomain -> Channel {
	{ trust_domain: TrustDomain, channel: trust_domain.governed |
		let publishers = may_be_granted[trust_domain, publish_allowed].channel,
		    subscribers = may_be_granted[trust_domain, subscribe_allowed].channel {
			some publishers and channel in trust_domain.write_uncontrolled
			or some subscribers and channel in trust_domain.read_uncontrolled
			or some publishers + subscribers and channel.in_domain in trust_domain.join_uncontrolled
		} }
}

/**
 * Channels on which an enclave has its samples taken without a grant to publish. Who forges with keys that a grant to
 * subscribe brought along is left to `forged_by_readers`: there only authentication of the origin helps.
 */
fun writes_without_a_grant[trust_domain: TrustDomain]: Enclave -> Channel {
	may_write[trust_domain] + (forges[trust_domain] - granted[trust_domain, subscribe_allowed])
	- granted[trust_domain, publish_allowed]
}

/** Channels that an enclave reads, as a reader or from packets, without a grant to subscribe. */
fun reads_without_a_grant[trust_domain: TrustDomain]: Enclave -> Channel {
	knows[trust_domain] - granted[trust_domain, subscribe_allowed]
}

/** Channels that are written, and on which an enclave, granted to subscribe only, can pass for a writer. */
fun forged_by_readers[trust_domain: TrustDomain]: Enclave -> Channel {
	{ e: Enclave, c: e.(forges[trust_domain] & may_be_granted[trust_domain, subscribe_allowed]) & trust_domain.written }
	- granted[trust_domain, publish_allowed]
}

/** Channels that an enclave is there to relay, and reads without a grant to subscribe: the payload is in the clear. */
fun read_by_relays[trust_domain: TrustDomain]: Enclave -> Channel {
	{ e: Enclave, c: e.(relays[trust_domain]) - trust_domain.(payload_protection[encrypting]) }
	- granted[trust_domain, subscribe_allowed]
}

/**
 * Channels of which an enclave learns what members of `sending` write, and which it could carry into another domain. It
 * feeds some channel there, whose readers are members of `receiving`, as anybody whose key it has. Who learns
 * something as another need not be asked about: that one carries the same.
 */
fun carried_across[sending, receiving: TrustDomain]: Enclave -> Channel {
	knows[sending] & acts_as.(feeds[receiving]).in_domain.(Domain -> Domain - iden).~in_domain
}
