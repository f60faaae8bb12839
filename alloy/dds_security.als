/**
 * The vocabulary: what an SROS2 keystore is made of, in the words of DDS-Security 1.1 and X.509.
 *
 * This module names kinds of things only. The atoms and the relations between them come from the module `keystore`,
 * which keystore-audit writes for each keystore, as functions without arguments:
 *
 *   certificates  issuer, authority, fit_to_sign, public_key, not_before, not_after, following, audit_instant
 *   documents     intact, signer, opaque, pins_signer, requires_grant
 *   realms        identity_ca, permissions_ca, governance, revoked
 *   enclaves      in_realm, identity, permissions
 *   governance    domain_rule, topic_rule, domains, topic_expression, precedes, the flags and kinds of both rules
 *   permissions   grant, subject_name, skipped_out_of_date, default_allow, rule, allow_rule, domains, publish, subscribe,
 *                 relay, precedes
 *   channels      in_domain
 *
 * Scope: all sigs of `keystore` are `one sig` and every relation is constant, so that `for 0` adds nothing and leaves
 * nothing out: each `check` decides about exactly this keystore. It is a proof, not a bounded search.
 * With any_keystore/keystore.als (tests) the same modules speak about every keystore within a scope.
 */
module dds_security

/** A protection kind (9.4.1.2.2). `data_protection_kind` takes only the first three. */
abstract sig ProtectionKind {}
/** The five kinds; `_WITH_ORIGIN_AUTHENTICATION` adds a code for each reader under a key of its own. */
one sig NONE, SIGN, ENCRYPT,
        SIGN_WITH_ORIGIN_AUTHENTICATION,
        ENCRYPT_WITH_ORIGIN_AUTHENTICATION extends ProtectionKind {}

/** A moment at which something in the keystore begins or ceases to be in force, or the moment of the audit. */
abstract sig Instant {}

/** A key pair, known by its public half. */
abstract sig Key {}

/** An X.509 certificate. */
abstract sig Certificate {}

/** A signed S/MIME document: governance.p7s or permissions.p7s. */
abstract sig Document {}

/** The enclaves that trust alike: one set of CA files, one governance document, one revocation list. */
abstract sig Realm {}

/** The identity, keys and documents that a ROS 2 context starts with; a participant of each domain that it joins. */
abstract sig Enclave {}

/** All domain ids that no document of the keystore tells apart. */
abstract sig Domain {}

/** All pairs of a topic name and a partition name, in one domain class, that no document tells apart. */
abstract sig Channel {}

/** An element of a document whose place among its siblings matters, since the first that applies decides. */
abstract sig Entry {}

/** A `<domain_rule>` of a governance document (9.4.1.2.4). */
abstract sig DomainRule extends Entry {}

/** A `<topic_rule>` of a domain rule (9.4.1.2.6). */
abstract sig TopicRule extends Entry {}

/** A `<grant>` of a permissions document (9.4.1.3.2). */
abstract sig Grant extends Entry {}

/** An `<allow_rule>` or `<deny_rule>` of a grant (9.4.1.3.3). */
abstract sig Rule extends Entry {}
