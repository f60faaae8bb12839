/**
 * Who a participant believes (DDS-Security 1.1, 8.3 and 9.3).
 *
 * That a signature verifies under a key is a fact that keystore-audit has established with real cryptography. Here
 * such facts are composed. One step is a chain: each certificate of a CA file is a trust anchor (9.3.1.1). Where
 * implementations want more above a CA, `identity_ca` has only those for which they find it.
 */
module authentication
open precedence

/**
 * Trust domains whose governance document could not be read: it may say anything, so they keep nobody and nothing out.
 */
fun open_trust_domain: set TrustDomain {
	governance.(opaque & Document) + (RobotsEnforce in assumed implies none else TrustDomain)
}

/**
 * Enclaves that may have any identity: theirs could not be read, or it is not granted that authorities made no others.
 */
fun anybody: set Enclave {
	opaque & Enclave
	+ (AuthoritiesAsFound + NothingElseCertified + NothingInUnreadFiles in assumed implies none else Enclave)
}

/** Documents that nobody has here may grant anything. */
pred DocumentsElsewhere { NoOtherDocuments + NothingInUnreadFiles not in assumed }

/** Some document may grant anything: one that could not be read, or one that is not here. */
pred AnythingGranted { some opaque & Document or DocumentsElsewhere }

/**
 * Certificates that an authority among its certificates `pool` issued, by trust domain, if exactly the certificates
 * `valid` are in force. `valid` is a parameter since the same is asked with and without dates.
 */
fun vouched[pool: TrustDomain -> Certificate, valid: set Certificate]: TrustDomain -> Certificate {
	(pool & TrustDomain -> (authority & valid)).~issuer & TrustDomain -> valid
}

/**
 * Enclaves whose identity the CA of each trust domain vouches for, if exactly the certificates `valid` are in force.
 */
fun introduced[valid: set Certificate]: TrustDomain -> Enclave { (vouched[identity_ca, valid] - revoked).~identity }

/** The same at the audit instant. */
fun introduced_in_force: TrustDomain -> Enclave { introduced[in_force & Certificate] }

/**
 * Enclaves that each trust domain takes for members of the keystore, without regard to dates. Clocks on robots are
 * wrong, and with an expired CA each property of access would hold because nobody takes part.
 */
fun authentic: TrustDomain -> Enclave {
	introduced[Certificate] + TrustDomain -> anybody + open_trust_domain -> Enclave
}

/** Enclaves that can issue themselves any identity: their key is that of an authority that a trust domain believes. */
fun issuing: TrustDomain -> Enclave { (identity_ca & TrustDomain -> authority).public_key.~public_key.~identity }

/** Trust domains that enclaves are of, and not unmanaged identities alone: how the keystore is meant to be used. */
fun of_enclaves: set TrustDomain { (Enclave - Unmanaged).in_trust_domain }

/** Pairs of enclaves whose identities have one key, so that each can pass for the other. */
fun one_key: Enclave -> Enclave { identity.public_key.~(identity.public_key) - iden }

/** As whom each enclave can act: every enclave with its key, which an unreadable enclave may have or lend. */
fun acts_as: Enclave -> Enclave {
	{ e: Enclave, same: e } + one_key + anybody -> Enclave + Enclave -> anybody
}

/** Pairs of enclaves whose identities one grant names, so that neither can have rights that the other has not. */
fun one_subject: Enclave -> Enclave { identity.~subject_name.subject_name.~identity - iden }

/** Pairs of an enclave and an unmanaged identity, either first, of one issuer and one subject to every grant. */
fun renewed: Enclave -> Enclave {
	let same = { e: Enclave - Unmanaged, large: Unmanaged |
		e.identity.issuer = large.identity.issuer and subject_name.(e.identity) = subject_name.(large.identity) } |
			same + ~same
}

/**
 * Enclaves that each can pass for; one that we could not read, for anybody. Of two, one may be unmanaged, but then it
 * is no certificate of the other that was renewed.
 */
fun shares_identity: Enclave -> Enclave { one_key - Unmanaged -> Unmanaged - renewed + anybody -> Enclave }

/** Pairs of an enclave and an unmanaged identity, either first, whose key is that of another enclave. */
fun held_by_another: Enclave -> Enclave {
	let held = { e: Enclave - Unmanaged, large: Unmanaged | some large.one_key - Unmanaged - e } | held + ~held
}

/**
 * Enclaves that each shares its rights with; one that we could not read, with anybody. Permissions that we could not
 * read may have a grant that names two. An unmanaged identity that no enclave has shares nothing with enclaves.
 */
fun shares_subject: Enclave -> Enclave {
	one_subject - (Unmanaged -> Enclave + Enclave -> Unmanaged - held_by_another)
	- Enclave -> anybody + anybody -> Enclave
	+ ((some (opaque & Document) - TrustDomain.governance or DocumentsElsewhere)
		implies Enclave -> Enclave - iden else none -> none)
}
