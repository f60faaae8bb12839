/**
 * Theorems about permissions, in every keystore within a scope: dates, domains, deny rules, and that less is no more.
 *
 * `expect` makes the Analyzer's exit status the verdict. Each has a mutant of the modules that it alone finds
 * (test_model.py).
 */
module permission_theorems
open permissions

/** Rights come by grants in force alone, and one out of date that is skipped hides none behind it. */
check DatesChooseGrants {
	Certificate.chosen in in_force
	all document: Document, certificate: Certificate, g: document.grant & subject_name.certificate & in_force |
		document.grant & subject_name.certificate & g.preceded_by in skipped_out_of_date - in_force
			implies g in certificate.chosen
} for 2 but 0 Enclave, 0 TrustDomain, 1 Key, 0 DomainRule, 0 TopicRule, 3 Grant, 3 Rule, 6 Entry, 3 Instant expect 0

/** A rule says nothing about other domains: where no rule is of a channel's domain, the default decides. */
check RulesStayInTheirDomains {
	all g: Grant, channel: Channel | channel.in_domain not in g.rule.domains
		implies g in default_allow implies channel in g.(publish_allowed & subscribe_allowed & relay_allowed)
		else channel not in g.(publish_allowed + subscribe_allowed + relay_allowed)
} for 2 but 0 Enclave, 0 TrustDomain, 1 Key, 0 DomainRule, 0 TopicRule, 3 Grant, 3 Rule, 6 Entry expect 0

/** What a deny rule is of lets nobody join by it: an allow rule of the domain does, or the default. */
check DenyRulesLetNobodyJoin {
	all g: Grant - default_allow, domain: Domain | domain in g.joining implies some r: g.rule & domains.domain | r in allow_rule
} for 2 but 0 Enclave, 0 TrustDomain, 1 Key, 0 DomainRule, 0 TopicRule, 3 Grant, 3 Rule, 6 Entry expect 0

/** To take from an allow rule a channel that it names gives nobody a right that was not there before. */
check LessAllowedIsNoMore {
	all r: allow_rule, channel: Channel {
		allowed_by[publish - r -> channel] in publish_allowed
		allowed_by[subscribe - r -> channel] in subscribe_allowed
		allowed_by[relay - r -> channel] in relay_allowed
	}
} for 2 but 0 Enclave, 0 TrustDomain, 1 Key, 0 DomainRule, 0 TopicRule, 3 Grant, 3 Rule, 6 Entry expect 0
