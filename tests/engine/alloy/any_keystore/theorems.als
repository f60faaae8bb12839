/**
 * Theorems about every keystore within a scope, and for every property a keystore in which it fails.
 *
 * Tests of the model itself: a theorem with a counterexample, or a property that cannot fail, is a mistake in it.
 * `expect` makes the Analyzer's exit status the verdict. Bounded, so evidence and no proof.
 */
module theorems
open vacuity

-- well-defined: "first" is one

/**
 * At most one rule of a trust domain decides about a domain or a channel, and one grant of a document about a
 * certificate.
 */
check DecisionsAreUnique {
	all trust_domain: TrustDomain - open_trust_domain, domain: Domain | lone trust_domain.applied.domain_rule
		& deciding_domain_rule.domain
	all trust_domain: TrustDomain - open_trust_domain, channel: Channel |
		lone trust_domain.applied.domain_rule.topic_rule & deciding_topic_rule.channel
	all document: Document, certificate: Certificate | lone document.grant & chosen.certificate
} for 3 but 6 Entry, 2 Instant expect 0

/** What an earlier sibling decides, no later one does: its criteria there are dead. */
check EarlierRuleWins {
	all grant: Grant, channel: Channel, disj first, second: grant.rule |
		(second in first.^precedes and channel in first.(matching[publish]) and first not in allow_rule
			and all other: grant.rule - first | other in first.^precedes)
		implies channel not in grant.publish_allowed
} for 3 but 6 Entry, 2 Instant expect 0

/** Where no rule matches, the default decides. */
check DefaultDecidesTheRest {
	all grant: Grant, channel: Channel | channel not in grant.rule.(matching[subscribe])
		implies (channel in grant.subscribe_allowed iff grant in default_allow)
} for 3 but 6 Entry, 2 Instant expect 0

-- documents

/** No enclave's identity has the key of a permissions CA. */
pred authorities_keep_their_keys { no Enclave.identity.public_key & TrustDomain.permissions_ca.public_key }

/** Whatever a permissions CA fit to sign signed is obeyed; where it is pinned and all was read, nothing else is. */
check PinnedTrustDomainsObeyTheirAuthorityOnly {
	pins_signer <: genuine in accepted
	TrustDomain.permissions_ca in fit_to_sign implies genuine in accepted
	no opaque implies pins_signer <: accepted in genuine
	(no opaque and authorities_keep_their_keys) implies no pins_signer.self_granting
} for 3 but 6 Entry, 2 Instant expect 0

/** No enclave signs for itself where a permissions CA certified no key but its own, and no enclave has that one. */
check SplitAuthoritiesStopSelfGrants {
	(no opaque and authorities_keep_their_keys
		and all trust_domain: TrustDomain |
			(^issuer).(trust_domain.permissions_ca).public_key in trust_domain.permissions_ca.public_key)
		implies no self_granting
} for 3 but 6 Entry, 2 Instant expect 0

-- authentication

/** Without an authority that vouches, nobody is authentic. */
check NoAuthorityNobodyAuthentic {
	(no opaque and no TrustDomain.identity_ca & authority) implies no authentic
} for 3 but 6 Entry, 2 Instant expect 0

/** Dates only take away: who is authentic in force is authentic. */
check DatesOnlyTakeAway { introduced_in_force in authentic } for 3 but 6 Entry, 2 Instant expect 0

/** Whom a trust domain has revoked, it shuns. */
check TheRevokedAreShunned {
	no opaque implies all trust_domain: TrustDomain | no trust_domain.authentic & identity.(trust_domain.revoked)
} for 3 but 6 Entry, 2 Instant expect 0

-- access control and keys

/** What a CA fit to sign granted can be presented. */
check GrantsCanBePresented {
	TrustDomain.permissions_ca in fit_to_sign implies all trust_domain: TrustDomain | granted[trust_domain,
		publish_allowed] in presentable[trust_domain, publish_allowed]
} for 3 but 6 Entry, 2 Instant expect 0

/** All access control on, the signer pinned, all documents read: nobody does more than the CA granted. */
check AccessControlConfines {
	(no opaque and authorities_keep_their_keys and no issuing and TrustDomain in pins_signer
		and TopicRule in enable_read_access_control & enable_write_access_control)
		implies all trust_domain: TrustDomain {
			may_write[trust_domain] in granted[trust_domain, publish_allowed]
			may_read[trust_domain] in granted[trust_domain, subscribe_allowed]
		}
} for 3 but 6 Entry, 2 Instant expect 0

/** Nobody has power without having joined, nor where nothing is governed. */
check PowerNeedsMembership {
	all trust_domain: TrustDomain |
		may_write[trust_domain] + may_read[trust_domain] + relays[trust_domain] + overhears[trust_domain]
			+ forges[trust_domain] in within_reach[trust_domain]
	all trust_domain: TrustDomain | within_reach[trust_domain] in Enclave -> trust_domain.governed
	all trust_domain: TrustDomain | out_of_reach[trust_domain] = Enclave -> Channel - within_reach[trust_domain]
	all trust_domain: TrustDomain - open_trust_domain | joins[trust_domain].Domain in trust_domain.(authentic + issuing)
} for 3 but 6 Entry, 2 Instant expect 0

/** Origin authentication on all submessages leaves no forger. */
check OriginAuthenticationStopsForgery {
	(no opaque and TopicRule.metadata_protection_kind in authenticating_origin) implies no trust_domain: TrustDomain |
		some forges[trust_domain]
} for 3 but 6 Entry, 2 Instant expect 0

/** Without it, whoever may read can forge. */
check ReadersHoldTheKeys {
	all trust_domain: TrustDomain | may_read[trust_domain] :> (Channel
		- trust_domain.(message_protection[authenticating_origin] + submessage_protection[authenticating_origin]))
		in forges[trust_domain]
} for 3 but 6 Entry, 2 Instant expect 0

-- outsiders

/** Encrypted messages keep every outsider out, who can only send where the unauthenticated are let in. */
check EncryptedMessagesExcludeOutsiders {
	(no opaque and DomainRule.rtps_protection_kind in encrypting)
		implies no readable_outside + announced_outside + (injectable_outside - unauthenticated_allowed.~in_domain)
} for 3 but 6 Entry, 2 Instant expect 0

/** An unreadable governance document protects nothing. */
check UnreadableGovernanceProtectsNothing {
	some Enclave implies open_trust_domain -> Channel in readable_outside & announced_outside & injectable_outside
} for 3 but 6 Entry, 2 Instant expect 0

/** What anybody can inject, anybody can read, if anybody writes it, save where the unauthenticated are let in. */
check InjectableIsReadable {
	injectable_outside & written in readable_outside + unauthenticated_allowed.~in_domain
} for 3 but 6 Entry, 2 Instant expect 0

/** Whatever can be injected can be replayed too; what can be replayed only has a protected payload. */
check InjectableIsReplayable {
	injectable_outside in replayable_outside
	replayable_outside - injectable_outside in payload_protection[ProtectionKind - NONE]
} for 3 but 6 Entry, 2 Instant expect 0

/** A relay that reads has no grant to read: relays are among those who read without a grant. */
check RelaysThatReadAreReadersWithoutAGrant {
	all trust_domain: TrustDomain | read_by_relays[trust_domain] in reads_without_a_grant[trust_domain]
} for 3 but 6 Entry, 2 Instant expect 0

/** Nothing is carried across domains in a keystore that has one. */
check OneDomainHasNoBridge {
	one Domain implies all sending, receiving: TrustDomain | no carried_across[sending, receiving]
} for 3 but 6 Entry, 2 Instant expect 0

/** What an enclave can carry across, it can put somewhere, as whomever: the two ends of a bridge exist together. */
check BridgesHaveTwoEnds {
	all sending, receiving: TrustDomain, enclave: Enclave, channel: enclave.(carried_across[sending, receiving]) |
		some other_channel: enclave.acts_as.(feeds[receiving]) | channel.in_domain != other_channel.in_domain
} for 3 but 6 Entry, 2 Instant expect 0

-- every property can fail, and not only for what could not be read

check OnlyAuthenticatedParticipantsJoin { OnlyAuthenticatedParticipantsJoin } for 2 expect 1
check IdentitiesChainToTheIdentityCa { IdentitiesChainToTheIdentityCa } for 2 expect 1
check DocumentsSignedByThePermissionsCa { DocumentsSignedByThePermissionsCa } for 2 expect 1
check NoIdentityServesTwoEnclaves { NoIdentityServesTwoEnclaves } for 2 expect 1
check NoEnclaveGrantsItselfRights { NoEnclaveGrantsItselfRights } for 2 expect 1
check OutsidersCannotRead { OutsidersCannotRead } for 2 expect 1
check OutsidersCannotLearnNames { OutsidersCannotLearnNames } for 2 expect 1
check OutsidersCannotInject { OutsidersCannotInject } for 2 expect 1
check GrantsAreEnforced { GrantsAreEnforced } for 2 expect 1
check NobodyWritesWithoutAGrant { NobodyWritesWithoutAGrant } for 2 expect 1
check NobodyReadsWithoutAGrant { NobodyReadsWithoutAGrant } for 2 expect 1
check ReadersCannotForge { ReadersCannotForge } for 3 but 6 Entry expect 1
check OneCaForOneRole { OneCaForOneRole } for 2 expect 1
check NoSubjectServesTwoEnclaves { NoSubjectServesTwoEnclaves } for 2 expect 1
check OutsidersCannotReplay { OutsidersCannotReplay } for 2 expect 1
check OutsidersCannotForgeLiveliness { OutsidersCannotForgeLiveliness } for 2 expect 1
check RelaysCannotRead { RelaysCannotRead } for 3 but 6 Entry expect 1
check NoEnclaveBridgesDomains { NoEnclaveBridgesDomains } for 3 but 6 Entry expect 1

/** The same failures where everything was read. */
run EachFailsInTheOpen {
	no opaque
	some unauthenticated_allowed
	some one_key
	some self_granting
	some injectable_outside & readable_outside & announced_outside
	some unenforced
	some trust_domain: TrustDomain | some writes_without_a_grant[trust_domain] and some reads_without_a_grant[trust_domain]
	some replayable_outside - injectable_outside
	some liveliness_forgeable_outside
} for 3 but 6 Entry expect 1

/** The others of them, where everything was read. */
run TheOthersFailInTheOpen {
	no opaque
	some one_subject
	some identity_ca.public_key & permissions_ca.public_key
	some trust_domain: TrustDomain | some read_by_relays[trust_domain] and some carried_across[trust_domain, trust_domain]
} for 3 but 7 Entry expect 1

/** A reader can forge, in a keystore whose only fault that is. */
run OnlyReadersForge {
	no opaque and no self_granting and no unenforced and no one_key
	some trust_domain: TrustDomain | some forged_by_readers[trust_domain] and no writes_without_a_grant[trust_domain]
} for 3 but 6 Entry expect 1

-- and all of them hold at once, in a keystore that is used

/** A writer and a reader of one channel, with everything in order. */
run Exemplary {
	AuthenticationIsExercised and EncryptionIsExercised and AccessControlIsExercised
	some trust_domain: TrustDomain, disj talker, listener: Enclave, channel: Channel {
		channel in talker.(may_write[trust_domain] & granted[trust_domain, publish_allowed])
		channel in listener.(may_read[trust_domain] & granted[trust_domain, subscribe_allowed])
	}
	no opaque and no unauthenticated_allowed and no one_key and no self_granting and no unenforced
	all enclave: Enclave {
		one enclave.identity and enclave in enclave.in_trust_domain.introduced_in_force
		one enclave.permissions and one enclave.in_trust_domain.governance
		enclave.permissions + enclave.in_trust_domain.governance in enclave.in_trust_domain.genuine
	}
	signer[Document] in in_force
	no readable_outside + announced_outside + injectable_outside
	no trust_domain: TrustDomain | some writes_without_a_grant[trust_domain] + reads_without_a_grant[trust_domain]
		+ forged_by_readers[trust_domain]
} for 3 but 4 Certificate, 4 Document, 6 Entry expect 1
