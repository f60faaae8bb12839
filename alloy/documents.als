/**
 * Which signed documents a participant obeys (DDS-Security 1.1, 9.4.1.1).
 *
 * The signer must be the permissions CA. Some implementations are also content with any certificate that the CA issued
 * (a published weakness, CVE-2023-24010). Those that are not *pin* the signer: their trust domains are in
 * `pins_signer`.
 *
 * So two notions go side by side from here on: `genuine`, what the permissions CA has said, and `accepted`, what peers
 * obey. Rights by the second that are none by the first are what an attacker looks for.
 */
module documents
open authentication

/** Documents that the permissions CA of a trust domain itself has signed, and nobody else. */
fun genuine: TrustDomain -> Document {
	reading & { trust_domain: TrustDomain, document: intact - opaque |
		some document.signer and document.signer in trust_domain.permissions_ca }
}

/**
 * Certificates that a trust domain takes for signers because they chain to the permissions CA: none where it pins.
 * Several steps count here, since a signed document may bring the intermediates between along.
 */
fun vouched_signer: TrustDomain -> Certificate { chained & (TrustDomain - pins_signer) -> fit_to_sign }

/** Certificates below the permissions CAs of a trust domain: issued by one, or by an authority that is below one. */
fun chained: TrustDomain -> Certificate { permissions_ca.^(~(issuer :> authority)) }

/**
 * Whose documents a trust domain obeys. Where it pins, that is the permissions CA. Elsewhere it is every certificate
 * that is fit to sign, and is the permissions CA or chains to it.
 */
fun trusted_signer: TrustDomain -> Certificate {
	pins_signer <: permissions_ca + (permissions_ca & TrustDomain -> fit_to_sign) + vouched_signer
}

/** Documents that a trust domain obeys. An unreadable one may be any document, so it counts. */
fun accepted: TrustDomain -> Document {
	reading & ({ trust_domain: TrustDomain, document: intact | some document.signer
		and document.signer in trust_domain.trusted_signer }
	+ TrustDomain -> (opaque & Document))
}

/**
 * Certificates below the permissions CAs whose keys sign what a trust domain obeys; an authority issues itself a
 * signer.
 */
fun signing_below: TrustDomain -> Certificate { vouched_signer + (chained & (TrustDomain - pins_signer) -> authority) }

/**
 * Trust domains for which somebody signs with a key below a permissions CA that is neither its own nor an enclave's.
 */
fun signed_elsewhere: set TrustDomain {
	{ trust_domain: TrustDomain |
		some trust_domain.signing_below.public_key - trust_domain.permissions_ca.public_key - Enclave.identity.public_key }
}

/**
 * Enclaves whose own key signs documents that the trust domain obeys: they can give themselves any right. It is the key
 * of a permissions CA, or one that such a CA vouches for as the enclave's identity. Where it issues itself identities,
 * anything with that key counts. Where we could not read whom the trust domain believes, it may be any enclave.
 */
fun self_granting: TrustDomain -> Enclave {
	(authentic + issuing) & (
		TrustDomain -> anybody
		+ permissions_ca.(opaque & Certificate) -> Enclave
		+ signing_below.public_key.~public_key.~identity
		+ signed_elsewhere -> Enclave
		+ permissions_ca.public_key.~public_key.~identity)
}
