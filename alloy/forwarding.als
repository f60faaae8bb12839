/**
 * What declared forwards rest on: who hands samples to whom, and where something high can come to.
 *
 * `determinism` (read it first) speaks of forwards, slots and inputs, without rights or documents. Here the keystore's
 * facts alone decide again whether these are right: who may hand samples to a forward, or put them where they are seen.
 * They also decide how far what is high can come, if enclaves without forwards pass on whatever they get. Nobody
 * attacks. The sets that keystore-audit used stand in the main file that it writes, with one check that they are right.
 */
module forwarding
open information_flow

/** Enclaves that hand a sample, put on one of `put`, to `receiver`, who takes those of `got`. */
fun senders[put: set Channel, receiver: Enclave, got: set Channel]: set Enclave {
	{ e: Enclave | some sending, receiving: TrustDomain |
		some put & e.(sends[sending, receiving]) and some got & receiver.(receives[sending, receiving]) }
}

/** Enclaves that put a sample on one of `put` for the members of some trust domain. */
fun publishers[put: set Channel]: set Enclave {
	{ e: Enclave | some sending, receiving: TrustDomain | some put & e.(sends[sending, receiving]) }
}

/**
 * Channels that may carry what is high, from one trust domain to another. Those of `first` are high themselves. On
 * others somebody of `inside` puts a sample, or forwards that something high reaches pass it on (`passed`).
 */
fun tainted[inside: set Enclave, passed: Enclave -> Channel, first, usable: set Channel,
            sending, receiving: TrustDomain]: set Channel {
	first + usable & inside.(sends[sending, receiving]) + Enclave.(passed & sends[sending, receiving])
}

/**
 * What is high stays where it is said to be. Whoever gets it is `inside`, or one of the enclaves that have forwards
 * (`declared`) and pass on only what these say. What the other forwards take in (`closed`) is not high.
 */
pred contained[inside, declared: set Enclave, passed, closed: Enclave -> Channel, first, usable: set Channel] {
	all sending, receiving: TrustDomain |
		let taint = tainted[inside, passed, first, usable, sending, receiving] {
			receives[sending, receiving].taint - declared in inside
			no closed & receives[sending, receiving] & Enclave -> taint
		}
}
