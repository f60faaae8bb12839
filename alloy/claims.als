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

/** Certificates that no enclave here has, and whose holders the realm lets in with a grant, or may (a grant unread). */
fun elsewhere[realm: Realm]: set Certificate {
	let known = realm in open_realm implies Certificate else realm.(vouched[identity_ca, Certificate] - revoked),
		named = AnythingGranted implies Certificate else admitting.(realm.accepted.grant) |
		(known & named) - Enclave.identity
}

/** The same where a document could not be read, which may let them in and grant them anything. */
fun unread_elsewhere[realm: Realm]: set Certificate { AnythingGranted implies realm.elsewhere else none }

/** Domains that whoever has such a certificate can join: as `joins`. */
fun joins_elsewhere[realm: Realm]: Certificate -> Domain {
	realm.elsewhere -> realm.join_uncontrolled + realm.unread_elsewhere -> realm.governed_domain
	+ { c: realm.elsewhere, d: (c.admitting & realm.accepted.grant).joining & realm.governed_domain }
}

/** Channels in whose domain whoever has such a certificate takes part: as `within_reach`. */
fun reaches_elsewhere[realm: Realm]: Certificate -> Channel {
	joins_elsewhere[realm].(~in_domain & Domain -> realm.governed)
}

/** Rights of the kind `allowed` of whoever has such a certificate: as `presentable`. */
fun presentable_elsewhere[realm: Realm, allowed: Grant -> Channel]: Certificate -> Channel {
	let rights = { c: realm.elsewhere, t: (c.chosen & realm.accepted.grant).allowed } |
		rights + rights.meets + realm.unread_elsewhere -> Channel
}

/** Channels on which peers match a writer of whoever has such a certificate: as `may_write`. */
fun writes_elsewhere[realm: Realm]: Certificate -> Channel {
	reaches_elsewhere[realm]
	& (realm.elsewhere -> realm.write_uncontrolled + presentable_elsewhere[realm, publish_allowed])
}

/** Channels on which peers match a reader of whoever has such a certificate, by a grant that could be read or none. */
fun reads_elsewhere[realm: Realm]: Certificate -> Channel {
	let granted = presentable_elsewhere[realm, subscribe_allowed] - realm.unread_elsewhere -> Channel |
		reaches_elsewhere[realm] & (realm.elsewhere -> realm.read_uncontrolled + granted)
}

/** Those of them by a grant of the permissions CA. Whom documents let in that could not be read may have none. */
fun entitled_elsewhere[realm: Realm]: Certificate -> Channel {
	let rights = { c: realm.elsewhere - realm.unread_elsewhere, t: (c.chosen & realm.genuine.grant).subscribe_allowed } |
		reads_elsewhere[realm] & (rights + rights.meets)
}

/** Channels whose payloads whoever has such a certificate recovers from packets: as `overhears`. */
fun overhears_elsewhere[realm: Realm]: Certificate -> Channel {
	let unsealed = Channel - realm.(payload_protection[encrypting]),
		bare = unsealed - realm.(submessage_protection[encrypting]),
		relayed = presentable_elsewhere[realm, relay_allowed] & realm.elsewhere -> unsealed |
		reaches_elsewhere[realm] & (realm.elsewhere -> (bare + realm.unasked) + relayed)
}

-- only these publish: enclaves, whoever else has a subject that grants name, and anybody who may join without one

/** Channels that anybody writes who joins the domain without an identity: their readers look into such messages. */
fun writes_unauthenticated: Realm -> Channel { unguarded & unauthenticated_allowed.~in_domain }

/** Channels of domains that whoever has an identity of the CA joins, with whatever grants: others than are here too. */
fun open_to_known: Realm -> Channel {
	{ realm: Realm, t: realm.governed |
		t.in_domain in realm.join_uncontrolled and (realm in open_realm or some realm.identity_ca & authority) }
}

/** Channels to which it signs itself any right: its CA is one for permissions too, and signers are not pinned. */
fun granted_by_known: Realm -> Channel {
	{ realm: Realm - pins_signer, t: realm.governed |
		some realm.identity_ca & authority & realm.(permissions_ca + chained) }
}

/** Those that it writes. */
fun writes_known: Realm -> Channel { open_to_known & (write_uncontrolled + unasked) + granted_by_known }

/** Channels on which each of these publishes by a grant of the permissions CA, or writes without one. */
fun publishes[realm: Realm]: (Enclave + Certificate + Outsider) -> Channel {
	may_write[realm] + (granted[realm, publish_allowed] - out_of_reach[realm])
	+ writes_elsewhere[realm] + Outsider -> realm.(writes_unauthenticated + writes_known)
	+ unannounced[realm] + (reaches_elsewhere[realm] & Certificate -> realm.unasked)
}

-- encrypted against insiders

/** Channels that anybody learns, or whoever has an identity of the CA, with whatever grants. */
fun learns_known: Realm -> Channel {
	in_clear + open_to_known & (read_uncontrolled + unasked)
	+ (open_to_known - payload_protection[encrypting] - submessage_protection[encrypting]) + granted_by_known
}

/**
 * Channels that each enclave learns as anybody whose key it has, and does not read by a grant of the permissions CA:
 * that nobody asks for grants entitles nobody. Those of whoever is none here, by a grant that lets it in; of others.
 */
fun listens_in[realm: Realm]: (Enclave + Certificate + Outsider) -> Channel {
	(in_any_guise[Enclave, knows[realm]] - (may_read[realm] & may_be_granted[realm, subscribe_allowed]))
	+ (overhears_elsewhere[realm] + reads_elsewhere[realm] - entitled_elsewhere[realm])
	+ Outsider -> realm.learns_known
}

/** Everybody but second certificates of keys that enclaves have: these are asked with all that their keys open. */
fun insiders: set Enclave { Enclave - (Unmanaged & (Enclave - Unmanaged).one_key) }

-- never in one domain

/** Domains in which each enclave takes part: as a participant that peers authenticate, or without, as anybody may. */
fun enters[realm: Realm]: Enclave -> Domain { joins[realm] + Enclave -> realm.unauthenticated_allowed }

/** Domains in which each takes part with the peers of some realm: who is in one with others is in it all the same. */
fun enters_somewhere: Enclave -> Domain { { e: Enclave, d: Domain | some realm: Realm | d in e.(enters[realm]) } }

-- able: what an enclave can do by its own documents alone, as it is meant to, and as a peer that is right would see it

/** The permissions document that each enclave holds, as far as the realm obeys it. */
fun own_document[realm: Realm]: Enclave -> Document { permissions :> realm.accepted }

/** Grants that count for each enclave in its own document. */
fun own_grant[realm: Realm]: Enclave -> Grant {
	{ e: Enclave, g: e.identity.chosen & e.(own_document[realm]).grant }
}

/** Grants by which each enclave joins, of the same document. */
fun own_admitting[realm: Realm]: Enclave -> Grant {
	{ e: Enclave, g: e.identity.admitting & e.(own_document[realm]).grant }
}

/** Enclaves whose own permissions, or who themselves, could not be read, so that they may have any right. */
fun own_unread: set Enclave { opaque & Enclave + permissions.(opaque & Document) }

/**
 * Domains that each enclave joins by its own document: as `joins`. An open realm lets everybody in, whatever it
 * requires; there `joins` has no need to say so, since an unreadable document makes everybody unbounded.
 */
fun joins_by_own[realm: Realm]: Enclave -> Domain {
	let grants = own_admitting[realm],
		let_in = realm in requires_grant - open_realm implies grants.Grant + own_unread else Enclave |
		(realm.authentic & let_in) -> realm.join_uncontrolled
		+ ((grants.joining + own_unread -> Domain) & realm.authentic -> realm.governed_domain)
}

/** Channels that are not governed, or in domains that each enclave does not join by its own document. */
fun out_of_reach_by_own[realm: Realm]: Enclave -> Channel {
	(Enclave -> Domain - joins_by_own[realm]).~in_domain + Enclave -> (Channel - realm.governed)
}

/** Enclaves that members of the realm refuse by what they ask of an identity when they start themselves. */
fun turned_away[realm: Realm]: set Enclave { identity.(realm.refuses) }

/** Channels on which each enclave writes by its own document, and its own implementation does not refuse it. */
fun writes_by_own[realm: Realm]: Enclave -> Channel {
	Enclave -> realm.write_uncontrolled + own_grant[realm].publish_allowed + own_unread -> Channel
	- out_of_reach_by_own[realm] - refused_writes - turned_away[realm] -> Channel
}

/** Channels that each enclave reads by its own document, and its own implementation does not refuse it. */
fun reads_by_own[realm: Realm]: Enclave -> Channel {
	Enclave -> realm.read_uncontrolled + own_grant[realm].subscribe_allowed + own_unread -> Channel
	- out_of_reach_by_own[realm] - refused_reads - turned_away[realm] -> Channel
}

/**
 * As `next` by right: whom one hop reaches from some of `holders`, if every enclave uses its own documents alone and
 * tells its peers the truth about its permissions CA.
 */
fun next_by_own[holders: set Enclave + Outsider, usable: set Channel, sending, receiving: Realm]: set Enclave {
	receiving in sending.refuses_realm implies none else
	{ e: in_realm.receiving, c: e.(reads_by_own[receiving] & reads_by_own[sending]) }
		.(usable & holders.({ e: in_realm.sending, c: e.(writes_by_own[receiving] & writes_by_own[sending]) }))
}

/** Enclaves that get a sample of one of `channels` by their own documents. */
fun getters_by_own[channels: set Channel, realm: Realm]: set Enclave {
	{ e: in_realm.realm, c: e.(reads_by_own[realm]) }.channels
}

/** Enclaves that write on one of `channels` by their own documents. */
fun putters_by_own[channels: set Channel, realm: Realm]: set Enclave {
	{ e: in_realm.realm, c: e.(writes_by_own[realm]) }.channels
}

/** As `gets`, by its own document. */
pred gets_by_own[getter: Enclave + Outsider, channels: set Channel] {
	some { realm: Realm | getter in getters_by_own[channels, realm] }
}

/** As `hop`, by their own documents. */
pred hop_by_own[holder: Enclave + Outsider, over: Channel, receiver: Enclave + Outsider] {
	holder != receiver
	some { sending, receiving: Realm | receiver in next_by_own[holder, over, sending, receiving] }
}

/** As `puts`, by its own document. */
pred puts_by_own[putter: Enclave + Outsider, channels: set Channel] {
	some { realm: Realm | putter in putters_by_own[channels, realm] }
}

/**
 * As `separated`, where every enclave uses its own documents and nobody attacks: the intended flow is not possible. A
 * claim of "able" is violated where there is such a compartment.
 */
pred cut_off[inside, source: set Enclave + Outsider, first: set Channel, target: set Enclave + Outsider,
             last: set Channel, through: set Enclave, usable: set Channel] {
	source in inside
	all realm: Realm {
		getters_by_own[first, realm] in inside + through - target
		no inside & putters_by_own[last, realm]
	}
	all sending, receiving: Realm {
		next_by_own[inside, usable, sending, receiving] in inside + through - (target - source)
		all home: source & target | home not in next_by_own[inside - home, usable, sending, receiving]
	}
}
