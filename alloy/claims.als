/**
 * What users claim of their own keystore, in the forms that their settings file has (`keystore-audit.toml`).
 *
 * The places of a claim, sets of enclaves or of channels, are written into `audit`, as functions, with its command. A
 * claim about flows is a `run` that looks for a compartment (see `information_flow`): `separated` has an instance where
 * nothing flows. Every other claim is a `check`, whose counterexample tells who does what, like those of `properties`.
 */
module claims
open information_flow

-- whoever else has a subject that grants name, and is no enclave here

/**
 * Certificates that no enclave here has, and whose holders the trust domain lets in with a grant, or may (a grant
 * unread).
 */
fun elsewhere[trust_domain: TrustDomain]: set Certificate {
	let known = trust_domain in open_trust_domain implies Certificate
			else trust_domain.(vouched[identity_ca, Certificate] - revoked),
		named = AnythingGranted implies Certificate else admitting.(trust_domain.accepted.grant) |
		(known & named) - Enclave.identity
}

/** The same where a document could not be read, which may let them in and grant them anything. */
fun unread_elsewhere[trust_domain: TrustDomain]: set Certificate {
	AnythingGranted implies trust_domain.elsewhere else none
}

/** Domains that whoever has such a certificate can join: as `joins`. */
fun joins_elsewhere[trust_domain: TrustDomain]: Certificate -> Domain {
	trust_domain.elsewhere -> trust_domain.join_uncontrolled
	+ trust_domain.unread_elsewhere -> trust_domain.governed_domain
	+ { c: trust_domain.elsewhere, d: (c.admitting & trust_domain.accepted.grant).joining & trust_domain.governed_domain }
}

/** Channels in whose domain whoever has such a certificate takes part: as `within_reach`. */
fun reaches_elsewhere[trust_domain: TrustDomain]: Certificate -> Channel {
	joins_elsewhere[trust_domain].(~in_domain & Domain -> trust_domain.governed)
}

/** Rights of the kind `allowed` of whoever has such a certificate: as `presentable`. */
fun presentable_elsewhere[trust_domain: TrustDomain, allowed: Grant -> Channel]: Certificate -> Channel {
	let rights = { c: trust_domain.elsewhere, t: (c.chosen & trust_domain.accepted.grant).allowed } |
		rights + rights.meets + trust_domain.unread_elsewhere -> Channel
}

/** Channels on which peers match a writer of whoever has such a certificate: as `may_write`. */
fun writes_elsewhere[trust_domain: TrustDomain]: Certificate -> Channel {
	reaches_elsewhere[trust_domain]
	& (trust_domain.elsewhere -> trust_domain.write_uncontrolled + presentable_elsewhere[trust_domain, publish_allowed])
}

/** Channels on which peers match a reader of whoever has such a certificate, by a grant that could be read or none. */
fun reads_elsewhere[trust_domain: TrustDomain]: Certificate -> Channel {
	let granted = presentable_elsewhere[trust_domain, subscribe_allowed] - trust_domain.unread_elsewhere -> Channel |
		reaches_elsewhere[trust_domain] & (trust_domain.elsewhere -> trust_domain.read_uncontrolled + granted)
}

/** Those of them by a grant of the permissions CA. Whom documents let in that could not be read may have none. */
fun entitled_elsewhere[trust_domain: TrustDomain]: Certificate -> Channel {
	let rights = { c: trust_domain.elsewhere - trust_domain.unread_elsewhere,
		t: (c.chosen & trust_domain.genuine.grant).subscribe_allowed } |
		reads_elsewhere[trust_domain] & (rights + rights.meets)
}

/** Channels whose payloads whoever has such a certificate recovers from packets: as `overhears`. */
fun overhears_elsewhere[trust_domain: TrustDomain]: Certificate -> Channel {
	let unsealed = Channel - trust_domain.(payload_protection[encrypting]),
		bare = unsealed - trust_domain.(submessage_protection[encrypting]),
		relayed = presentable_elsewhere[trust_domain, relay_allowed] & trust_domain.elsewhere -> unsealed |
		reaches_elsewhere[trust_domain] & (trust_domain.elsewhere -> (bare + trust_domain.unasked) + relayed)
}

-- only these publish: enclaves, whoever else has a subject that grants name, and anybody who may join without one

/** Channels that anybody writes who joins the domain without an identity: their readers look into such messages. */
fun writes_unauthenticated: TrustDomain -> Channel { unguarded & unauthenticated_allowed.~in_domain }

/** Channels of domains that whoever has an identity of the CA joins, with whatever grants: others than are here too. */
fun open_to_known: TrustDomain -> Channel {
	{ trust_domain: TrustDomain, t: trust_domain.governed |
		t.in_domain in trust_domain.join_uncontrolled and
			(trust_domain in open_trust_domain or some trust_domain.identity_ca & authority) }
}

/** Channels to which it signs itself any right: its CA is one for permissions too, and signers are not pinned. */
fun granted_by_known: TrustDomain -> Channel {
	{ trust_domain: TrustDomain - pins_signer, t: trust_domain.governed |
		some trust_domain.identity_ca & authority & trust_domain.(permissions_ca + chained) }
}

/** Those that it writes. */
fun writes_known: TrustDomain -> Channel { open_to_known & (write_uncontrolled + unasked) + granted_by_known }

/** Channels on which each of these publishes by a grant of the permissions CA, or writes without one. */
fun publishes[trust_domain: TrustDomain]: (Enclave + Certificate + Outsider) -> Channel {
	may_write[trust_domain] + (granted[trust_domain, publish_allowed] - out_of_reach[trust_domain])
	+ writes_elsewhere[trust_domain] + Outsider -> trust_domain.(writes_unauthenticated + writes_known)
	+ unannounced[trust_domain] + (reaches_elsewhere[trust_domain] & Certificate -> trust_domain.unasked)
}

-- encrypted against insiders

/** Channels that anybody learns, or whoever has an identity of the CA, with whatever grants. */
fun learns_known: TrustDomain -> Channel {
	in_clear + open_to_known & (read_uncontrolled + unasked)
	+ (open_to_known - payload_protection[encrypting] - submessage_protection[encrypting]) + granted_by_known
}

/**
 * Channels that each enclave learns as anybody whose key it has, and does not read by a grant of the permissions CA.
 * Access control that is off entitles nobody. Those of whoever is none here, by a grant that lets it in; of others.
 */
fun listens_in[trust_domain: TrustDomain]: (Enclave + Certificate + Outsider) -> Channel {
	(in_any_guise[Enclave, knows[trust_domain]]
		- (may_read[trust_domain] & may_be_granted[trust_domain, subscribe_allowed]))
	+ (overhears_elsewhere[trust_domain] + reads_elsewhere[trust_domain] - entitled_elsewhere[trust_domain])
	+ Outsider -> trust_domain.learns_known
}

/** Everybody but second certificates of keys that enclaves have: these are asked with all that their keys open. */
fun insiders: set Enclave { Enclave - (Unmanaged & (Enclave - Unmanaged).one_key) }

-- never in one domain

/** Domains in which each enclave takes part: as a participant that peers authenticate, or without, as anybody may. */
fun enters[trust_domain: TrustDomain]: Enclave -> Domain {
	joins[trust_domain]
	+ Enclave -> trust_domain.unauthenticated_allowed
}

/**
 * Domains in which each takes part with the peers of some trust domain: who is in one with others is in it all the
 * same.
 */
fun enters_somewhere: Enclave -> Domain { { e: Enclave, d: Domain | some trust_domain: TrustDomain |
	d in e.(enters[trust_domain]) } }

-- able: what an enclave can do by its own documents alone, as it is meant to, and as a correct peer would see it

/** The permissions document that each enclave holds, as far as the trust domain obeys it. */
fun own_document[trust_domain: TrustDomain]: Enclave -> Document { permissions :> trust_domain.accepted }

/** Grants that count for each enclave in its own document. */
fun own_grant[trust_domain: TrustDomain]: Enclave -> Grant {
	{ e: Enclave, g: e.identity.chosen & e.(own_document[trust_domain]).grant }
}

/** Grants by which each enclave joins, of the same document. */
fun own_admitting[trust_domain: TrustDomain]: Enclave -> Grant {
	{ e: Enclave, g: e.identity.admitting & e.(own_document[trust_domain]).grant }
}

/** Enclaves whose own permissions, or who themselves, could not be read, so that they may have any right. */
fun own_unread: set Enclave { opaque & Enclave + permissions.(opaque & Document) }

/**
 * Domains that each enclave joins by its own document: as `joins`. An open trust domain lets everybody in, whatever it
 * requires; there `joins` has no need to say so, since an unreadable document makes everybody unbounded.
 */
fun joins_by_own[trust_domain: TrustDomain]: Enclave -> Domain {
	let grants = own_admitting[trust_domain],
		let_in = trust_domain in requires_grant - open_trust_domain implies grants.Grant + own_unread else Enclave |
		(trust_domain.authentic & let_in) -> trust_domain.join_uncontrolled
		+ ((grants.joining + own_unread -> Domain) & trust_domain.authentic -> trust_domain.governed_domain)
}

/** Channels that are not governed, or in domains that each enclave does not join by its own document. */
fun out_of_reach_by_own[trust_domain: TrustDomain]: Enclave -> Channel {
	(Enclave -> Domain - joins_by_own[trust_domain]).~in_domain + Enclave -> (Channel - trust_domain.governed)
}

/** Enclaves that members of the trust domain refuse by what they ask of an identity when they start themselves. */
fun turned_away[trust_domain: TrustDomain]: set Enclave { identity.(trust_domain.refuses) }

/** Channels on which each enclave writes by its own document, and its own implementation does not refuse it. */
fun writes_by_own[trust_domain: TrustDomain]: Enclave -> Channel {
	Enclave -> trust_domain.write_uncontrolled + own_grant[trust_domain].publish_allowed + own_unread -> Channel
	- out_of_reach_by_own[trust_domain] - refused_writes - turned_away[trust_domain] -> Channel
}

/** Channels that each enclave reads by its own document, and its own implementation does not refuse it. */
fun reads_by_own[trust_domain: TrustDomain]: Enclave -> Channel {
	Enclave -> trust_domain.read_uncontrolled + own_grant[trust_domain].subscribe_allowed + own_unread -> Channel
	- out_of_reach_by_own[trust_domain] - refused_reads - turned_away[trust_domain] -> Channel
}

/**
 * As `next` by right: whom one hop reaches from some of `holders`. Every enclave uses its own documents alone and
 * tells its peers the truth about its permissions CA.
 */
fun next_by_own[holders: set Enclave + Outsider, usable: set Channel, sending, receiving: TrustDomain]: set Enclave {
	receiving in sending.refuses_trust_domain implies none else
	{ e: in_trust_domain.receiving, c: e.(reads_by_own[receiving] & reads_by_own[sending]) }
		.(usable & holders.({ e: in_trust_domain.sending, c: e.(writes_by_own[receiving] & writes_by_own[sending]) }))
}

/** Enclaves that get a sample of one of `channels` by their own documents. */
fun getters_by_own[channels: set Channel, trust_domain: TrustDomain]: set Enclave {
	{ e: in_trust_domain.trust_domain, c: e.(reads_by_own[trust_domain]) }.channels
}

/** Enclaves that write on one of `channels` by their own documents. */
fun putters_by_own[channels: set Channel, trust_domain: TrustDomain]: set Enclave {
	{ e: in_trust_domain.trust_domain, c: e.(writes_by_own[trust_domain]) }.channels
}

/** As `gets`, by its own document. */
pred gets_by_own[getter: Enclave + Outsider, channels: set Channel] {
	some { trust_domain: TrustDomain | getter in getters_by_own[channels, trust_domain] }
}

/** As `hop`, by their own documents. */
pred hop_by_own[holder: Enclave + Outsider, over: Channel, receiver: Enclave + Outsider] {
	holder != receiver
	some { sending, receiving: TrustDomain | receiver in next_by_own[holder, over, sending, receiving] }
}

/** As `puts`, by its own document. */
pred puts_by_own[putter: Enclave + Outsider, channels: set Channel] {
	some { trust_domain: TrustDomain | putter in putters_by_own[channels, trust_domain] }
}

/**
 * As `separated`, where every enclave uses its own documents and nobody attacks: the intended flow is not possible. A
 * claim of "able" is violated where there is such a compartment.
 */
pred cut_off[inside, source: set Enclave + Outsider, first: set Channel, target: set Enclave + Outsider,
             last: set Channel, through: set Enclave, usable: set Channel] {
	source in inside
	all trust_domain: TrustDomain {
		getters_by_own[first, trust_domain] in inside + through - target
		no inside & putters_by_own[last, trust_domain]
	}
	all sending, receiving: TrustDomain {
		next_by_own[inside, usable, sending, receiving] in inside + through - (target - source)
		all home: source & target | home not in next_by_own[inside - home, usable, sending, receiving]
	}
}
