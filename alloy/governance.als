/**
 * How a trust domain protects its domains and channels (DDS-Security 1.1, 9.4.1.2).
 *
 * The first domain rule that covers a domain decides about it, and of that rule the first topic rule that matches a
 * topic. Where none does, endpoints cannot be created: such channels are not governed, and nothing happens there.
 *
 * A trust domain whose governance could not be read is an *open* one (`open_trust_domain`). It governs everything,
 * controls nobody and protects nothing: that is the worst that the document can say.
 */
module governance
open documents

/** The governance document that a trust domain obeys, if it does obey it and we could read it. */
fun applied: TrustDomain -> Document { governance & accepted & (TrustDomain - open_trust_domain) -> Document }

/** Where a domain rule decides: no sibling before it covers the domain. */
fun deciding_domain_rule: DomainRule -> Domain {
	let covers = domains & DomainRule -> Domain | covers - preceded_by.covers
}

/** Where a topic rule decides: its domain rule does, it matches, and no sibling before it does. */
fun deciding_topic_rule: TopicRule -> Channel {
	let matches = topic_expression & ~topic_rule.deciding_domain_rule.~in_domain |
		matches - preceded_by.matches
}

/** Domains that one of `rules` decides, in each trust domain. */
fun domains_under[rules: set DomainRule]: TrustDomain -> Domain {
	applied.domain_rule.(deciding_domain_rule & rules -> Domain)
}

/** Channels of domains that one of `rules` decides, in each trust domain. */
fun channels_within[rules: set DomainRule]: TrustDomain -> Channel { domains_under[rules].~in_domain }

/** Channels that one of `rules` decides, in each trust domain. */
fun channels_under[rules: set TopicRule]: TrustDomain -> Channel {
	applied.domain_rule.topic_rule.(deciding_topic_rule & rules -> Channel)
}

/** Domains that have a domain rule; an open trust domain governs all. */
fun governed_domain: TrustDomain -> Domain { domains_under[DomainRule] + open_trust_domain -> Domain }

/** Channels that have a topic rule; an open trust domain governs all. */
fun governed: TrustDomain -> Channel { channels_under[TopicRule] + open_trust_domain -> Channel }

/** Domains that participants without an identity may join. */
fun unauthenticated_allowed: TrustDomain -> Domain {
	domains_under[allow_unauthenticated_participants] + open_trust_domain -> Domain
}

/** Domains that every authenticated participant may join, with or without a grant. */
fun join_uncontrolled: TrustDomain -> Domain {
	domains_under[DomainRule - enable_join_access_control] + open_trust_domain -> Domain
}

/** Channels that every participant of the domain may read, with or without a grant. */
fun read_uncontrolled: TrustDomain -> Channel {
	channels_under[TopicRule - enable_read_access_control] + open_trust_domain -> Channel
}

/** Channels that every participant of the domain may write, with or without a grant. */
fun write_uncontrolled: TrustDomain -> Channel {
	channels_under[TopicRule - enable_write_access_control] + open_trust_domain -> Channel
}

/** Kinds under which bytes cannot be read without the key. */
fun encrypting: set ProtectionKind { ENCRYPT + ENCRYPT_WITH_ORIGIN_AUTHENTICATION }

/** Kinds under which a receiver tells the sender from the other holders of the key (9.5.3.3). */
fun authenticating_origin: set ProtectionKind {
	SIGN_WITH_ORIGIN_AUTHENTICATION + ENCRYPT_WITH_ORIGIN_AUTHENTICATION
}

/**
 * What open trust domains add to the channels of which a protection is one of `kinds`: there every protection is NONE.
 */
fun unprotected[kinds: set ProtectionKind]: TrustDomain -> Channel {
	NONE in kinds implies open_trust_domain -> Channel else none -> none
}

/** Channels in whose domain whole messages are protected by one of `kinds`. */
fun message_protection[kinds: set ProtectionKind]: TrustDomain -> Channel {
	channels_within[rtps_protection_kind.kinds] + unprotected[kinds]
}

/** Channels whose submessages are protected by one of `kinds`. */
fun submessage_protection[kinds: set ProtectionKind]: TrustDomain -> Channel {
	channels_under[metadata_protection_kind.kinds] + unprotected[kinds]
}

/** Channels whose payloads are protected by one of `kinds`. */
fun payload_protection[kinds: set ProtectionKind]: TrustDomain -> Channel {
	channels_under[data_protection_kind.kinds] + unprotected[kinds]
}

/** Channels whose endpoints are announced encrypted in discovery: the topic rule wants it, the domain rule says how. */
fun discovery_encrypted: TrustDomain -> Channel {
	channels_under[enable_discovery_protection] & channels_within[discovery_protection_kind.encrypting]
}

/** Channels of which members of the domain alone can say that a writer lives: here too both rules have a part. */
fun liveliness_authenticated: TrustDomain -> Channel {
	channels_under[enable_liveliness_protection]
	& channels_within[liveliness_protection_kind.(ProtectionKind - NONE)]
}
