/**
 * The audit: every property of `properties`, after the runs that show what they speak of.
 *
 * To read the model, begin with `dds_security`: words, order of the modules, and why `for 0` is a proof.
 * The first two are opened again so that the window shows their atoms by short names.
 */
module audit
open dds_security
open keystore
open vacuity

run FactsAreConsistent for 0
run AuthenticationIsExercised for 0
run EncryptionIsExercised for 0
run AccessControlIsExercised for 0

check OnlyAuthenticatedParticipantsJoin { OnlyAuthenticatedParticipantsJoin } for 0
check IdentitiesChainToTheIdentityCa { IdentitiesChainToTheIdentityCa } for 0
check DocumentsSignedByThePermissionsCa { DocumentsSignedByThePermissionsCa } for 0
check NoIdentityServesTwoEnclaves { NoIdentityServesTwoEnclaves } for 0
check NoEnclaveGrantsItselfRights { NoEnclaveGrantsItselfRights } for 0
check OneCaForOneRole { OneCaForOneRole } for 0
check NoSubjectServesTwoEnclaves { NoSubjectServesTwoEnclaves } for 0
check OutsidersCannotRead { OutsidersCannotRead } for 0
check OutsidersCannotLearnNames { OutsidersCannotLearnNames } for 0
check OutsidersCannotInject { OutsidersCannotInject } for 0
check OutsidersCannotReplay { OutsidersCannotReplay } for 0
check OutsidersCannotForgeLiveliness { OutsidersCannotForgeLiveliness } for 0
check GrantsAreEnforced { GrantsAreEnforced } for 0
check NobodyWritesWithoutAGrant { NobodyWritesWithoutAGrant } for 0
check NobodyReadsWithoutAGrant { NobodyReadsWithoutAGrant } for 0
check ReadersCannotForge { ReadersCannotForge } for 0
check RelaysCannotRead { RelaysCannotRead } for 0
check NoEnclaveBridgesDomains { NoEnclaveBridgesDomains } for 0

-- for the Analyzer's window, which draws functions without arguments, and those of the main module only

/** Who has which identity. */
fun has_identity: Enclave -> Certificate { identity }
/** Who carries which permissions document. */
fun has_permissions: Enclave -> Document { permissions }
/** Whose trust domain has which governance document. */
fun has_governance: Enclave -> Document { in_trust_domain.governance }
/** Who signed a document. */
fun signed_by: Document -> Certificate { signer }
/** Who issued a certificate; of one that signed itself, nobody else. */
fun issued_by: Certificate -> Certificate { issuer - iden }

/** Who can write in some trust domain. */
fun writes: Enclave -> Channel { { e: Enclave, c: Channel | some r: TrustDomain | c in e.(may_write[r]) } }
/** Who can read in some trust domain. */
fun reads: Enclave -> Channel { { e: Enclave, c: Channel | some r: TrustDomain | c in e.(may_read[r]) } }
/** Who can write or read in some trust domain without a grant. */
fun ungranted: Enclave -> Channel {
	{ e: Enclave, c: Channel | some r: TrustDomain | c in e.(writes_without_a_grant[r] + reads_without_a_grant[r]) }
}
