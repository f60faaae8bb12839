/**
 * Any keystore at all: the names of the generated module `keystore`, as free relations.
 *
 * Put in its place, it turns a check into a theorem about every keystore within the scope, and a `run` into a test
 * that a situation is possible. The facts say what is well-formed, and no more.
 */
module keystore
open dds_security

sig AnyInstant extends Instant { following: lone Instant }
one sig Now in Instant {}

sig AnyKey extends Key {}

sig AnyCertificate extends Certificate {
	issuer: set Certificate,
	public_key: one Key,
	begins, ends: one Instant
}
sig authority, fit_to_sign, unread in Certificate {}

sig AnyDocument extends Document { signer: set Certificate }
sig intact, unreadable in Document {}

sig AnyTrustDomain extends TrustDomain {
	identity_ca, permissions_ca, revoked, refuses: set Certificate,
	governance: lone Document,
	refuses_trust_domain: set TrustDomain,
	reading: set Document
}
sig pins_signer, requires_grant in TrustDomain {}

sig AnyEnclave extends Enclave {
	in_trust_domain: one TrustDomain,
	identity: lone Certificate,
	permissions: set Document,
	reads_alone, writes_alone: set Channel,
	refused_writes, refused_reads: set Channel
}
sig anonymous in Enclave {}

/** Where facts are free, unmanaged identities are told apart by nothing but their sig: the theorems are of enclaves. */
fact NobodyIsUnmanaged { no Unmanaged }

sig AnyDomain extends Domain {}

sig AnyChannel extends Channel { in_domain: one Domain, meets: set Channel }

sig AnyDomainRule extends DomainRule {
	governs: one Document,
	covers: set Domain,
	discovery_protection_kind, liveliness_protection_kind, rtps_protection_kind: one ProtectionKind
}
sig allow_unauthenticated_participants, enable_join_access_control in DomainRule {}

sig AnyTopicRule extends TopicRule {
	within: one DomainRule,
	topic_expression: set Channel,
	metadata_protection_kind: one ProtectionKind,
	data_protection_kind: one NONE + SIGN + ENCRYPT
}
sig enable_discovery_protection, enable_liveliness_protection in TopicRule {}
sig enable_read_access_control, enable_write_access_control in TopicRule {}

sig AnyGrant extends Grant {
	belongs: one Document,
	subject_name: set Certificate,
	from, to: one Instant
}
sig default_allow, skipped_out_of_date, joins_out_of_date in Grant {}

sig AnyRule extends Rule {
	of: one Grant,
	reaches: set Domain,
	publish, subscribe, relay: set Channel
}
sig allow_rule in Rule {}

-- the names that the generated module has and fields cannot have, since they range over two sigs or start elsewhere

fun audit_instant: Instant { Now }
fun not_before: (Certificate + Grant) -> Instant { begins + from }
fun not_after: (Certificate + Grant) -> Instant { ends + to }
fun assumed: set Assumption { Assumption }
fun asks_announced_only: set TrustDomain { none }
fun opaque: set Document + Enclave + Certificate { unreadable + anonymous + unread }
fun domain_rule: Document -> DomainRule { ~governs }
fun topic_rule: DomainRule -> TopicRule { ~within }
fun grant: Document -> Grant { ~belongs }
fun rule: Grant -> Rule { ~of }
fun domains: (DomainRule + Rule) -> Domain { covers + reaches }

/** The next sibling of an entry. */
one sig Order { next: Entry -> Entry }
fun precedes: Entry -> Entry { Order.next }

/** Entries of one sort with one parent. */
fun siblings: Entry -> Entry {
	governs.~governs + within.~within + belongs.~belongs + of.~of
}

/** Instants are in line. */
fact TimeIsLinear {
	no iden & ^following
	all disj earlier, later: Instant | later in earlier.(^following + ^(~following))
}

/** Channels that are met are of the same domain and topic: another partition is all that tells them apart. */
fact OnlyPartitionsMeet {
	meets in in_domain.~in_domain
	all rule: TopicRule | rule.topic_expression.(meets + ~meets) in rule.topic_expression
}

/** Siblings are in line, and nothing else is. */
fact SiblingsAreOrdered {
	precedes in siblings
	no iden & ^precedes
	all entry: Entry | lone entry.precedes and lone precedes.entry
	siblings - iden in ^precedes + ^(~precedes)
}
