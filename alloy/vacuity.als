/**
 * Whether the properties have anything to speak of: each family of checks with a `run`.
 *
 * A check that finds no counterexample because nothing exists proves nothing. `FactsAreConsistent` must have an
 * instance, else every check would "hold", and keystore-audit trusts none of them. Where the situation of a family
 * does not exist in this keystore, it reports that the family had nothing to check.
 */
module vacuity
open properties

/**
 * The facts do not contradict each other: the one structure that the checks speak of exists. What it asks is true of
 * any keystore; that there is an instance at all, which a contradiction anywhere would prevent, is the point.
 */
pred FactsAreConsistent {
	one audit_instant
	AssumptionsAreMade
}

/**
 * What is taken for granted is so in this model, all of it at once: with a contradiction among these facts everything
 * would hold. It has to have an instance as well.
 */
pred AssumptionsAreMade {
	RobotsEnforce in assumed implies open_trust_domain in governance.(opaque & Document)
	AuthoritiesAsFound + NothingElseCertified + NothingInUnreadFiles in assumed implies anybody in opaque
	NoOtherDocuments + NothingInUnreadFiles in assumed implies (AnythingGranted implies some opaque & Document)
	TruthfulAnnouncements in assumed implies no unasked
}

/** Somebody is there to be authenticated: an enclave with an identity, or one that may be anybody. */
pred AuthenticationIsExercised { some enclave: Enclave | some enclave.identity or enclave in anybody }

/** Something is there to be protected: a governed channel on which an enclave may write or read. */
pred EncryptionIsExercised { some governed & (written_at_all + read_at_all) }

/** Some right is there to be enforced: an enclave that takes part in a domain, and has a grant there. */
pred AccessControlIsExercised {
	some { trust_domain: TrustDomain |
		some granted[trust_domain, publish_allowed] + granted[trust_domain, subscribe_allowed] - out_of_reach[trust_domain] }
}
