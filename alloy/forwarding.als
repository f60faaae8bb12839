/**
 * What declared forwards rest on: who hands samples to whom, and where something high can come to.
 *
 * `determinism` speaks of slots and writers. That these are those of the keystore is decided here, again and from its
 * facts alone: who may hand samples to a forward, or put them where they are seen, and which enclaves lie inside of what
 * can be reached from something high, nodes without declared forwards passing on whatever they get. Nobody attacks.
 */
module forwarding
open information_flow

/** Enclaves that hand a sample, put on one of `put`, to `receiver`, who takes those of `got`. */
fun senders[put: set Channel, receiver: Enclave, got: set Channel]: set Enclave {
	{ e: Enclave | some sending, receiving: Realm |
		some put & e.(sends[sending, receiving]) and some got & receiver.(receives[sending, receiving]) }
}

/** Enclaves that put a sample on one of `put` for the members of some realm. */
fun publishers[put: set Channel]: set Enclave {
	{ e: Enclave | some sending, receiving: Realm | some put & e.(sends[sending, receiving]) }
}

/** Channels of what is high, between two realms: those of `first`, what `inside` puts, and what is passed on. */
fun tainted[inside: set Enclave, passed: Enclave -> Channel, first, usable: set Channel,
            sending, receiving: Realm]: set Channel {
	first + usable & inside.(sends[sending, receiving]) + Enclave.(passed & sends[sending, receiving])
}

/** Nothing high comes to anybody outside of `inside` but to nodes that are declared, nor to those of `closed`. */
pred contained[inside, declared: set Enclave, passed, closed: Enclave -> Channel, first, usable: set Channel] {
	all sending, receiving: Realm |
		let taint = tainted[inside, passed, first, usable, sending, receiving] {
			receives[sending, receiving].taint - declared in inside
			no closed & receives[sending, receiving] & Enclave -> taint
		}
}
