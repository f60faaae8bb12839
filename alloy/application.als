/**
 * The application beside its keystore: ROS 2 nodes, how they are wired, and whether they may be.
 *
 * Which node publishes and subscribes to what is a fact of the module `nodes`. keystore-audit writes it from a graph, a
 * launch file or a policy. A graph is what runs, as ROS 2 tools list it; of a policy SROS2 makes permissions. Four
 * questions are kept apart:
 *
 *   wired                      one node publishes what another subscribes to: what is meant to happen
 *   permitted                  the documents of both enclaves, and nothing else, let it happen
 *   wired_but_not_permitted    it is meant and cannot happen: a right is missing
 *   permitted_but_not_wired    it can happen and nobody means it: a right too many, or an attack's way
 *
 * Permitted is what each enclave's own document says (`claims`), since nodes do what their own middleware lets them do.
 * What an attacker could make peers accept does not count.
 */
module application
open claims
open nodes

/** Nodes that run in enclaves of the trust domain. */
fun nodes_of[trust_domain: TrustDomain]: set Node { runs_in.in_trust_domain.trust_domain }

-- endpoints: one node, one channel

/**
 * Channels that nodes are to publish, and their enclave may not: where ROS 2 enforces security, making the writer
 * fails.
 */
fun publishes_without_right[trust_domain: TrustDomain]: Node -> Channel {
	nodes_of[trust_domain] <: publishes_to - runs_in.(writes_by_own[trust_domain])
}

/** Channels that nodes are to subscribe to, and their enclave may not. */
fun subscribes_without_right[trust_domain: TrustDomain]: Node -> Channel {
	nodes_of[trust_domain] <: subscribes_to - runs_in.(reads_by_own[trust_domain])
}

/** Channels that enclaves may write, and none of their nodes is to publish. */
fun unused_to_write[trust_domain: TrustDomain]: Enclave -> Channel {
	in_trust_domain.trust_domain <: writes_by_own[trust_domain] - ~runs_in.publishes_to
}

/** Channels that enclaves may read, and none of their nodes is to subscribe to. */
fun unused_to_read[trust_domain: TrustDomain]: Enclave -> Channel {
	in_trust_domain.trust_domain <: reads_by_own[trust_domain] - ~runs_in.subscribes_to
}

-- flows: from node to node; a pair of trust domains at a time, since each reads the documents of both ends

/** Nodes of `sending` that may publish to those of `receiving`. */
fun may_publish[sending, receiving: TrustDomain]: Node -> Channel {
	nodes_of[sending] <: runs_in.(writes_by_own[sending] & writes_by_own[receiving])
}

/** Nodes of `receiving` that may subscribe to those of `sending`. */
fun may_subscribe[sending, receiving: TrustDomain]: Node -> Channel {
	nodes_of[receiving] <: runs_in.(reads_by_own[receiving] & reads_by_own[sending])
}

/** One node is to tell another something on this channel. */
pred wired[sender, receiver: Node, channel: Channel] {
	sender != receiver
	channel in sender.publishes_to & receiver.subscribes_to
}

/** The documents of both enclaves let it. */
pred permitted[sender, receiver: Node, channel: Channel] {
	sender != receiver
	some sending, receiving: TrustDomain |
		channel in sender.(may_publish[sending, receiving]) & receiver.(may_subscribe[sending, receiving])
}

/** It is meant to happen, and cannot. */
pred wired_but_not_permitted[sender, receiver: Node, channel: Channel] {
	wired[sender, receiver, channel] and not permitted[sender, receiver, channel]
}

/** It can happen, and nobody means it to. */
pred permitted_but_not_wired[sender, receiver: Node, channel: Channel] {
	permitted[sender, receiver, channel] and not wired[sender, receiver, channel]
}

-- information flow over the wiring alone: nodes do what they are there to do, and nobody attacks

/** Whom each node of `sending` tells something, of those of `receiving`. */
fun tells[sending, receiving: TrustDomain]: Node -> Node {
	(publishes_to & may_publish[sending, receiving]).~(subscribes_to & may_subscribe[sending, receiving]) - iden
}

/**
 * What some of `source` know stays within `inside`, as wired: a compartment, as in `information_flow`. Where an honest
 * flow is separated, which may take any channel, so is this; not the other way round.
 */
pred keeps_to_itself[source, inside: set Node] {
	source in inside
	all sending, receiving: TrustDomain | inside.(tells[sending, receiving]) in inside
}

-- what is asserted of every application

/** Every node has an enclave in the keystore. */
assert NodesHaveEnclaves { all node: Node | some node.runs_in }

/** Every node may do what it is there to do. */
assert NodesHaveTheRightsThatTheyNeed {
	all trust_domain: TrustDomain, node: Node, channel: Channel |
		channel not in node.(publishes_without_right[trust_domain] + subscribes_without_right[trust_domain])
}

/** What nodes are to tell each other they can. */
assert WiredFlowsArePermitted {
	all sending, receiving: TrustDomain, sender: nodes_of[sending], receiver: nodes_of[receiving] - sender |
		all channel: sender.publishes_to & receiver.subscribes_to |
			channel in sender.(may_publish[sending, receiving]) & receiver.(may_subscribe[sending, receiving])
}

/** No enclave has a right that none of its nodes uses. */
assert RightsAreUsed {
	all trust_domain: TrustDomain, enclave: Enclave, channel: Channel |
		channel not in enclave.(unused_to_write[trust_domain] + unused_to_read[trust_domain])
}

/** Somebody is there to be wired: two nodes of which one publishes what the other subscribes to. */
pred WiringIsExercised { some (publishes_to.~subscribes_to) - iden }
