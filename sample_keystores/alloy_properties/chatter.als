/** Who speaks on /chatter, and that somebody can: properties for --alloy-property (docs/alloy-properties.md). */
module chatter
open keystore_audit

//@ enclave Talker = /talker
//@ topic Chatter = /chatter
//@ severity OnlyTheTalkerSpeaks = critical
//@ statement OnlyTheTalkerSpeaks = No enclave but the talker's has its samples taken on /chatter.
//@ statement SomebodyListens = The talker can speak, and another enclave listen.

/** Enclaves whose samples are taken on a channel of /chatter, by right or by the keys that they hold. */
fun speakers: set Enclave { { enclave: Enclave | some trust_domain: TrustDomain | some enclave.(feeds[trust_domain])
	& Chatter } }

assert OnlyTheTalkerSpeaks { all speaker: speakers | speaker in Talker }
check OnlyTheTalkerSpeaks for 0

run SomebodyListens {
	some trust_domain: TrustDomain, listener: Enclave - Talker |
		some Talker.(may_write[trust_domain]) & listener.(may_read[trust_domain]) & Chatter
} for 0
