/**
 * The vocabulary: what an SROS2 keystore is made of, in the words of DDS-Security 1.1 and X.509.
 *
 * Begin here, and read on in this order. Each module opens the one before it, unless it says otherwise:
 *
 *   dds_security, keystore, precedence, authentication, documents, governance, permissions   what is written and obeyed
 *   capabilities, outsiders, enforcement, properties, vacuity, audit                         what follows, and is asked
 *   information_flow (opens vacuity), claims                                                 where data can go
 *   propagation, scenarios; application (opens claims and nodes)                            hops, and ROS 2 nodes
 *   determinism (opens nothing), forwarding (opens information_flow)                         what is declared of nodes
 *
 * Words, for who knows Alloy and not robots. Numbers such as 9.4.1.2 are clauses of DDS-Security 1.1.
 *
 *   node, topic      the software of a robot under ROS 2 is *nodes* that tell each other something on named *topics*
 *   DDS              the middleware below. Who joins one of its numbered *domains* is a *participant*; the others there
 *                    are its *peers*. Participants make *endpoints*: *writers* publish *samples* on a topic, *readers*
 *                    subscribe to it. A *partition* is a second name beside the topic, or a pattern for such names.
 *                    A writer and a reader *match* if both agree and security permits it: each decides for itself.
 *   implementation   of DDS, by a vendor. They read documents differently: `keystore` says as whom it reads
 *   packets          a *message* carries *submessages*: a sample with its sequence number, or acknowledgements, or the
 *                    like; a sample's submessage carries its *payload*, the data. Each of these three layers has a
 *                    protection kind and keys of its own: `rtps_protection_kind`, `metadata_protection_kind`,
 *                    `data_protection_kind`.
 *   discovery        participants announce themselves, and the topics of their endpoints
 *   liveliness       writers let their readers know that they still live
 *   relay            who passes submessages on without being a reader, to store them for instance
 *   CA, authority    a certificate authority: a certificate whose key signs others. One below another CA is an
 *                    *intermediate*, one that is believed by itself a *trust anchor*. A CA can *revoke* what it signed
 *   keystore         a directory in which SROS2, the security tool of ROS 2, keeps what follows
 *   enclave          a folder of it, with which a process starts: its *identity*, a certificate that an *identity CA*
 *                    signed, and its key; the CAs that it trusts; two documents that a *permissions CA* signed, in the
 *                    format of signed mail (S/MIME)
 *   governance       the first document: how each domain and topic is protected, normally one file for all
 *   permissions      the second: *grants*. Each names a certificate by its *subject*, the name of whom it is about, and
 *                    says in ordered rules what that one may publish and subscribe to
 *   access control   whether peers ask for a grant at all: of who joins a domain, of who reads, of who writes
 *
 * This module names kinds of things only. The atoms and the relations between them come from the module `keystore`,
 * which keystore-audit writes for each keystore, as functions without arguments. These are constants: the solver has
 * nothing to choose, and the translator is some hundred times as fast as with fields. They mean:
 *
 *   issuer               the certificates that signed this one, as verified; who signed itself is its own
 *   authority            certificates that may sign others
 *   fit_to_sign          certificates whose stated purposes allow to sign documents
 *   public_key           who has the key of one certificate has that of all with the same key
 *   following            the next instant
 *   audit_instant        the instant that the audit is about
 *   not_before           the first instant of the validity of a certificate or grant
 *   not_after            the last one
 *   intact               documents that nobody has altered since they were signed
 *   signer               who signed a document, as verified
 *   opaque               documents and enclaves that could not be read: they may be anything, and count at their worst;
 *                        and a certificate that stands for whatever is in CA files that could not be read
 *   assumed              what is taken for granted of the world and of peers
 *   asks_announced_only  trust domains that ask permissions only of an endpoint that is announced as under access
 *                        control
 *   pins_signer          trust domains that want the permissions CA itself as signer
 *   requires_grant       trust domains that want some grant even where they do not control who joins
 *   skipped_out_of_date  grants that are passed over where they are not in force
 *   joins_out_of_date    grants by which an enclave joins whether or not they are in force
 *   reading              documents as the implementations of a trust domain read them: all, unless enclaves of a fleet
 	run different ones; then a message is a document for each way in which it is read
 *   identity_ca          whom a trust domain believes about identities
 *   permissions_ca       whom a trust domain believes about documents
 *   governance           the governance document of a trust domain
 *   revoked              certificates on the revocation list of a trust domain
 *   refuses              certificates that members of a trust domain refuse although an identity CA vouches for them
 *   refuses_trust_domain        trust domains whose members tell another permissions CA than this one's,
 	where that is compared
 *   in_trust_domain             the trust domain of an enclave
 *   identity             the certificate of an enclave
 *   permissions          the permissions document that an enclave carries, in each way in which it is read
 *   reads_alone          channels that its own implementation lets an enclave read, where peers may concede it less
 *   writes_alone         the same of channels that it lets the enclave write
 *   refused_writes, refused_reads   channels on which it refuses the enclave a writer, a reader, that peers would take
 *   precedes             from an entry to its next sibling
 *   domain_rule, topic_rule   from a governance document to its rules, and from these to theirs
 *   grant, rule          from a permissions document to its grants, and from these to their rules
 *   domains              what a domain rule, or a rule of a grant, is about
 *   topic_expression     channels whose topic a topic rule is about
 *   allow_..., enable_..., ..._protection_kind   elements of governance, by their names there
 *   subject_name         certificates that a grant names
 *   default_allow        grants that allow what none of their rules is about
 *   allow_rule           rules that allow; the others deny
 *   publish, subscribe, relay   channels that a rule lists for each, in any domain: its criteria, of three kinds
 *   in_domain            the domain of a channel
 *   meets                channels in whose partition an endpoint is too, since its own partition is a pattern for it
 *
 * Scope: all sigs of `keystore` are `one sig` and every relation is constant, so that `for 0` adds nothing and leaves
 * nothing out: each `check` decides about exactly this keystore. It is a proof, not a bounded search. It must be 0:
 * where a keystore has nothing of a kind, no grants say, a larger scope would fill the abstract sig with strangers.
 * With tests/engine/alloy/any_keystore/keystore.als in the place of `keystore`, the same modules speak about every
 * keystore within a scope.
 */
module dds_security

/** How a layer of packets is protected (9.4.1.2.2): not, signed, or encrypted too. Payloads have the first three. */
abstract sig ProtectionKind {}
/**
 * Keys are symmetric, so SIGN says only that somebody who has the key made this. `_WITH_ORIGIN_AUTHENTICATION` adds a
 * code for each reader, under a key that the sender shares with that reader alone.
 */
one sig NONE, SIGN, ENCRYPT,
        SIGN_WITH_ORIGIN_AUTHENTICATION,
        ENCRYPT_WITH_ORIGIN_AUTHENTICATION extends ProtectionKind {}

/** A moment at which something in the keystore begins or ceases to be in force, or the moment of the audit. */
abstract sig Instant {}

/** A key pair, known by its public half. */
abstract sig Key {}

/** An X.509 certificate. */
abstract sig Certificate {}

/** A signed document: a file governance.p7s or permissions.p7s. */
abstract sig Document {}

/**
 * The enclaves that trust alike: one set of CA files, one governance document, one revocation list. What a peer
 * thinks of an enclave depends on the peer's trust domain alone, so `trust_domain` is a parameter of so much. An
 * ordinary keystore has one.
 */
abstract sig TrustDomain {}

/**
 * The identity, keys and documents that a process starts with. There is no sig for participants: an enclave stands for
 * whoever has its folder, in every domain that they join.
 */
abstract sig Enclave {}

/**
 * An unmanaged identity: no enclave of the keystore, but a certificate beside theirs that a trust domain takes. Whoever
 * has its key joins under it. Where it is the key of an enclave, that enclave does.
 */
abstract sig Unmanaged extends Enclave {}

/** All domain ids that no document of the keystore tells apart: what is so in one of them is so in each. */
abstract sig Domain {}

/** All pairs of a topic name and a partition name, in one such class of domains, that no document tells apart. */
abstract sig Channel {}

/** An element of a document whose place among its siblings matters, since the first that applies decides. */
abstract sig Entry {}

/** A `<domain_rule>` of a governance document (9.4.1.2.4): for some domains, who may join, what protects messages. */
abstract sig DomainRule extends Entry {}

/** A `<topic_rule>` of a domain rule (9.4.1.2.6): for some topics, who needs a grant, what protects samples. */
abstract sig TopicRule extends Entry {}

/** A `<grant>` of a permissions document (9.4.1.3.2): whom it names, its validity, its rules, its default. */
abstract sig Grant extends Entry {}

/** An `<allow_rule>` or `<deny_rule>` of a grant (9.4.1.3.3): domains, and topics to publish, subscribe to or relay. */
abstract sig Rule extends Entry {}

/** What is taken for granted: docs/assumptions.md has a section for each. Those that are made are in `assumed`. */
abstract sig Assumption {}
/** By the names of reports. */
one sig RobotsEnforce, AuthoritiesAsFound, NothingElseCertified, NoOtherDocuments, NothingInUnreadFiles,
        TruthfulAnnouncements, SessionsEndWithGrants, LockstepRounds extends Assumption {}
