/**
 * What enclaves can do, by what peers concede and by the keys that they then hold (DDS-Security 1.1, 8.4.2.9 and 9.5).
 *
 * Who joins a domain gets the keys of its messages (`rtps_protection_kind`). Those that may read or relay get the key
 * of a writer's submessages (`metadata_protection_kind`). Those that may read get the key of its payloads
 * (`data_protection_kind`). Keys are symmetric: whoever can check can also make, unless the kind of submessages
 * authenticates the origin. That of messages does not. The sample's source stands inside (INFO_SRC), and no receiver
 * compares it with who sealed the message (measured on Cyclone DDS and Fast DDS). An enclave is taken at its worst: it
 * may use every key it holds in any way.
 *
 * Three forms, here and in the modules below, are there for the translator. They halve its time (100 enclaves, 200
 * topics). Most enclaves take part in most domains. So what is out of reach is subtracted: that is little, while all
 * within reach is nearly every pair of an enclave and a channel. A comprehension over members of a set stands in place
 * of "<:", which makes a product of the set and everything that exists. A comprehension of trust domains is decided at
 * once. A quantified one at the beginning of a `run` is a choice for the solver, and all that depends on it varies.
 */
module capabilities
open permissions

/** Grants by which a trust domain lets each enclave in; who issues itself identities, by any. */
fun admits[trust_domain: TrustDomain]: Enclave -> Grant {
	entering[trust_domain.accepted]
	+ trust_domain.issuing -> (trust_domain.accepted.grant & (in_force + joins_out_of_date))
}

/**
 * Enclaves that a trust domain lets in where it does not control who joins: all, or (`requires_grant`) those with a
 * grant.
 */
fun admitted[trust_domain: TrustDomain]: set Enclave {
	trust_domain in requires_grant implies admits[trust_domain].Grant + unbounded[trust_domain] else Enclave
}

/** Domains that each enclave can join, as a participant that the trust domain has authenticated. */
fun joins[trust_domain: TrustDomain]: Enclave -> Domain {
	let known = trust_domain.(authentic + issuing) |
		(known & admitted[trust_domain]) -> trust_domain.join_uncontrolled
		+ ((admits[trust_domain].joining + unbounded[trust_domain] -> Domain) & known -> trust_domain.governed_domain)
}

/** Channels in whose domain each enclave takes part, as far as they are governed. */
fun within_reach[trust_domain: TrustDomain]: Enclave -> Channel {
	joins[trust_domain].(~in_domain & Domain -> trust_domain.governed)
}

/** All other channels: those of domains in which each enclave takes no part, and those that are not governed. */
fun out_of_reach[trust_domain: TrustDomain]: Enclave -> Channel {
	(Enclave -> Domain - joins[trust_domain]).~in_domain + Enclave -> (Channel - trust_domain.governed)
}

/**
 * Channels for which peers ask no permissions of who announces its endpoints otherwise than they are: all, of
 * implementations that go by what is announced.
 */
fun unasked: TrustDomain -> Channel {
	(TruthfulAnnouncements in assumed implies none else asks_announced_only) -> Channel
}

/** Those that an enclave reaches. Only who attacks makes use of it. */
fun unannounced[trust_domain: TrustDomain]: Enclave -> Channel {
	Enclave -> trust_domain.unasked
	- out_of_reach[trust_domain]
}

/** Channels on which peers match a writer of the enclave. */
fun may_write[trust_domain: TrustDomain]: Enclave -> Channel {
	Enclave -> trust_domain.write_uncontrolled + presentable[trust_domain, publish_allowed] - out_of_reach[trust_domain]
}

/** Channels on which peers match a reader of the enclave, and give it all keys. */
fun may_read[trust_domain: TrustDomain]: Enclave -> Channel {
	Enclave -> trust_domain.read_uncontrolled + presentable[trust_domain, subscribe_allowed] - out_of_reach[trust_domain]
}

/** Channels whose submessage keys the enclave gets to relay them. */
fun relays[trust_domain: TrustDomain]: Enclave -> Channel {
	presentable[trust_domain, relay_allowed]
	- out_of_reach[trust_domain]
}

/**
 * Channels whose payloads an enclave recovers from packets, with the keys it holds without being a reader. The
 * payload is in the clear, and so is the submessage around it (`bare`), or the enclave has its key as a relay.
 */
fun overhears[trust_domain: TrustDomain]: Enclave -> Channel {
	let in_clear = Channel - trust_domain.(payload_protection[encrypting]),
		bare = in_clear - trust_domain.(submessage_protection[encrypting]) |
		Enclave -> bare - out_of_reach[trust_domain] + { e: Enclave, c: e.(relays[trust_domain]) & in_clear }
			+ unannounced[trust_domain]
}

/**
 * Channels on which an enclave can make packets that readers take for those of a permitted writer. It needs the key of
 * each layer that is protected; every member has that of messages. Keys are not enough on channels on which the
 * submessage tells which holder of the key made it (`attributed`).
 */
fun forges[trust_domain: TrustDomain]: Enclave -> Channel {
	let reader = may_read[trust_domain],
		attributed = trust_domain.(submessage_protection[authenticating_origin]),
		submessage = Enclave -> trust_domain.(submessage_protection[NONE]) - out_of_reach[trust_domain] + reader
			+ relays[trust_domain],
		payload = Enclave -> trust_domain.(payload_protection[NONE]) - out_of_reach[trust_domain] + reader |
		submessage & payload - Enclave -> attributed + unannounced[trust_domain]
}

/** Channels whose samples the enclave learns, as a reader or from packets. */
fun knows[trust_domain: TrustDomain]: Enclave -> Channel { may_read[trust_domain] + overhears[trust_domain] }

/** Channels whose readers, if there are any, take samples from the enclave, as a permitted writer or as a forger. */
fun feeds[trust_domain: TrustDomain]: Enclave -> Channel { may_write[trust_domain] + forges[trust_domain] }

/** Channels on which there may be something to read: some enclave may write. */
fun written: TrustDomain -> Channel { { trust_domain: TrustDomain, channel: Enclave.(may_write[trust_domain]) } }

/** Channels on which there may be somebody to deceive: some enclave may read. */
fun read: TrustDomain -> Channel { { trust_domain: TrustDomain, channel: Enclave.(may_read[trust_domain]) } }

-- who attacks nobody signs no permissions and issues no identities to itself, whatever its key is

/** Domains that such enclaves join as themselves, with documents that are there. */
fun joins_as_itself[trust_domain: TrustDomain]: Enclave -> Domain {
	let grants = entering[trust_domain.accepted], known = trust_domain.(authentic & (self_granting + issuing)),
		let_in = trust_domain in requires_grant implies grants.Grant + of_unknown_rights else Enclave |
		(known & let_in) -> trust_domain.join_uncontrolled
		+ { e: known, d: e.(grants.joining + of_unknown_rights -> Domain) & trust_domain.governed_domain }
}

/** Channels that such enclaves have by an attack alone, of those for which rights of the kind `allowed` are asked. */
fun usurped[trust_domain: TrustDomain, uncontrolled: set Channel, allowed: Grant -> Channel]: Enclave -> Channel {
	trust_domain.(self_granting + issuing) -> Channel
	- { e: trust_domain.(self_granting + issuing), c: e.(joins_as_itself[trust_domain]).~in_domain
		& (uncontrolled + e.(with_met[held[trust_domain.accepted].allowed] + of_unknown_rights -> Channel)) }
}

/** Channels on which peers match a writer of the enclave while it attacks nobody. */
fun writes_honestly[trust_domain: TrustDomain]: Enclave -> Channel {
	may_write[trust_domain] - usurped[trust_domain, trust_domain.write_uncontrolled, publish_allowed]
}

/** Channels on which peers match a reader of the enclave while it attacks nobody. */
fun reads_honestly[trust_domain: TrustDomain]: Enclave -> Channel {
	may_read[trust_domain] - usurped[trust_domain, trust_domain.read_uncontrolled, subscribe_allowed]
}

-- endpoints that honest peers refuse are there all the same, and send and listen, protected as their own trust domain
-- says

/** Channels with a writer, though it may be one that nobody takes for permitted. */
fun written_at_all: TrustDomain -> Channel { written + ~in_trust_domain.writes_alone }

/** Channels with a reader, though it may be one to which no honest writer gives its keys. */
fun read_at_all: TrustDomain -> Channel { read + ~in_trust_domain.reads_alone }
