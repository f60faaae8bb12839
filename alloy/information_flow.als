/**
 * Where data can go: from writers to readers, over any number of enclaves, whatever runs in them.
 *
 * A *participant* is an enclave, or the outsider. What a participant has received may be in anything that it sends
 * later, so data goes on wherever there is a next hop. A *hop* takes a sample of one channel from one participant to
 * another one. There are three routes, and an attacker opens the second and the third:
 *
 *   by right        the writer matches the reader, and each gives the other its keys
 *   imposed         one of `forgers` has its sample taken, by any identity whose key it has, or by readers' keys
 *   intercepted     one of `eavesdroppers` recovers a sample that was never meant for it
 *
 * Who forges and who eavesdrops is the attacker, of whom a claim names one. *honest*: nobody does, but that the
 * outsider listens, which nobody can keep it from. *source*: those with whom the flow begins forge. *relays*:
 * everybody on the way does both, the outsider too; not `relay`, the right.
 *
 * A key adds to what its holder can do on the network and takes nothing away. An enclave that forges or eavesdrops
 * does so without any key as well, wherever the outsider could.
 *
 * That data cannot get from one place to another has a certificate: a compartment. This is a set of participants that
 * holds the beginning and not the end, and that no hop leads out of. The Analyzer looks for one. If there is one, no
 * chain of hops of any length leads out. If there is none, the participants that can be reached are no compartment,
 * because the end is among them. So the answer is exact, and costs a multiple of the number of hops. The transitive
 * closure of the hops would cost the cube of the number of participants.
 *
 * That data does get there has one too: a flow, hop by hop (`gets`, `hop`, `puts`). Each hop leads from a participant
 * that every compartment must hold to another such one. The last leads to the end, so there is no compartment. Where
 * keystore-audit expects a flow and can name one, this is asked, which takes the solver no choice.
 */
module information_flow
open vacuity

/** Somebody who has no key of the keystore, and can see and send packets. An atom, so that data can stay with it. */
one sig Outsider {}

/** What `each` has as itself; those of `attackers` also have what it is to those as whom they can act. */
fun in_any_guise[attackers: set Enclave + Outsider, each: Enclave -> Channel]: Enclave -> Channel {
	each + { e: attackers & Enclave, c: e.acts_as.each }
}

-- What members of a trust domain have is written as what everybody has, minus what strangers have. In most keystores
-- these are none, and there may be a million rights (see `capabilities`).

/** Everything of those who are not members of the trust domain. */
fun of_strangers[trust_domain: TrustDomain]: Enclave -> Channel { (Enclave - in_trust_domain.trust_domain) -> Channel }

/** Channels that each member of a trust domain subscribes to by right. */
fun takes[trust_domain: TrustDomain]: Enclave -> Channel { reads_honestly[trust_domain] - of_strangers[trust_domain] }

-- by right: members of two trust domains each ask for the rights of the other
-- Of a reader its own trust domain is asked too. Of a writer it is not: what a trust domain forbids its own is no
-- protection for others. But where peers run another implementation, its own may read its permissions otherwise.

/** Trust domains in fleets of several implementations. */
fun mixed: set TrustDomain { { trust_domain: TrustDomain | TrustDomain.reading not in trust_domain.reading } }

/** Channels that no document gives members of the trust domain the right to write, as their own one reads it. */
fun unwritten[trust_domain: TrustDomain]: Enclave -> Channel {
	(in_trust_domain.trust_domain - of_unknown_rights) -> (Channel - trust_domain.write_uncontrolled)
	- with_met[held[trust_domain.accepted].publish_allowed] - emits_alone[trust_domain]
}

/** The same of all, in fleets of several implementations. */
fun kept_back: Enclave -> Channel {
	TrustDomain.{ trust_domain: mixed, e: Enclave, c: e.(unwritten[trust_domain]) }
}

/** Channels on which each enclave writes to members of the trust domain, and attacks nobody. */
fun emits[trust_domain: TrustDomain]: Enclave -> Channel { writes_honestly[trust_domain] - kept_back }

/** Channels on which members of the trust domain `sending` write to members of `receiving`. */
fun sends[sending, receiving: TrustDomain]: Enclave -> Channel { emits[receiving] - of_strangers[sending] }

/**
 * Channels that a member's own implementation alone lets it read. This matters where peers run another one: they may
 * concede what peers like it would not.
 */
fun takes_alone[trust_domain: TrustDomain]: Enclave -> Channel {
	{ e: in_trust_domain.(trust_domain & mixed), c: e.reads_alone }
}

/** Channels on which members of `receiving` read what members of `sending` write: these give them their keys. */
fun receives[sending, receiving: TrustDomain]: Enclave -> Channel {
	(takes[receiving] + takes_alone[receiving])
	& reads_honestly[sending]
}

-- imposed

/**
 * Channels on which members of the trust domain take the samples of `forgers`: with their keys, or as those of
 * anybody.
 */
fun imposes[forgers: set Enclave + Outsider, trust_domain: TrustDomain]: (Enclave + Outsider) -> Channel {
	{ e: forgers & Enclave, c: e.acts_as.(feeds[trust_domain]) } + forgers -> trust_domain.unguarded
}

/**
 * Channels that each member of a trust domain reads if the writer attacks. An attacker gives its keys to anybody, so
 * only its own implementation binds the reader.
 */
fun heeds[trust_domain: TrustDomain]: Enclave -> Channel {
	takes[trust_domain] + { e: in_trust_domain.trust_domain, c: e.reads_alone }
}

/** The same of members that attack: with whatever permissions they sign themselves. */
fun hears[trust_domain: TrustDomain]: Enclave -> Channel {
	may_read[trust_domain] - of_strangers[trust_domain]
	+ heeds[trust_domain]
}

/** Channels that each participant reads of one who attacks, through a member of the trust domain as whom it acts. */
fun is_told[eavesdroppers: set Enclave + Outsider, trust_domain: TrustDomain]: Enclave -> Channel {
	heeds[trust_domain] + { e: eavesdroppers & Enclave, c: e.acts_as.(hears[trust_domain]) }
}

/** Channels that each participant gets as a reader; of one who attacks also those that it is told. */
fun obtains[eavesdroppers: set Enclave + Outsider, trust_domain: TrustDomain]: Enclave -> Channel {
	takes[trust_domain] + takes_alone[trust_domain]
	+ { e: eavesdroppers & Enclave, c: e.acts_as.(hears[trust_domain]) }
}

-- intercepted

/** Channels on which members of a trust domain write by what their own implementation alone lets them. */
fun emits_alone[trust_domain: TrustDomain]: Enclave -> Channel {
	{ e: in_trust_domain.trust_domain, c: e.writes_alone }
}

/**
 * Channels of which samples of each participant are on the network, protected as the trust domain says. It writes them
 * by right, or imposes them. Or, as a member, it writes though honest readers refuse it: who listens or attacks asks
 * for no right.
 */
fun exposes[forgers: set Enclave + Outsider, trust_domain: TrustDomain]: (Enclave + Outsider) -> Channel {
	in_any_guise[forgers, emits[trust_domain] + emits_alone[trust_domain]] + imposes[forgers, trust_domain]
}

/**
 * Channels of which `eavesdroppers` learn what is on the network as the trust domain protects it. They read packets
 * that anybody can read, or use their keys, or keys that the trust domain gives them as readers. What their own
 * trust domain would have them refuse binds honest readers alone (`receives`, `takes`).
 */
fun intercepts[eavesdroppers: set Enclave + Outsider, trust_domain: TrustDomain]: (Enclave + Outsider) -> Channel {
	{ e: eavesdroppers & Enclave, c: e.acts_as.(knows[trust_domain]) } + eavesdroppers -> trust_domain.in_clear
}

-- one hop

/** Whom one hop reaches from some of `holders`, on `usable` channels, from and to members of two trust domains. */
fun next[holders: set Enclave + Outsider, usable: set Channel, forgers, eavesdroppers: set Enclave + Outsider,
         sending, receiving: TrustDomain]: set Enclave + Outsider {
	receives[sending, receiving].(usable & holders.(sends[sending, receiving]))
	+ is_told[eavesdroppers, receiving].(usable & holders.(imposes[forgers, receiving]))
	+ intercepts[eavesdroppers, sending].(usable & holders.(exposes[forgers, sending]))
}

/** A sample of `over` goes from `holder` to `receiver`, who is somebody else. */
pred hop[holder: Enclave + Outsider, over: Channel, receiver: Enclave + Outsider,
         forgers, eavesdroppers: set Enclave + Outsider] {
	holder != receiver
	some { sending, receiving: TrustDomain | receiver in next[holder, over, forgers, eavesdroppers, sending, receiving] }
}

-- where flows begin and end

/** Participants that get a sample of one of `channels`, as readers in the trust domain or from its packets. */
fun getters[channels: set Channel, eavesdroppers: set Enclave + Outsider, trust_domain: TrustDomain]: set Enclave
	+ Outsider {
	(obtains[eavesdroppers, trust_domain] + intercepts[eavesdroppers, trust_domain]).channels
}

/**
 * Participants whose samples members of the trust domain take on one of `channels`, or `eavesdroppers`, if they read
 * there.
 */
fun putters[channels: set Channel, forgers, eavesdroppers: set Enclave + Outsider,
	trust_domain: TrustDomain]: set Enclave + Outsider {
	(emits[trust_domain] + imposes[forgers, trust_domain]
		+ { e: eavesdroppers & Enclave, c: e.acts_as.(emits_alone[trust_domain]) }).channels
}

/** `getter` gets a sample of one of `channels`. */
pred gets[getter: Enclave + Outsider, channels: set Channel, eavesdroppers: set Enclave + Outsider] {
	some { trust_domain: TrustDomain | getter in getters[channels, eavesdroppers, trust_domain] }
}

/** Some member, or one who attacks, takes a sample of `putter` on one of `channels`, if it reads there. */
pred puts[putter: Enclave + Outsider, channels: set Channel, forgers, eavesdroppers: set Enclave + Outsider] {
	some { trust_domain: TrustDomain | putter in putters[channels, forgers, eavesdroppers, trust_domain] }
}

/**
 * `inside` is a compartment: nothing flows from `source` (or a sample of `first`) to `target` (or a sample of `last`)
 * except over `through`. Where a claim begins at channels `source` is empty, where at participants `first`; likewise
 * `target` and `last`. `usable`: channels that hops may take.
 *
 * `through` are gateways ("never, except through these"): data may come to them and is not followed any further, so
 * they need not be inside. That goes for who gets a sample of `first` too, and one who could put it on `last` counts
 * only if it is inside. An enclave of `source` is inside in any case, since the flow begins there.
 *
 * So there are two conditions at the end. No hop leads from inside to anywhere else, nor to the target. An enclave that
 * is source and target at once (`home`) is inside. So another question is asked of it: whether anybody else inside has
 * a hop to it. What an enclave tells itself is no flow.
 */
pred separated[inside, source: set Enclave + Outsider, first: set Channel, target: set Enclave + Outsider,
               last: set Channel, through: set Enclave, usable: set Channel,
               forgers, eavesdroppers: set Enclave + Outsider] {
	source in inside
	all trust_domain: TrustDomain {
		getters[first, eavesdroppers, trust_domain] in inside + through - target
		no inside & putters[last, forgers, eavesdroppers, trust_domain]
	}
	all sending, receiving: TrustDomain {
		next[inside, usable, forgers, eavesdroppers, sending, receiving] in inside + through - (target - source)
		all home: source & target |
			home not in next[inside - home, usable, forgers, eavesdroppers, sending, receiving]
	}
}

/**
 * Somewhere data does flow: one participant can tell another something by right, so that there is a flow to ask for.
 * That is on a channel with writers and readers, if all of these together are more than one.
 */
pred FlowIsExercised {
	some { sending, receiving: TrustDomain |
		some channel: Enclave.(sends[sending, receiving]) & Enclave.(receives[sending, receiving]) |
			not lone (sends[sending, receiving] + receives[sending, receiving]).channel }
}
