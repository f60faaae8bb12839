/**
 * What is meant to happen, and whether it can: a command (to a robot: stop) spreads from enclave to enclave, by
 * right alone.
 *
 * Security that lets nothing through is no use, and a keystore in which the intended flow is impossible passes every
 * check. Here a run shows a scenario, and fairness makes a liveness property of it. What is permitted and wired, and
 * stays so, happens at some time. Where a right is missing, the counterexample is a lasso: the command is never there.
 * Knowledge only grows, so that as many steps as there are enclaves, and one in which nothing is new, are complete.
 */
module scenarios
open propagation

/** What somebody wants to arrive, and who has received it so far. */
one sig Command { var known_to: set Enclave }

/** Nobody attacks in a scenario. */
fun nobody: set Enclave + Outsider { none }

/** Who can receive the command next, on `wired` channels: nodes write and read there, and are permitted to. */
fun offered[wired: set Channel]: set Enclave {
	{ e: Enclave | some sending, receiving: TrustDomain |
		e in next[Command.known_to, wired, nobody, nobody, sending, receiving] }
}

/** The command starts with `source` and reaches whom it is offered to, some at each step or nobody. */
pred spreads[source: set Enclave, wired: set Channel] {
	Command.known_to = source
	always (Command.known_to in Command.known_to' and Command.known_to' in Command.known_to + offered[wired])
}

/** Fairness: whoever is offered the command from some time on receives it at some time. */
pred fair[wired: set Channel] {
	all e: Enclave | (eventually always e in offered[wired]) implies eventually e in Command.known_to
}

/** A scenario: the command can arrive. */
pred can_arrive[source, target: set Enclave, wired: set Channel] {
	spreads[source, wired]
	eventually target in Command.known_to
}

/** Fair delivery: in every fair behaviour, the command arrives. */
pred arrives_fairly[source, target: set Enclave, wired: set Channel] {
	(spreads[source, wired] and fair[wired]) implies eventually target in Command.known_to
}
