/**
 * Theorems about any network within a scope. `expect` makes the Analyzer's exit status the verdict.
 */
module routed_theorems
open routed

/** Rules of some subject allow such a message in. */
pred takes_in[process: Process, kinds: set Kind] {
	some process.subject.rule & allow_rule & message.kinds & flow.INGRESS
}

/** Something can come at all: else the theorems would be of nothing. */
run SomethingComes {
	some s: Sending - wide - heard, from, to: Participant - unseen | from -> to in s.told
	some Process & Participant.session - default_allow - unrestricted
} for 3 but 2 Process, 2 Participant, 1 Class, 1 Sending expect 1

/** With default deny, and no rule that allows data in, nothing comes, whoever attacks. */
check WhoDeniesByDefaultGetsNothing {
	all s: Sending - heard, to: Participant |
		(no to & unseen and no View & uncontrolled and no to.session & (unrestricted + default_allow)
			and no p: to.session | takes_in[p, PUT + DELETE + QUERY + REPLY])
		implies no (s.told).to & (Participant - unseen)
} for 2 but 3 Process, 3 Link, 3 Participant, 1 Sending, 1 Class, 2 Expression expect 0

/** An allow rule less, or a rule more that denies, lets nothing more through. */
check LessAllowedIsNoMore {
	all p: Process, few, many: set Rule, kind: Kind, s: Sending |
		few in many implies {
			(many - few in allow_rule and granted[p, few, kind, s, wide]) implies granted[p, many, kind, s, wide]
			(no (many - few) & allow_rule and granted[p, many, kind, s, wide]) implies granted[p, few, kind, s, wide]
		}
} for 3 but 1 Process, 1 Sending, 2 Class expect 0

/** Routers pass nothing on between peers, where no one is a client, or another router. */
check PeersHearNothingThroughARouter {
	(no Reach and no brokering and no unseen and one mode.ROUTER and no mode.CLIENT
		and all link: Link | ROUTER in (link.near + link.far).mode)
	implies all s: Sending, from, to: Participant |
		(from -> to in s.told and to not in outsider) implies ROUTER in (from.session + to.session).mode
} for 2 but 3 Process, 4 Link, 3 Participant, 1 Sending, 1 Class expect 0

/** Whoever has no key hears nothing, where nobody takes a link from it and all are encrypted. */
check TheOutsiderHearsNothingOverEncryptedLinks {
	(no plain and no holder.outsider and no outsider & unseen and no unseen) implies no s: Sending |
		some (s.told).outsider
} for 2 but 3 Process, 3 Participant, 1 Sending, 1 Class expect 0
