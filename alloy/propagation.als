/**
 * How data goes where it must not: one datum on its way, hop by hop.
 *
 * This module has variable fields, which makes every command below it temporal. So it stands outside of the audit
 * and is asked only about claims that are violated, for a path to report. An instance is a trace, and the Analyzer
 * tries short traces first: the first that it finds is a shortest path. The bound is complete, since a shortest path
 * visits nobody twice. As many states as there are participants are enough, and one more in which the datum rests.
 */
module propagation
open claims

/**
 * What travels: who has it, and over which channel it came (none at the beginning, unless the beginning is a channel).
 * `out`: the channel on which it is put at last, where the end is a channel.
 */
one sig Datum {
	var holder: one Enclave + Outsider,
	var over: lone Channel,
	out: lone Channel
}

/** At the beginning somebody of `source` has the datum, or somebody got it as a sample of `first`. */
pred begins[source: set Enclave + Outsider, first: set Channel, eavesdroppers: set Enclave + Outsider] {
	(Datum.holder in source and no Datum.over)
	or (some trust_domain: TrustDomain | Datum.holder in getters[Datum.over & first, eavesdroppers, trust_domain])
}

/** The datum goes over one hop to somebody else. */
pred passes[usable: set Channel, forgers, eavesdroppers: set Enclave + Outsider] {
	Datum.holder' != Datum.holder
	some Datum.over'
	some sending, receiving: TrustDomain |
		Datum.holder' in next[Datum.holder, Datum.over' & usable, forgers, eavesdroppers, sending, receiving]
}

/** Nothing happens. */
pred rests { holder' = holder and over' = over }

/** Those who may pass it on have it: nobody of `through`, except where the flow begins. */
pred goes_on[source: set Enclave + Outsider, through: set Enclave] {
	Datum.holder in through implies (no Datum.over and Datum.holder in source)
}

/** The datum is at the end: it came to somebody of `target`, or who has it can put it on `last`. */
pred arrives[source, target: set Enclave + Outsider, last: set Channel, through: set Enclave,
             forgers, eavesdroppers: set Enclave + Outsider] {
	(no Datum.out and some Datum.over and Datum.holder in target)
	or (goes_on[source, through]
		and some trust_domain: TrustDomain | Datum.holder in putters[Datum.out & last, forgers, eavesdroppers, trust_domain])
}

/** A walk of the datum from one place to another, with the places and powers of `separated`: a flow. */
pred walk[source: set Enclave + Outsider, first: set Channel, target: set Enclave + Outsider, last: set Channel,
          through: set Enclave, usable: set Channel, forgers, eavesdroppers: set Enclave + Outsider] {
	begins[source, first, eavesdroppers]
	always (rests or (goes_on[source, through] and passes[usable, forgers, eavesdroppers]))
	eventually arrives[source, target, last, through, forgers, eavesdroppers]
}
