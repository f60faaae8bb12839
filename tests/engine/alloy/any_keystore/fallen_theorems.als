/**
 * Theorems about who may fall, in every keystore within a scope: what is asked of all chains of hops at once is what
 * compartments decide, and more attackers never take anything away. `expect` makes the Analyzer's exit status the
 * verdict.
 */
module fallen_theorems
open fallen

/** The closure follows the hops that flows are defined by. */
check HopsAreHops {
	all usable: set Channel, forgers, eavesdroppers: set Enclave + Outsider |
		hops[usable, forgers, eavesdroppers]
			= { a, b: Enclave + Outsider | some c: usable | hop[a, c, b, forgers, eavesdroppers] }
} for 2 but 2 Enclave, 1 TrustDomain, 3 Entry, 1 Instant, 2 Key, 2 Certificate expect 0

/** Where there is a compartment there is no flow. */
check CompartmentsHaveNoFlow {
	all inside, source, target: set Enclave + Outsider, first, last, usable: set Channel, through, fallen: set Enclave |
		separated[inside, source, first, target, last, through, usable, fallen, fallen + Outsider]
			implies not flows[source, first, target, last, through, usable, fallen, fallen + Outsider]
} for 2 but 2 Enclave, 1 TrustDomain, 3 Entry, 1 Instant, 2 Key, 2 Certificate expect 0

/** Where there is no flow, what is reached is a compartment. */
check WithoutAFlowThereIsACompartment {
	all source, target: set Enclave + Outsider, first, last, usable: set Channel, through, fallen: set Enclave |
		let got = { each: Enclave + Outsider | gets[each, first, fallen + Outsider] },
			begun = source + (got - through),
			hop = hops[usable, fallen, fallen + Outsider],
			come = begun.hop.*((Enclave + Outsider - through) <: hop) |
			not flows[source, first, target, last, through, usable, fallen, fallen + Outsider]
				implies separated[begun + (come - through), source, first, target, last, through, usable,
				                  fallen, fallen + Outsider]
} for 2 but 2 Enclave, 1 TrustDomain, 3 Entry, 1 Instant, 2 Key, 2 Certificate expect 0

/** More attackers never take a flow away. */
check MoreOnlyAdd {
	all few, many: set Enclave, source, target: set Enclave + Outsider, first, last, usable: set Channel,
			through: set Enclave |
		few in many and flows[source, first, target, last, through, usable, few, few + Outsider]
			implies flows[source, first, target, last, through, usable, many, many + Outsider]
} for 2 but 2 Enclave, 1 TrustDomain, 3 Entry, 1 Instant, 2 Key, 2 Certificate expect 0
