/**
 * Any network at all: the names of the generated module `network`, as free relations, and what is well-formed.
 */
module network
open routing

sig AnyProcess extends Process { mode: one Mode, subject: set Subject }
sig brokering, unrestricted, default_allow in Process {}

sig AnyParticipant extends Participant { session: set Process }
sig outsider, unseen, attacking, listening, source, target, through in Participant {}

sig AnySubject extends Subject { rule: set Rule, common_name: lone Name, protocol: lone Protocol }
sig unproven, by_id in Subject {}

sig AnyRule extends Rule { message: set Kind, flow: some Flow, expression: some Expression }
sig allow_rule in Rule {}
sig judged_as_put in Kind {}

sig AnyLink extends Link { near, far: one Process, sees, seen: one View }
sig plain in Link {}
sig AnyReach extends Reach { holder: one Participant, at: one Process, acts_as: one Mode, known: one View }

sig AnyView extends View { known_name: lone Name, speaks: one Protocol }
sig uncontrolled, chosen in View {}
sig AnyName extends Name {}
sig AnyProtocol extends Protocol {}

sig AnyExpression extends Expression { includes, meets, within: set Class }
sig everything in Expression {}
sig AnyClass extends Class {}
sig verbatim in Class {}

sig AnySending extends Sending { class: one Class, deed: one Deed }
sig wide, heard, middle, first, last in Sending {}

fact WellFormed {
	includes in meets
	no link: Link | link.near = link.far
	all process: Process | lone session.process
	all s: Sending | s.deed = DELETED implies s in wide
	lone outsider and no outsider.session
	unseen in attacking & listening
}
