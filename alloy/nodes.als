/**
 * The nodes of a graph, launch file or policy, and their wiring, written by keystore-audit. Do not edit.
 *
 * `runs_in`: the enclave with which a node starts. `publishes_to`, `subscribes_to`: what it is there to do.
 */
module nodes
open keystore

/** A ROS 2 node, by its name. */
abstract sig Node {}
-- /talker: talker_listener.graph.json:4
one sig N0_talker extends Node {}
-- /listener: talker_listener.graph.json:12
one sig N1_listener extends Node {}

fun runs_in: Node -> Enclave {
	N0_talker -> E0_talker
	+ N1_listener -> E1_listener
}
fun publishes_to: Node -> Channel { N0_talker -> T0_chatter }
fun subscribes_to: Node -> Channel { N1_listener -> T0_chatter }
