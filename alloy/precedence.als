/**
 * Order: before and after in time, and among siblings in a document, of which the first that applies decides.
 */
module precedence
open keystore

/** Instants up to the audit instant, itself included. */
fun past: set Instant { *following.audit_instant }

/** Instants from the audit instant on, itself included. */
fun to_come: set Instant { audit_instant.*following }

/** Certificates and grants in force at the audit instant: both ends of the validity count (RFC 5280, 4.1.2.5). */
fun in_force: set Certificate + Grant { not_before.past & not_after.to_come }

/** An entry and all of its siblings that stand before it. `precedes` takes an entry to the next sibling. */
fun preceded_by: Entry -> Entry { ^(~precedes) }
