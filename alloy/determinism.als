/**
 * Observational determinism of declared forwards: two runs side by side.
 *
 * A user declares a *forward* of an enclave: what comes on some topics it publishes on others, as it came. Enclaves
 * that have forwards publish nothing else. (Topics and samples: see `dds_security`.) What is *high* is secret, or
 * not to be relied on; what is on *low* topics is seen.
 *
 * Where somebody says what nodes do, more can be asked than where data can get to. The question is whether the inputs
 * alone decide what is seen on some topics, whatever the scheduler does and whatever comes on high inputs. Two runs of
 * one system get the same inputs, but for those that are `free`; what is seen of them must be the same.
 *
 * Time goes in rounds. In each, every forward with samples in its slots takes one and publishes it, and inputs come.
 * After it, each slot has the newest sample that reached it in the round, else what it had, unless that was taken.
 * Of several samples that reach a slot in one round, any may be the newest: DDS keeps the order of one writer only.
 *
 * Two values are enough, since nodes pass on what they get without looking at it. Two values that differ may have these
 * two names, and every other value one of them. The bound is not complete by itself. It is with as many steps as there
 * are rounds until no new pair of states comes; keystore-audit gives that number to each command.
 *
 * This module stands alone. The atoms are `one sig`s of the main file, which keystore-audit writes with its commands.
 * `two_runs implies always alike` is checked, and a run of `two_runs` in which eventually something `shows` must exist.
 * Without atoms, the module speaks of every system within a scope.
 */
module determinism

/** What a sample says. */
abstract sig Value {}
/** Two things that it may say. */
one sig One, Another extends Value {}

/** A topic on which something depends. */
abstract sig Topic {}
/** A topic on which everything is seen. */
abstract sig Low extends Topic {}

/** Somebody who publishes: `on` which topics, and the slots in which it arrives. */
abstract sig Writer { on: set Topic, reaches: set Slot }
/** Something from outside: what a node without declared forwards may publish on a topic. */
abstract sig Input extends Writer {}
/** A declared forward, with a slot for each topic that it subscribes to. */
abstract sig Forward extends Writer {}
/** A forward that takes the first of its slots in which a sample waits. */
abstract sig ByPriority extends Forward {}
/** A forward that takes any of them. */
abstract sig InAnyOrder extends Forward {}

/** Where the newest sample of a topic waits; `behind`: the slots that stand before it in the list of its forward. */
abstract sig Slot { of: one Forward, behind: set Slot }

/** One of the two runs: what waits, what is published in this round, and which slots are emptied. */
abstract sig Run {
	var waiting: Slot -> Value,
	var sent: Writer -> Value,
	var taken: set Slot
}
/** The two that are compared. */
one sig Left, Right extends Run {}

/** Slots in which a sample waits. */
fun ready[side: Run]: set Slot { side.waiting.Value }

/** Every forward takes one sample, if one waits, and publishes it; nobody publishes two on one topic in a round. */
pred acts[side: Run] {
	side.taken in ready[side]
	all forward: Forward | some of.forward & ready[side] implies one of.forward & side.taken
	all slot: side.taken & of.ByPriority | no slot.behind & ready[side]
	all forward: Forward | side.sent[forward] = (of.forward & side.taken).(side.waiting)
	all input: Input | lone side.sent[input]
}

/** After the round, each slot has one of the samples that reached it, else what nobody took from it. */
pred delivers[side: Run] {
	all slot: Slot | let came = (reaches.slot).(side.sent), has = slot.(side.waiting') |
		some came implies (one has and has in came) else has = (slot - side.taken).(side.waiting)
}

/** Two runs, from empty slots on; now and then both rest, which shows nothing new, so that every trace can end. */
pred two_runs[free: set Input] {
	no waiting
	always {
		all side: Run | acts[side]
		all input: Input - free | Left.sent[input] = Right.sent[input]
		(all side: Run | delivers[side]) or (waiting' = waiting and sent' = sent and taken' = taken)
	}
}

/** Writers that are seen. */
fun watched: set Writer { on.Low }

/** What is seen of the two runs in this round is the same. */
pred alike { watched <: Left.sent = watched <: Right.sent }

/** Something is seen at all. */
pred shows { some watched <: Left.sent }
