/**
 * Where data may get to over sessions and routers that route by key, whatever nodes do.
 *
 * A *participant* has something and puts it out again (`session`: the processes in which its nodes run): it publishes,
 * asks, or answers. What it sends is about the keys of a *class*: those of one expression of a rule that no narrower one
 * has. So, of all that lets a message pass, one class is meant. Whoever attacks goes without a file: what it sends
 * may be wider (`wide`), and so may be what it asks for who listens (`heard`).
 *
 * Every process polices its own links, and decides by what it knows of the other end. Where something is possible it is
 * taken to be so: what is asked is whether anything may get through, and a "no" is for certain.
 */
module routed
open network

-- what one process decides

/** Subjects of its rules that the other end may be: no name and no protocol is any. */
fun may_be[process: Process, view: View]: set Subject {
	{ s: process.subject | s.common_name in view.known_name and s.protocol in view.speaks }
}

/** Those of them that it is for certain. Whoever attacks chooses its id; others have one that nobody knows here. */
fun surely_is[process: Process, view: View]: set Subject {
	may_be[process, view] - unproven - (view in chosen implies none else by_id)
}

/** A rule that allows may be about it, by one of its expressions. Replies may have any key. */
pred allowed[expressions: set Expression, sending: Sending, kind: Kind] {
	kind = REPLY
		implies some expressions
		else (let c = sending.class | some expressions & (includes.c + (meets.c - within.c)))
}

/** A rule that denies is about it for certain: a wider message is about more than the rule, but where that is all. */
pred denied[expressions: set Expression, sending: Sending, kind: Kind, wider: set Sending] {
	kind != REPLY
	sending in wider
		implies (some expressions & everything and sending.class not in verbatim)
		else some expressions & includes.(sending.class)
}

/** Rules of a subject about such messages. Of some releases a deletion that goes out is judged as a put. */
fun about[subjects: set Subject, kind: Kind, direction: Flow]: set Rule {
	subjects.rule & flow.direction & message.(direction = EGRESS and kind in judged_as_put implies PUT else kind)
}

/** Rules about a message, of one subject, may let it through: a rule that denies wins, in whatever order. */
pred granted[process: Process, rules: set Rule, kind: Kind, sending: Sending, wider: set Sending] {
	process in default_allow or allowed[(rules & allow_rule).expression, sending, kind]
	not denied[(rules - allow_rule).expression, sending, kind, wider]
}

/** A process may let a message through: for some subject that the other end may be, or by default. */
pred lets[process: Process, view: View, kind: Kind, direction: Flow, sending: Sending, wider: set Sending] {
	process in unrestricted
		or view in uncontrolled
		or (process in default_allow and no surely_is[process, view])
		or (some s: may_be[process, view] | granted[process, about[s, kind, direction], kind, sending, wider])
}

-- what crosses a link

/** What has to pass, from who sends (`AWAY`) or to it. */
fun asked: Deed -> Kind -> Way {
	PUBLISHED -> (PUT -> AWAY + SUBSCRIBE -> BACK)
	+ DELETED -> (DELETE -> AWAY + SUBSCRIBE -> BACK)
	+ REQUESTED -> (QUERY -> AWAY + SERVE -> BACK)
	+ REPLIED -> (SERVE -> AWAY + QUERY -> BACK + REPLY -> AWAY)
}

/** What tells of a receiver does not matter to a client that sends, nor to a peer that sends to a router. */
pred needed[kind: Kind, sender, receiver: Mode] {
	kind in SUBSCRIBE + SERVE implies not (sender = CLIENT or (sender = PEER and receiver = ROUTER))
}

/** All of a sending passes between two ends, of which those that are processes decide, by what they know. */
pred crosses[sending: Sending, from: lone Process, from_mode: Mode, sees: lone View,
             to: lone Process, to_mode: Mode, seen: lone View] {
	all kind: Kind {
		(AWAY in sending.deed.asked[kind]
			and needed[kind, kind in SUBSCRIBE + SERVE implies to_mode else from_mode,
			                 kind in SUBSCRIBE + SERVE implies from_mode else to_mode]) implies {
			all p: from | lets[p, sees, kind, EGRESS, sending, wide]
			all p: to | lets[p, seen, kind, INGRESS, sending, wide]
		}
		(BACK in sending.deed.asked[kind] and needed[kind, from_mode, to_mode]) implies {
			all p: from | lets[p, sees, kind, INGRESS, sending, heard]
			all p: to | lets[p, seen, kind, EGRESS, sending, heard]
		}
	}
}

/** Over links between processes, with the files of both. */
fun crossing: Link -> Sending {
	{ l: Link, s: Sending | crosses[s, l.near, l.near.mode, l.sees, l.far, l.far.mode, l.seen] }
}

/** From who attacks to a process. */
fun forced: Reach -> Sending { { r: Reach, s: wide | crosses[s, none, r.acts_as, none, r.at, r.at.mode, r.known] } }

/** From a process to who listens without a file. */
fun overheard: Reach -> Sending { { r: Reach, s: heard | crosses[s, r.at, r.at.mode, r.known, none, r.acts_as, none] } }

/** From a process to whoever is on the wire of a link that is not encrypted. */
fun tapped: Link -> Sending { { l: plain, s: heard | crosses[s, l.near, l.near.mode, l.sees, none, l.far.mode, none] } }

-- who passes something on

/** A process passes on between such neighbours: a router, but between peers; a peer, if one is a client. */
pred passes_on[process: Process, from_mode, to_mode: Mode] {
	process.mode = ROUTER and (from_mode + to_mode != PEER or process in brokering)
		or process.mode = PEER and CLIENT in from_mode + to_mode
}

/** Where something is that came over a link. */
fun arrived: Tie -> Process { far + at }

/** The mode of whoever sent it over that link. */
fun came_from: Tie -> Mode { near.mode + acts_as }

/** Over which links it may go on, if these let it: not straight back. */
fun onward: Tie -> Link {
	{ came: Tie, l: Link | l.near = came.arrived and l.far not in came.near
		and passes_on[l.near, came.came_from, l.far.mode] }
}

/** And to whom it may go on that listens. */
fun onward_to: Tie -> Reach {
	{ came: Tie, r: Reach | r.at = came.arrived and passes_on[r.at, came.came_from, r.acts_as] }
}

/** By sending, who may tell whom something: over somebody's file, or as nobody knows the file of one of them. */
fun told: Sending -> Participant -> Participant {
	let crossed = crossing, forces = forced, hears = overheard, taps = tapped, on = onward, to = onward_to |
	{ s: Sending, from, receiver: Participant | from != receiver and {
		let begun = s in wide
				implies holder.(from & attacking) & forces.s
				else near.(from.session) & crossed.s,
			come = begun.*(on :> crossed.s) {
			(s not in heard and receiver in session.(come.arrived))
			or (receiver in listening and some holder.receiver & hears.s
				& (come.to + (s in wide implies none else at.(from.session))))
			or (receiver in outsider and some taps.s & (come.on + (s in wide implies none else near.(from.session))))
			or (from in attacking and receiver in listening and some (from + receiver) & unseen)
		}
	} }
}

/** Something may get from one end to the other, over nobody of `through`. */
pred gets_through {
	let tells = told,
		hop = middle.tells,
		got = (Participant - through).(first.tells),
		begun = source + (got - through),
		come = begun.hop.*((Participant - through) <: hop) |
		some (got + come) & target
		or some (begun + (come - through)) <: (last.tells) :> (Participant - through)
}
