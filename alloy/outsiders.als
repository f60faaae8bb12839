/**
 * What somebody without any key of the keystore can do: read, learn names, inject, replay, and feign that others live.
 * Such a one sees the packets of the network, and can send some (DDS-Security 1.1, 8.1 and 9.5).
 *
 * Each function is the set of channels where nothing stands in the way. Where unauthenticated participants are
 * allowed, they have no identity and no keys. Their messages come in the clear, whatever protects those of the others
 * (measured on Cyclone DDS).
 */
module outsiders
open capabilities

/** Channels whose payloads no protection hides: anybody reads them, if anybody writes. */
fun in_clear: TrustDomain -> Channel {
	governed - message_protection[encrypting] - submessage_protection[encrypting] - payload_protection[encrypting]
}

/** Channels whose payloads anybody can read who sees the packets. */
fun readable_outside: TrustDomain -> Channel { in_clear & written_at_all }

/** Channels whose names anybody learns who sees the packets of discovery. */
fun announced_outside: TrustDomain -> Channel {
	governed & (written_at_all + read_at_all) - message_protection[encrypting] - discovery_encrypted
}

/**
 * Channels on which readers look into messages of anybody; the submessages and payloads there may still be
 * protected.
 */
fun open_messages: TrustDomain -> Channel { governed & (message_protection[NONE] + unauthenticated_allowed.~in_domain) }

/** Channels on which readers take submessages from anybody: nothing tells who numbered or announced a sample. */
fun open_submessages: TrustDomain -> Channel { open_messages & submessage_protection[NONE] }

/** Channels on which readers would take samples from anybody, if anybody reads. */
fun unguarded: TrustDomain -> Channel { open_submessages & payload_protection[NONE] }

/** Channels whose readers take samples from anybody who can send packets. */
fun injectable_outside: TrustDomain -> Channel { unguarded & read_at_all }

/**
 * Channels whose readers take an old sample for a new one from anybody. A payload with its own protection still counts
 * when the submessage around it, with its sequence number, is anybody's.
 */
fun replayable_outside: TrustDomain -> Channel { open_submessages & read_at_all }

/** Channels whose readers take anybody's word that a writer lives, or that it has gone. */
fun liveliness_forgeable_outside: TrustDomain -> Channel { open_messages & read_at_all - liveliness_authenticated }
