/**
 * The facts of one keystore, written by keystore-audit. Do not edit.
 *
 * As read by spec.
 * What could not be read is left out. The audit instant is 2021-12-31T00:00:00Z.
 * Above each atom is what it is in the keystore, and where. `dds_security` says what functions mean.
 * A channel has one of its names, and stands for all names that no document tells apart from it.
 * ROS 2 topics begin with `rt/`; a service is two topics, which begin with `rq/` and `rr/`. `DDS only` means
 * that no ROS 2 name is in this channel.
 */
module keystore
open dds_security

-- domains 0
one sig D0 extends Domain {}

-- rt/chatter: no partition, domains 0 to 0, a ROS name
one sig T0_chatter extends Channel {}
-- any: no partition, domains 0 to 0, DDS only
one sig T1_any extends Channel {}

-- 2020-01-01T00:00:00+00:00
one sig I0 extends Instant {}
-- 2020-12-31T00:00:00+00:00
one sig I1 extends Instant {}
-- 2021-12-31T00:00:00+00:00
one sig I2 extends Instant {}
-- 2022-12-31T00:00:00+00:00
one sig I3 extends Instant {}
-- 2023-12-31T00:00:00+00:00
one sig I4 extends Instant {}

-- key 0
one sig K0 extends Key {}
-- key 1
one sig K1 extends Key {}
-- key 100
one sig K2 extends Key {}

-- CN=sros2CA: public/ca.cert.pem
one sig C0_CN_sros2CA extends Certificate {}
-- CN=/talker: enclaves/talker/cert.pem
one sig C1_talker extends Certificate {}
-- CN=/listener: enclaves/listener/cert.pem
one sig C2_listener extends Certificate {}

-- enclaves/governance.p7s
one sig P0_governance_p7s extends Document {}
-- enclaves/talker/permissions.p7s
one sig P1_permissions_p7s extends Document {}
-- enclaves/listener/permissions.p7s
one sig P2_permissions_p7s extends Document {}

-- what is trusted by /talker, /listener
one sig R0 extends TrustDomain {}

-- /talker: enclaves/talker
one sig E0_talker extends Enclave {}
-- /listener: enclaves/listener
one sig E1_listener extends Enclave {}

-- enclaves/governance.p7s:6
one sig DR0 extends DomainRule {}

-- enclaves/governance.p7s:20
one sig TR0 extends TopicRule {}

-- enclaves/talker/permissions.p7s:6
one sig G0 extends Grant {}
-- enclaves/listener/permissions.p7s:6
one sig G1 extends Grant {}

-- enclaves/talker/permissions.p7s:13
one sig PR0 extends Rule {}
-- enclaves/listener/permissions.p7s:13
one sig PR1 extends Rule {}

-- channels
fun in_domain: Channel -> Domain { Channel -> D0 }
fun meets: Channel -> Channel { none -> none }

-- certificates
fun issuer: Certificate -> Certificate { Certificate -> C0_CN_sros2CA }
fun authority: set Certificate { C0_CN_sros2CA }
fun fit_to_sign: set Certificate { Certificate }
fun public_key: Certificate -> Key {
	C0_CN_sros2CA -> K2
	+ C1_talker -> K0
	+ C2_listener -> K1
}
fun following: Instant -> Instant {
	I0 -> I1
	+ I1 -> I2
	+ I2 -> I3
	+ I3 -> I4
}
fun audit_instant: one Instant { I2 }
fun not_before: (Certificate + Grant) -> Instant {
	Certificate -> I0
	+ Grant -> I0
}
fun not_after: (Certificate + Grant) -> Instant {
	Certificate -> I4
	+ Grant -> I4
}

-- documents
fun signer: Document -> Certificate { Document -> C0_CN_sros2CA }
fun intact: set Document { Document }
fun opaque: set Document + Enclave + Certificate { none }
fun assumed: set Assumption { Assumption }
fun asks_announced_only: set TrustDomain { none }
fun pins_signer: set TrustDomain { TrustDomain }
fun requires_grant: set TrustDomain { none }

-- trust domains
fun identity_ca: TrustDomain -> Certificate { R0 -> C0_CN_sros2CA }
fun permissions_ca: TrustDomain -> Certificate { R0 -> C0_CN_sros2CA }
fun governance: TrustDomain -> Document { R0 -> P0_governance_p7s }
fun revoked: TrustDomain -> Certificate { none -> none }
fun refuses: TrustDomain -> Certificate { none -> none }
fun refuses_trust_domain: TrustDomain -> TrustDomain { none -> none }
fun reading: TrustDomain -> Document { R0 -> Document }

-- enclaves
fun in_trust_domain: Enclave -> TrustDomain { Enclave -> R0 }
fun identity: Enclave -> Certificate {
	E0_talker -> C1_talker
	+ E1_listener -> C2_listener
}
fun permissions: Enclave -> Document {
	E0_talker -> P1_permissions_p7s
	+ E1_listener -> P2_permissions_p7s
}
fun reads_alone: Enclave -> Channel { none -> none }
fun writes_alone: Enclave -> Channel { none -> none }
fun refused_writes: Enclave -> Channel { none -> none }
fun refused_reads: Enclave -> Channel { none -> none }

-- domain rules
fun domain_rule: Document -> DomainRule { P0_governance_p7s -> DR0 }
fun allow_unauthenticated_participants: set DomainRule { none }
fun enable_join_access_control: set DomainRule { DR0 }
fun discovery_protection_kind: DomainRule -> ProtectionKind { DR0 -> ENCRYPT }
fun liveliness_protection_kind: DomainRule -> ProtectionKind { DR0 -> ENCRYPT }
fun rtps_protection_kind: DomainRule -> ProtectionKind { DR0 -> SIGN }
fun domains: (DomainRule + Rule) -> Domain {
	DR0 -> D0
	+ Rule -> D0
}
fun precedes: Entry -> Entry { none -> none }

-- topic rules
fun topic_rule: DomainRule -> TopicRule { DR0 -> TR0 }
fun topic_expression: TopicRule -> Channel { TR0 -> Channel }
fun enable_discovery_protection: set TopicRule { TR0 }
fun enable_liveliness_protection: set TopicRule { TR0 }
fun enable_read_access_control: set TopicRule { TR0 }
fun enable_write_access_control: set TopicRule { TR0 }
fun metadata_protection_kind: TopicRule -> ProtectionKind { TR0 -> ENCRYPT }
fun data_protection_kind: TopicRule -> ProtectionKind { TR0 -> ENCRYPT }

-- grants
fun grant: Document -> Grant {
	P1_permissions_p7s -> G0
	+ P2_permissions_p7s -> G1
}
fun subject_name: Grant -> Certificate {
	G0 -> C1_talker
	+ G1 -> C2_listener
}
fun default_allow: set Grant { none }
fun skipped_out_of_date: set Grant { Grant }
fun joins_out_of_date: set Grant { none }

-- rules
fun rule: Grant -> Rule {
	G0 -> PR0
	+ G1 -> PR1
}
fun publish: Rule -> Channel { PR0 -> T0_chatter }
fun subscribe: Rule -> Channel { PR1 -> T0_chatter }
fun relay: Rule -> Channel { none -> none }
fun allow_rule: set Rule { Rule }
