/**
 * Theorems about flows in every keystore within a scope.
 *
 * They tie the compartments, by which flows are decided, to chains of hops, by which they are defined, and the three
 * attackers to each other. `expect` makes the Analyzer's exit status the verdict.
 */
module flow_theorems
open claims

/** Every participant, and nobody. */
fun everybody: set Enclave + Outsider { Enclave + Outsider }
fun nobody: set Enclave + Outsider { none }

fun no_enclave: set Enclave { none }
fun no_channel: set Channel { none }

/** Hops as a relation, for the transitive closure. */
fun hops[usable: set Channel, forgers, eavesdroppers: set Enclave + Outsider]: (Enclave + Outsider) -> (Enclave
	+ Outsider) {
	{ a, b: Enclave + Outsider | some c: usable | hop[a, c, b, forgers, eavesdroppers] }
}

/** What can be reached from a place over participants that are not in `through`: by closure. */
fun reached[source: set Enclave + Outsider, through: set Enclave, usable: set Channel,
            forgers, eavesdroppers: set Enclave + Outsider]: set Enclave + Outsider {
	let hop = hops[usable, forgers, eavesdroppers],
		on = source <: hop + (everybody - through) <: hop |
		source.(hop & source -> everybody).*((everybody - through) <: on)
}

/** A compartment exists exactly where the closure does not lead to the target: one direction for each compartment. */
check CompartmentsKeepWhatTheyHold {
	all inside, source, target, forgers: set Enclave + Outsider, through: set Enclave, usable: set Channel |
		separated[inside, source, no_channel, target, no_channel, through, usable, forgers, nobody]
			implies no reached[source, through, usable, forgers, nobody] & target
} for 2 but 3 Enclave, 1 TrustDomain, 4 Entry, 1 Instant, 2 Key, 2 Certificate expect 0

/** The other direction: what the closure reaches, and where it began, is a compartment. */
check WhatIsReachedIsACompartment {
	all source, target: set Enclave + Outsider, through: set Enclave, usable: set Channel |
		let reach = reached[source, through, usable, everybody, everybody] | no reach & target
			implies separated[source + (reach - through), source, no_channel, target, no_channel,
			                  through, usable, everybody, everybody]
} for 2 but 3 Enclave, 1 TrustDomain, 4 Entry, 1 Instant, 2 Key, 2 Certificate expect 0

/** Whoever attacks, flows only become more: what holds against relays holds against the source, and for the honest. */
check AttackersOnlyAdd {
	all inside, source, target: set Enclave + Outsider, first, last: set Channel, through: set Enclave {
		separated[inside, source, first, target, last, through, Channel, everybody, everybody]
			implies separated[inside, source, first, target, last, through, Channel, source, Outsider]
		separated[inside, source, first, target, last, through, Channel, source, Outsider]
			implies separated[inside, source, first, target, last, through, Channel, nobody, Outsider]
	}
} for 2 but 3 Enclave, 4 Entry, 1 Instant expect 0

/** A key takes nothing away: what the outsider sends or gets, any enclave does that attacks as it does. */
check AKeyTakesNothingAway {
	all e: Enclave, c: Channel {
		Outsider.(hops[c, everybody, everybody]) - e in e.(hops[c, everybody, everybody])
		hops[c, everybody, everybody].Outsider - e in hops[c, everybody, everybody].e
		Outsider.(hops[c, Outsider, Outsider]) - e in e.(hops[c, e, Outsider])
		puts[Outsider, c, Outsider, Outsider] implies puts[e, c, e, Outsider]
		gets[Outsider, c, Outsider] implies gets[e, c, everybody]
	}
} for 2 but 3 Enclave, 4 Entry, 1 Instant expect 0

/**
 * Nobody but a forger, an eavesdropper or the outsider is at an end of a hop without having joined its domain, or
 * reading there by what its own implementation alone allows. Who joined no domain gets what is in clear at most.
 */
check HopsNeedAJoinedDomain {
	all a, b: Enclave, c: Channel | hop[a, c, b, nobody, nobody]
		implies some sending, receiving: TrustDomain |
			c.in_domain in a.(joins[receiving]) & b.(joins[sending])
			and (c.in_domain in b.(joins[receiving]) or c in b.(takes_alone[receiving]))
	all c: Channel | some hops[c, everybody, everybody] :> Enclave
		implies c in Enclave.reads_alone + TrustDomain.in_clear or some trust_domain: TrustDomain |
			c.in_domain in Enclave.(joins[trust_domain])
} for 2 but 3 Enclave, 4 Entry, 1 Instant expect 0

/** Where nothing is governed, nothing flows. */
check NothingFlowsUngoverned {
	no governed implies no hops[Channel, everybody, everybody]
} for 2 but 3 Enclave, 4 Entry, 1 Instant expect 0

/** A flow that may pass over nobody is a single hop: through everything, and without it, nothing flows. */
check ThroughEverybodyIsOneHop {
	all source, target: set Enclave |
		(no hops[Channel, everybody, everybody] & source -> target and Outsider not in source.(hops[Channel, everybody,
			everybody]))
			implies separated[source, source, no_channel, target, no_channel, Enclave, Channel, everybody, everybody]
} for 2 but 3 Enclave, 4 Entry, 1 Instant expect 0

/** More to pass over, more channels: never fewer flows. */
check MoreWaysNeverSeparate {
	all inside, source, target: set Enclave + Outsider, through, fewer: set Enclave, usable, less: set Channel |
		(fewer in through and less in usable
			and separated[inside, source, no_channel, target, no_channel, fewer, usable, source, nobody])
			implies separated[inside + (source & through), source, no_channel, target, no_channel,
			                  through, less, source, nobody]
} for 2 but 3 Enclave, 4 Entry, 1 Instant expect 0

/** Encrypted messages, and no unauthenticated participants: the outsider is at no end of any hop. */
check EncryptedMessagesCutTheOutsiderOff {
	(no opaque and DomainRule.rtps_protection_kind in encrypting and no allow_unauthenticated_participants)
		implies no Outsider.(hops[Channel, everybody, everybody]) + hops[Channel, everybody, everybody].Outsider
} for 2 but 3 Enclave, 4 Entry, 1 Instant expect 0

/**
 * All access control on, origins authenticated, payloads encrypted, one key each, all read, and nobody reads or writes
 * but what peers let it: relays do no more than honest.
 */
check AGoodKeystoreMakesEverybodyHonest {
	(no opaque and no one_key and no self_granting + issuing and no allow_unauthenticated_participants
		and no reads_alone + writes_alone
		and TopicRule in enable_read_access_control & enable_write_access_control
		and TopicRule.metadata_protection_kind in authenticating_origin & encrypting
		and TopicRule.data_protection_kind in encrypting and one TrustDomain)
		implies hops[Channel, everybody, everybody] in hops[Channel, nobody, nobody]
} for 2 but 3 Enclave, 1 TrustDomain, 4 Entry, 1 Instant expect 0

/** What an enclave can by its own documents, it can by right. */
check OwnRightsAreRights {
	all trust_domain: TrustDomain {
		writes_by_own[trust_domain] in may_write[trust_domain]
		reads_by_own[trust_domain] in may_read[trust_domain]
	}
} for 3 but 6 Entry, 2 Instant expect 0

-- and each attacker does add something; each route is used

run RelaysReachMoreThanTheSource {
	no opaque and no one_key
	some source: Enclave, inside: set Enclave + Outsider | some target: Enclave - source {
		separated[inside, source, no_channel, target, no_channel, no_enclave, Channel, source, nobody]
		target in source.^(hops[Channel, everybody, everybody])
	}
} for 2 but 3 Enclave, 6 Entry, 3 Certificate, 3 Key, 3 Document, 1 TrustDomain, 1 Instant expect 1

run TheSourceReachesMoreThanTheHonest {
	no opaque and no one_key
	some a, b: Enclave | a -> b in hops[Channel, a, nobody] - hops[Channel, nobody, nobody]
} for 2 but 3 Enclave, 6 Entry, 3 Certificate, 3 Key, 3 Document, 1 TrustDomain, 1 Instant expect 1

run HonestDataFlowsOverTwoHops {
	no opaque
	some disj a, b, c: Enclave {
		a -> b + b -> c in hops[Channel, nobody, nobody]
		a -> c not in hops[Channel, everybody, everybody]
	}
} for 2 but 3 Enclave, 8 Entry, 4 Certificate, 4 Key, 4 Document, 1 TrustDomain, 1 Instant expect 1
