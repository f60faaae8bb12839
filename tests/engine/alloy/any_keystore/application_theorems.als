/**
 * Theorems about the wiring of every application of every keystore within a scope.
 *
 * They tie what is wired and permitted to what can flow at all. `expect` makes the Analyzer's exit status the verdict.
 */
module application_theorems
open application

/** Nobody attacks. */
fun nobody: set Enclave + Outsider { none }

/** What one node tells another in another enclave is an honest hop between the two. */
check WhatNodesTellIsAHop {
	all sending, receiving: TrustDomain, sender: Node, receiver: sender.(tells[sending, receiving]) |
		sender.runs_in = receiver.runs_in
		or some channel: Channel | hop[sender.runs_in, channel, receiver.runs_in, nobody, nobody]
} for 2 but 2 Node, 4 Entry, 1 Instant expect 0

/** What nodes tell each other is wired, and permitted. */
check NodesTellWhatIsWiredAndPermitted {
	all sending, receiving: TrustDomain, sender: Node, receiver: sender.(tells[sending, receiving]) |
		some channel: Channel | wired[sender, receiver, channel] and permitted[sender, receiver, channel]
} for 2 but 2 Node, 4 Entry, 1 Instant expect 0

/** What an enclave may do by its own document it may do. */
check OwnRightsAreRights {
	all trust_domain: TrustDomain | writes_by_own[trust_domain] in may_write[trust_domain]
		and reads_by_own[trust_domain] in may_read[trust_domain]
} for 2 but 0 Node, 4 Entry, 1 Instant expect 0

/** Wired and permitted are what either word says, and the two differences are what is left. */
check TheFourQuestionsDiffer {
	all sender, receiver: Node, channel: Channel {
		wired_but_not_permitted[sender, receiver, channel] implies not permitted_but_not_wired[sender, receiver, channel]
		wired[sender, receiver, channel] iff
			(wired_but_not_permitted[sender, receiver, channel]
				or (permitted[sender, receiver, channel] and wired[sender, receiver, channel]))
	}
} for 2 but 2 Node, 4 Entry, 1 Instant expect 0

/** Where every node may do what it needs in every trust domain, nothing that is wired is denied. */
check RightsCarryFlows {
	(one TrustDomain and all node: Node | some node.runs_in
		and node.publishes_to in node.runs_in.(writes_by_own[TrustDomain])
		and node.subscribes_to in node.runs_in.(reads_by_own[TrustDomain]))
			implies no sender, receiver: Node, channel: Channel | wired_but_not_permitted[sender, receiver, channel]
} for 2 but 2 Node, 4 Entry, 1 Instant expect 0

/** None of the four is empty by itself. */
run AFlowIsWiredAndPermitted {
	some sender, receiver: Node, channel: Channel | wired[sender, receiver, channel] and permitted[sender, receiver,
		channel]
} for 2 but 2 Node, 4 Entry, 1 Instant expect 1
run AFlowIsWiredAndNotPermitted {
	some sender, receiver: Node, channel: Channel | wired_but_not_permitted[sender, receiver, channel]
} for 2 but 2 Node, 4 Entry, 1 Instant expect 1
run AFlowIsPermittedAndNotWired {
	some sender, receiver: Node, channel: Channel | permitted_but_not_wired[sender, receiver, channel]
} for 2 but 2 Node, 4 Entry, 1 Instant expect 1
