/**
 * What enclaves can do, by what peers concede and by the keys that they then hold (DDS-Security 1.1, 8.4.2.9 and 9.5).
 *
 * Who joins a domain gets the keys of its messages (`rtps_protection_kind`). The key of a writer's submessages
 * (`metadata_protection_kind`) goes to those that may read or relay, the key of its payloads
 * (`data_protection_kind`) to those that may read. Keys are symmetric: whoever can check can also make, unless the
 * kind of submessages authenticates the origin. That of messages does not: who a sample is of stands inside (INFO_SRC),
 * and no receiver compares it with who sealed the message (measured on Cyclone DDS and Fast DDS). An enclave is taken
 * at its worst: it may use every key it holds in any way.
 *
 * Three forms, here and in the modules below, are there for the translator, which takes less than half the time with
 * them (100 enclaves, 200 topics). Most enclaves take part in most domains. So what is out of reach is taken away,
 * which is little, where all that is within reach is nearly every pair of an enclave and a channel.
 * A comprehension over members of a set stands where "<:" would do, which makes a product of the set and everything
 * that exists. And a quantified realm that a `run` begins with is a choice for the solver, so that all that depends on
 * it varies, where a comprehension of realms is decided at once.
 */
module capabilities
open permissions

/** Grants by which a realm lets each enclave in; who issues itself identities, by any. */
fun admits[realm: Realm]: Enclave -> Grant {
	entering[realm.accepted] + realm.issuing -> (realm.accepted.grant & (in_force + joins_out_of_date))
}

/** Enclaves that a realm lets in where it does not control who joins: all, or (`requires_grant`) those with a grant. */
fun admitted[realm: Realm]: set Enclave {
	realm in requires_grant implies admits[realm].Grant + unbounded[realm] else Enclave
}

/** Domains that each enclave can join, as a participant that the realm has authenticated. */
fun joins[realm: Realm]: Enclave -> Domain {
	let known = realm.(authentic + issuing) |
		(known & admitted[realm]) -> realm.join_uncontrolled
		+ ((admits[realm].joining + unbounded[realm] -> Domain) & known -> realm.governed_domain)
}

/** Channels in whose domain each enclave takes part, as far as they are governed. */
fun within_reach[realm: Realm]: Enclave -> Channel {
	joins[realm].(~in_domain & Domain -> realm.governed)
}

/** All other channels: those of domains in which each enclave takes no part, and those that are not governed. */
fun out_of_reach[realm: Realm]: Enclave -> Channel {
	(Enclave -> Domain - joins[realm]).~in_domain + Enclave -> (Channel - realm.governed)
}

/**
 * Channels for which peers ask no permissions of who announces its endpoints otherwise than they are: all, of
 * implementations that go by what is announced.
 */
fun unasked: Realm -> Channel {
	(TruthfulAnnouncements in assumed implies none else asks_announced_only) -> Channel
}

/** Those that an enclave reaches. Only who attacks makes use of it. */
fun unannounced[realm: Realm]: Enclave -> Channel { Enclave -> realm.unasked - out_of_reach[realm] }

/** Channels on which peers match a writer of the enclave. */
fun may_write[realm: Realm]: Enclave -> Channel {
	Enclave -> realm.write_uncontrolled + presentable[realm, publish_allowed] - out_of_reach[realm]
}

/** Channels on which peers match a reader of the enclave, and give it all keys. */
fun may_read[realm: Realm]: Enclave -> Channel {
	Enclave -> realm.read_uncontrolled + presentable[realm, subscribe_allowed] - out_of_reach[realm]
}

/** Channels whose submessage keys the enclave gets to relay them. */
fun relays[realm: Realm]: Enclave -> Channel { presentable[realm, relay_allowed] - out_of_reach[realm] }

/**
 * Channels whose payloads an enclave recovers from packets, with the keys it holds without being a reader. The
 * payload is in the clear, and so is the submessage around it (`bare`), or the enclave has its key as a relay.
 */
fun overhears[realm: Realm]: Enclave -> Channel {
	let in_clear = Channel - realm.(payload_protection[encrypting]),
		bare = in_clear - realm.(submessage_protection[encrypting]) |
		Enclave -> bare - out_of_reach[realm] + { e: Enclave, c: e.(relays[realm]) & in_clear } + unannounced[realm]
}

/**
 * Channels on which an enclave can make packets that readers take for those of a permitted writer. It needs the key of
 * each layer that is protected (that of messages every member has), and on channels on which the submessage tells who of
 * those that have the key made it (`attributed`), keys are not enough.
 */
fun forges[realm: Realm]: Enclave -> Channel {
	let reader = may_read[realm],
		attributed = realm.(submessage_protection[authenticating_origin]),
		submessage = Enclave -> realm.(submessage_protection[NONE]) - out_of_reach[realm] + reader + relays[realm],
		payload = Enclave -> realm.(payload_protection[NONE]) - out_of_reach[realm] + reader |
		submessage & payload - Enclave -> attributed + unannounced[realm]
}

/** Channels whose samples the enclave learns, as a reader or from packets. */
fun knows[realm: Realm]: Enclave -> Channel { may_read[realm] + overhears[realm] }

/** Channels whose readers, if there are any, take samples from the enclave, as a permitted writer or as a forger. */
fun feeds[realm: Realm]: Enclave -> Channel { may_write[realm] + forges[realm] }

/** Channels on which there may be something to read: some enclave may write. */
fun written: Realm -> Channel { { realm: Realm, channel: Enclave.(may_write[realm]) } }

/** Channels on which there may be somebody to deceive: some enclave may read. */
fun read: Realm -> Channel { { realm: Realm, channel: Enclave.(may_read[realm]) } }

-- who attacks nobody signs no permissions and issues no identities to itself, whatever its key is

/** Domains that such enclaves join as themselves, with documents that are there. */
fun joins_as_itself[realm: Realm]: Enclave -> Domain {
	let grants = entering[realm.accepted], known = realm.(authentic & (self_granting + issuing)),
		let_in = realm in requires_grant implies grants.Grant + of_unknown_rights else Enclave |
		(known & let_in) -> realm.join_uncontrolled
		+ { e: known, d: e.(grants.joining + of_unknown_rights -> Domain) & realm.governed_domain }
}

/** Channels that such enclaves have by an attack alone, of those for which rights of the kind `allowed` are asked. */
fun usurped[realm: Realm, uncontrolled: set Channel, allowed: Grant -> Channel]: Enclave -> Channel {
	realm.(self_granting + issuing) -> Channel
	- { e: realm.(self_granting + issuing), c: e.(joins_as_itself[realm]).~in_domain
		& (uncontrolled + e.(with_met[held[realm.accepted].allowed] + of_unknown_rights -> Channel)) }
}

/** Channels on which peers match a writer of the enclave while it attacks nobody. */
fun writes_honestly[realm: Realm]: Enclave -> Channel {
	may_write[realm] - usurped[realm, realm.write_uncontrolled, publish_allowed]
}

/** Channels on which peers match a reader of the enclave while it attacks nobody. */
fun reads_honestly[realm: Realm]: Enclave -> Channel {
	may_read[realm] - usurped[realm, realm.read_uncontrolled, subscribe_allowed]
}

-- endpoints that honest peers refuse are there all the same, and send and listen, protected as their own realm says

/** Channels with a writer, though it may be one that nobody takes for permitted. */
fun written_at_all: Realm -> Channel { written + ~in_realm.writes_alone }

/** Channels with a reader, though it may be one to which no honest writer gives its keys. */
fun read_at_all: Realm -> Channel { read + ~in_realm.reads_alone }
