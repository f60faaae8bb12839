/**
 * Time passes: what a keystore is worth later, as certificates and grants end, and others begin.
 *
 * Needs a module `keystore` whose audit instant moves. keystore-audit writes one beside this module, in the folder
 * `expiry`: there `Clock` is a variable `one sig` within `Instant`, `audit_instant` is where it stands, and
 * `Beginning` is the instant of the audit. Beside any other `keystore` this module has names without a meaning, and
 * does not run.
 *
 * The clock starts at the audit, goes on from instant to instant, and rests at the last one. Between two instants of
 * the keystore stands one more, so that the time between is looked at as well. As many steps as there are instants
 * from the audit on are complete: the clock does nothing else, and nothing else changes. Fewer steps are worth
 * nothing: then no trace comes to its rest, there is none, and every check "holds". The commands that are written
 * have just as many.
 *
 * Who is revoked stays so here, and nobody else is: of several revocation lists, those count that do at the audit.
 *
 * Rights can end with time and begin with time: with a grant whose validity begins later, and with one that ends,
 * where it stood before a wider one and implementations skip grants out of date.
 */
module expiry
open claims

/** The clock starts at the audit, goes on, and rests at the end: so there is one trace, and nothing to choose in it. */
fact TimePasses {
	Clock = Beginning
	always Clock' = (some Clock.following implies Clock.following else Clock)
}

/** There is a trace, and it comes to the last instant: without it no check of this module says anything. */
pred TimeIsExercised { eventually no Clock.following }

/**
 * A compartment for each moment, for claims that must hold at all of them. A field, since below `always` the
 * Analyzer does not look for the sets of a quantifier.
 */
one sig Compartment { var inside: set Enclave + Outsider }

/** No enclave is cut off by its authorities while its own certificate is in force. */
assert AuthoritiesOutliveIdentities {
	always all enclave: Enclave - Unmanaged |
		enclave.identity in in_force and enclave in enclave.in_trust_domain.(introduced[Certificate])
		implies enclave in enclave.in_trust_domain.introduced_in_force
}

/** Every identity that is vouched for now stays so. */
assert IdentitiesStayVouchedFor {
	all enclave: Enclave - Unmanaged | enclave in enclave.in_trust_domain.introduced_in_force
		implies always enclave in enclave.in_trust_domain.introduced_in_force
}

/** Every document whose signers are in force now keeps them so. */
assert SignersStayInForce {
	all document: Document | document.signer in in_force implies always document.signer in in_force
}

/** Nobody ever has a right that it had not before. */
assert NoRightBegins {
	always all trust_domain: TrustDomain {
		(presentable[trust_domain, publish_allowed])' in presentable[trust_domain, publish_allowed]
		(presentable[trust_domain, subscribe_allowed])' in presentable[trust_domain, subscribe_allowed]
	}
}

/** Nobody ever loses a right. */
assert NoRightEnds {
	always all trust_domain: TrustDomain {
		presentable[trust_domain, publish_allowed] in (presentable[trust_domain, publish_allowed])'
		presentable[trust_domain, subscribe_allowed] in (presentable[trust_domain, subscribe_allowed])'
	}
}
