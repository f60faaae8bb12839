/**
 * What permissions documents grant (DDS-Security 1.1, 9.4.1.3 and 9.4.3).
 *
 * Of a document, one grant that names the certificate decides (`chosen`); of the grant, the first rule that matches;
 * else its default. A document is not bound to who carries it. Any enclave may present any document, and peers look for
 * a grant that names the presenter. So the rights of an enclave are the union over all documents, not those of the
 * document in its folder.
 */
module permissions
open governance

/**
 * The grants that count for a certificate, at most one of each document. It is the first that names the certificate and
 * is not skipped, if it is in force. Some implementations skip grants out of date, others stop at one.
 */
fun chosen: Certificate -> Grant {
	let eligible = { g: Grant - (skipped_out_of_date - in_force), c: g.subject_name },
		first = eligible - preceded_by.eligible |
		{ c: Certificate, g: first.c & in_force }
}

/**
 * Where a rule says something by `criteria`, which is one of `publish`, `subscribe`, `relay`: only in its own
 * domains.
 */
fun matching[criteria: Rule -> Channel]: Rule -> Channel {
	{ r: Rule, c: r.criteria | c.in_domain in r.domains }
}

/** What a grant allows by its criteria of one kind: where the first matching rule allows, or none matches. */
fun allowed_by[criteria: Rule -> Channel]: Grant -> Channel {
	let matches = matching[criteria], decides = matches - preceded_by.matches |
		{ g: Grant, c: (g.rule & allow_rule).decides } + { g: default_allow, c: Channel - g.rule.matches }
}

/** Where a grant allows to publish. */
fun publish_allowed: Grant -> Channel { allowed_by[publish] }

/** Where a grant allows to subscribe. */
fun subscribe_allowed: Grant -> Channel { allowed_by[subscribe] }

/** Where a grant allows to relay. */
fun relay_allowed: Grant -> Channel { allowed_by[relay] }

/** Domains that a grant lets its subject join: those of its allow rules, or all where it allows by default. */
fun joining: Grant -> Domain {
	{ g: Grant, d: (g.rule & allow_rule).domains } + default_allow -> Domain
}

/**
 * Grants that count for each enclave in a trust domain that obeys `documents`, whichever of these they are in. That is
 * what it can show, not what is in its folder (for that see `own_grant` in `claims`).
 */
fun held[documents: set Document]: Enclave -> Grant {
	{ e: Enclave, g: e.identity.chosen & documents.grant }
}

/**
 * Grants by which a certificate joins: those that count; to an implementation to which dates are about endpoints alone
 * also the first that names it.
 */
fun admitting: Certificate -> Grant {
	let named = { g: joins_out_of_date, c: g.subject_name }, first = named - preceded_by.named |
		chosen + { c: Certificate, g: first.c }
}

/** As `held`, of the grants by which each enclave joins. */
fun entering[documents: set Document]: Enclave -> Grant {
	{ e: Enclave, g: e.identity.admitting & documents.grant }
}

/** Rights, and those that they amount to: an endpoint in a partition that is a pattern meets what this matches. */
fun with_met[rights: Enclave -> Channel]: Enclave -> Channel { rights + rights.meets }

/** What the permissions CA gave each enclave: rights of the kind `allowed`, by genuine documents alone. */
fun granted[trust_domain: TrustDomain, allowed: Grant -> Channel]: Enclave -> Channel {
	with_met[held[trust_domain.genuine].allowed] }

/** The same, and whatever a document that we could not read may grant, or any to an enclave that we could not read. */
fun may_be_granted[trust_domain: TrustDomain, allowed: Grant -> Channel]: Enclave -> Channel {
	AnythingGranted implies Enclave -> Channel else granted[trust_domain, allowed] + anybody -> Channel
}

/**
 * Enclaves that may have been granted any right: all, where some document may grant anything, which may name anybody.
 */
fun of_unknown_rights: set Enclave { AnythingGranted implies Enclave else anybody }

/** Enclaves that may have any right: by a document that they sign themselves, or by one that may grant anything. */
fun unbounded[trust_domain: TrustDomain]: set Enclave { of_unknown_rights + trust_domain.self_granting }

/**
 * What peers in a trust domain concede to each enclave: rights of the kind `allowed`, by whatever it can present. One
 * that issues itself identities gets what is granted to anybody.
 */
fun presentable[trust_domain: TrustDomain, allowed: Grant -> Channel]: Enclave -> Channel {
	with_met[
		held[trust_domain.accepted].allowed
		+ trust_domain.issuing -> (trust_domain.accepted.grant & in_force).allowed]
	+ unbounded[trust_domain] -> Channel
}
