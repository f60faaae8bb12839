/**
 * Words for sessions and routers that route by key expressions, as rmw_zenoh starts them. Read this first.
 *
 * Each *process* starts with a file: what it is (`mode`), whom it is linked to, and its rules. These say what may come
 * in from whom and what may go out to whom. The generated module `network` has the atoms, and these relations:
 *
 *   session          Participant -> Process      where its nodes run
 *   mode             Process -> Mode             what it is in the network; `brokering`: perhaps passes on between peers
 *   subject          Process -> Subject          whom its rules tell apart: `common_name`, `protocol`; none is any
 *   unproven, by_id  set Subject                 that ask for what nobody here knows; that ask for an id
 *   rule             Subject -> Rule             what policies give to each
 *   message, flow    Rule -> Kind, Flow          what it is about, by `expression`; `allow_rule`: those that allow
 *   unrestricted     set Process                 no access control is enabled, or what it says is not known
 *   default_allow    set Process                 what no rule is about passes
 *   judged_as_put    set Kind                    what rules about puts decide where it goes out (releases before 1.7)
 *   near, far        Link -> Process             from one process to another; `plain`: not encrypted
 *   sees, seen       Link -> View                what its near end knows of the far one, and the other way about
 *   holder, at       Reach -> Participant, Process    whoever goes without a file, linked to a process
 *   acts_as, known   Reach -> Mode, View         what it chose to be, and what the process knows of it
 *   known_name       View -> Name                the common name that was authenticated; `speaks`: the protocol
 *   uncontrolled     set View                    links on which no rule counts; `chosen`: who attacks chooses its id
 *   includes, meets  Expression -> Class         what has all keys of a class, and what has some key of its expression
 *   within           Expression -> Class         what lies in that, or in what is left out of the class
 *   everything       set Expression              what has all keys without verbatim chunks; `verbatim`: classes with some
 *   class, deed      Sending -> Class, Deed      what is sent; `wide`, `heard`: whoever sends attacks, whoever gets it does
 *   middle, first, last    set Sending           on the way, on the topics where a flow begins, and where it ends
 *   source, target, through, attacking, listening, outsider, unseen    set Participant
 */
module routing

/** An enclave, a process of none, or the outsider, who has no key. */
abstract sig Participant {}

/** Whoever starts with one file. */
abstract sig Process {}

/** A link, seen from one end. */
abstract sig Tie {}

/** Between two processes, with the files of both. */
abstract sig Link extends Tie {}

/** Between a process and somebody who goes without a file. */
abstract sig Reach extends Tie {}

/** What a process knows of the other end of a link. */
abstract sig View {}

/** Whom rules tell apart. */
abstract sig Subject {}

/** A rule of access control. */
abstract sig Rule {}

/** A key expression of rules. */
abstract sig Expression {}

/** The keys of one expression that no rule has by a narrower one. */
abstract sig Class {}

/** Something that somebody may send, of one class, in one way. */
abstract sig Sending {}

/** A common name of certificates. */
abstract sig Name {}

/** A protocol of links. */
abstract sig Protocol {}

/** What a process is. */
abstract sig Mode {}
/** One that passes on, with peers that are linked beside it, or clients that have it alone. */
one sig ROUTER, PEER, CLIENT extends Mode {}

/** A kind of message that carries data, or asks for it. */
abstract sig Kind {}
/** Data; who takes it; a request, its answer; who answers. */
one sig PUT, DELETE, SUBSCRIBE, QUERY, REPLY, SERVE extends Kind {}

/** Whether a rule is about what comes in or what goes out. */
abstract sig Flow {}
/** The two. */
one sig INGRESS, EGRESS extends Flow {}

/** Whether a message goes from who sends data or to it. */
abstract sig Way {}
/** The two. */
one sig AWAY, BACK extends Way {}

/** What somebody does to tell somebody something. */
abstract sig Deed {}
/** A sample, a deletion, a request of who serves, an answer to who asked. */
one sig PUBLISHED, DELETED, REQUESTED, REPLIED extends Deed {}
