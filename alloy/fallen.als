/**
 * How many may fall: whether something gets through if some enclaves are compromised, whichever they are.
 *
 * That every set of enclaves has a compartment is beyond first-order logic, so the question is whether some set has a
 * flow. Chains of hops are not followed step by step, as in `propagation`, since who makes them possible is free here.
 * All of them are there at once, as the closure of one relation. It costs the cube of the number of participants.
 */
module fallen
open claims

/** Who hands a sample of a usable channel to whom, from one trust domain to another: `next`, from each participant. */
fun handed[sending, receiving: TrustDomain, usable: set Channel, forgers, eavesdroppers: set Enclave
	+ Outsider]: (Enclave + Outsider) -> (Enclave + Outsider) {
	sends[sending, receiving].(usable <: ~(receives[sending, receiving]))
		+ imposes[forgers, receiving].(usable <: ~(is_told[eavesdroppers, receiving]))
		+ exposes[forgers, sending].(usable <: ~(intercepts[eavesdroppers, sending]))
}

/** The same from all trust domains to all; what somebody hands itself is no hop. */
fun hops[usable: set Channel, forgers, eavesdroppers: set Enclave + Outsider]: (Enclave + Outsider) -> (Enclave
	+ Outsider) {
	{ from, to: Enclave + Outsider | some sending, receiving: TrustDomain |
		from->to in handed[sending, receiving, usable, forgers, eavesdroppers] } - iden
}

/**
 * A flow over hops (`hops`) from one place to another, with the places and powers of `separated`. `got`: who gets a
 * sample of `first`; `come`: to whom something comes over hops, of which nobody of `through` passes anything on.
 */
pred flows_over[hop: (Enclave + Outsider) -> (Enclave + Outsider), source: set Enclave + Outsider, first: set Channel,
                target: set Enclave + Outsider, last: set Channel, through: set Enclave, usable: set Channel,
                forgers, eavesdroppers: set Enclave + Outsider] {
	let got = { each: Enclave + Outsider | gets[each, first, eavesdroppers] },
		come = (source + (got - through)).hop.*((Enclave + Outsider - through) <: hop) |
		some (got + come) & target
		or some each: source + (got + come - through) | puts[each, last, forgers, eavesdroppers]
}

/** The same, over all hops that there are. */
pred flows[source: set Enclave + Outsider, first: set Channel, target: set Enclave + Outsider, last: set Channel,
           through: set Enclave, usable: set Channel, forgers, eavesdroppers: set Enclave + Outsider] {
	flows_over[hops[usable, forgers, eavesdroppers], source, first, target, last, through, usable, forgers,
		eavesdroppers]
}
