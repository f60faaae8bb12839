/**
 * Which signed documents a participant obeys (DDS-Security 1.1, 9.4.1.1).
 *
 * The signer must be the permissions CA. Some implementations are also content with any certificate that the CA issued
 * (a published weakness, CVE-2023-24010). Those that are not *pin* the signer: their realms are in `pins_signer`.
 *
 * So two notions go side by side from here on: `genuine`, what the permissions CA has said, and `accepted`, what peers
 * obey. Rights by the second that are none by the first are what an attacker looks for.
 */
module documents
open authentication

/** Documents that the permissions CA of a realm itself has signed, and nobody else. */
fun genuine: Realm -> Document {
	{ realm: Realm, document: intact - opaque |
		some document.signer and document.signer in realm.permissions_ca }
}

/**
 * Certificates that a realm takes for signers because they chain to the permissions CA: none where it pins. Several
 * steps count here, since a signed document may bring the intermediates between along.
 */
fun vouched_signer: Realm -> Certificate { chained & (Realm - pins_signer) -> fit_to_sign }

/** Certificates below the permissions CAs of a realm: issued by one, or by an authority that is below one. */
fun chained: Realm -> Certificate { permissions_ca.^(~(issuer :> authority)) }

/**
 * Whose documents a realm obeys: where it pins, the permissions CA's; elsewhere those of every certificate that is
 * fit to sign, and is the permissions CA or chains to it.
 */
fun trusted_signer: Realm -> Certificate {
	pins_signer <: permissions_ca + (permissions_ca & Realm -> fit_to_sign) + vouched_signer
}

/** Documents that a realm obeys. An unreadable one may be any document, so it counts. */
fun accepted: Realm -> Document {
	{ realm: Realm, document: intact | some document.signer and document.signer in realm.trusted_signer }
	+ Realm -> (opaque & Document)
}

/** Certificates below the permissions CAs whose keys sign what a realm obeys; an authority issues itself a signer. */
fun signing_below: Realm -> Certificate { vouched_signer + (chained & (Realm - pins_signer) -> authority) }

/** Realms for which somebody signs with a key below a permissions CA that is neither its own nor an enclave's. */
fun signed_elsewhere: set Realm {
	{ realm: Realm | some realm.signing_below.public_key - realm.permissions_ca.public_key - Enclave.identity.public_key }
}

/**
 * Enclaves whose own key signs documents that the realm obeys: they can give themselves any right. It is the key of a
 * permissions CA, or one that such a CA vouches for: as the enclave's identity, or where it issues itself identities, as
 * whatever has that key. Where we could not read whom the realm believes, it may be any enclave.
 */
fun self_granting: Realm -> Enclave {
	(authentic + issuing) & (
		Realm -> anybody
		+ permissions_ca.(opaque & Certificate) -> Enclave
		+ signing_below.public_key.~public_key.~identity
		+ signed_elsewhere -> Enclave
		+ permissions_ca.public_key.~public_key.~identity)
}
