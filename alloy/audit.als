/** The audit: every property of `properties`, after the runs that show what they speak of. */
module audit
open dds_security
open keystore
open vacuity

run FactsAreConsistent for 0
run AuthenticationIsExercised for 0
run EncryptionIsExercised for 0
run AccessControlIsExercised for 0

check OnlyAuthenticatedParticipantsJoin for 0
check IdentitiesChainToTheIdentityCa for 0
check DocumentsSignedByThePermissionsCa for 0
check NoIdentityServesTwoEnclaves for 0
check NoEnclaveGrantsItselfRights for 0
check OneCaForOneRole for 0
check NoSubjectServesTwoEnclaves for 0
check OutsidersCannotRead for 0
check OutsidersCannotLearnNames for 0
check OutsidersCannotInject for 0
check OutsidersCannotReplay for 0
check OutsidersCannotForgeLiveliness for 0
check GrantsAreEnforced for 0
check NobodyWritesWithoutAGrant for 0
check NobodyReadsWithoutAGrant for 0
check ReadersCannotForge for 0
check RelaysCannotRead for 0
check NoEnclaveBridgesDomains for 0

-- for the window, which draws the functions of the main module

/** Who has which identity, permissions and governance, and who signed or issued these. */
fun has_identity: Enclave -> Certificate { identity }
fun has_permissions: Enclave -> Document { permissions }
fun has_governance: Enclave -> Document { in_realm.governance }
fun signed_by: Document -> Certificate { signer }
fun issued_by: Certificate -> Certificate { issuer - iden }

/** Who can write and read in some realm, and who can without a grant. */
fun writes: Enclave -> Channel { { e: Enclave, c: Channel | some r: Realm | c in e.(may_write[r]) } }
fun reads: Enclave -> Channel { { e: Enclave, c: Channel | some r: Realm | c in e.(may_read[r]) } }
fun ungranted: Enclave -> Channel {
	{ e: Enclave, c: Channel | some r: Realm | c in e.(writes_without_a_grant[r] + reads_without_a_grant[r]) }
}
