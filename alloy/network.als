/**
 * The processes of a network and their rules, and a question about them, written by keystore-audit. Do not edit.
 */
module network
open routing

-- /keyboard
one sig Participant0 extends Participant {}
-- /multiplexer
one sig Participant1 extends Participant {}
-- /random
one sig Participant2 extends Participant {}
-- /turtlesim
one sig Participant3 extends Participant {}
-- /zenohd
one sig Participant4 extends Participant {}
-- outsider
one sig Participant5 extends Participant {}

-- networks/turtlesim_clients/keyboard.json5
one sig Process0 extends Process {}
-- networks/turtlesim_clients/multiplexer.json5
one sig Process1 extends Process {}
-- networks/turtlesim_clients/random.json5
one sig Process2 extends Process {}
-- networks/turtlesim_clients/turtlesim.json5
one sig Process3 extends Process {}
-- networks/turtlesim_clients/zenohd.json5
one sig Process4 extends Process {}

-- networks/turtlesim_clients/keyboard.json5
one sig Subject0 extends Subject {}
-- networks/turtlesim_clients/multiplexer.json5
one sig Subject1 extends Subject {}
-- networks/turtlesim_clients/random.json5
one sig Subject2 extends Subject {}
-- networks/turtlesim_clients/turtlesim.json5
one sig Subject3 extends Subject {}
-- networks/turtlesim_clients/zenohd.json5
one sig Subject4 extends Subject {}
-- networks/turtlesim_clients/zenohd.json5
one sig Subject5 extends Subject {}
-- networks/turtlesim_clients/zenohd.json5
one sig Subject6 extends Subject {}
-- networks/turtlesim_clients/zenohd.json5
one sig Subject7 extends Subject {}

-- of_the_router
one sig Rule0 extends Rule {}
-- graph
one sig Rule1 extends Rule {}
-- publish /keyboard ingress
one sig Rule2 extends Rule {}
-- publish /keyboard egress
one sig Rule3 extends Rule {}
-- publish /multiplexer ingress
one sig Rule4 extends Rule {}
-- publish /multiplexer egress
one sig Rule5 extends Rule {}
-- subscribe /multiplexer ingress
one sig Rule6 extends Rule {}
-- subscribe /multiplexer egress
one sig Rule7 extends Rule {}
-- publish /random ingress
one sig Rule8 extends Rule {}
-- publish /random egress
one sig Rule9 extends Rule {}
-- subscribe /turtlesim ingress
one sig Rule10 extends Rule {}
-- subscribe /turtlesim egress
one sig Rule11 extends Rule {}

-- networks/turtlesim_clients/keyboard.json5 to networks/turtlesim_clients/zenohd.json5
one sig Link0 extends Link {}
-- networks/turtlesim_clients/multiplexer.json5 to networks/turtlesim_clients/zenohd.json5
one sig Link1 extends Link {}
-- networks/turtlesim_clients/random.json5 to networks/turtlesim_clients/zenohd.json5
one sig Link2 extends Link {}
-- networks/turtlesim_clients/turtlesim.json5 to networks/turtlesim_clients/zenohd.json5
one sig Link3 extends Link {}
-- networks/turtlesim_clients/zenohd.json5 to networks/turtlesim_clients/keyboard.json5
one sig Link4 extends Link {}
-- networks/turtlesim_clients/zenohd.json5 to networks/turtlesim_clients/multiplexer.json5
one sig Link5 extends Link {}
-- networks/turtlesim_clients/zenohd.json5 to networks/turtlesim_clients/random.json5
one sig Link6 extends Link {}
-- networks/turtlesim_clients/zenohd.json5 to networks/turtlesim_clients/turtlesim.json5
one sig Link7 extends Link {}

-- /keyboard to networks/turtlesim_clients/zenohd.json5
one sig Reach0 extends Reach {}
-- /keyboard to networks/turtlesim_clients/zenohd.json5
one sig Reach1 extends Reach {}
-- /keyboard to networks/turtlesim_clients/zenohd.json5
one sig Reach2 extends Reach {}
-- /multiplexer to networks/turtlesim_clients/zenohd.json5
one sig Reach3 extends Reach {}
-- /multiplexer to networks/turtlesim_clients/zenohd.json5
one sig Reach4 extends Reach {}
-- /multiplexer to networks/turtlesim_clients/zenohd.json5
one sig Reach5 extends Reach {}
-- /random to networks/turtlesim_clients/zenohd.json5
one sig Reach6 extends Reach {}
-- /random to networks/turtlesim_clients/zenohd.json5
one sig Reach7 extends Reach {}
-- /random to networks/turtlesim_clients/zenohd.json5
one sig Reach8 extends Reach {}
-- /turtlesim to networks/turtlesim_clients/zenohd.json5
one sig Reach9 extends Reach {}
-- /turtlesim to networks/turtlesim_clients/zenohd.json5
one sig Reach10 extends Reach {}
-- /turtlesim to networks/turtlesim_clients/zenohd.json5
one sig Reach11 extends Reach {}
-- /zenohd to networks/turtlesim_clients/zenohd.json5
one sig Reach12 extends Reach {}
-- /zenohd to networks/turtlesim_clients/zenohd.json5
one sig Reach13 extends Reach {}
-- /zenohd to networks/turtlesim_clients/zenohd.json5
one sig Reach14 extends Reach {}
-- /zenohd to networks/turtlesim_clients/keyboard.json5
one sig Reach15 extends Reach {}
-- /zenohd to networks/turtlesim_clients/keyboard.json5
one sig Reach16 extends Reach {}
-- /zenohd to networks/turtlesim_clients/keyboard.json5
one sig Reach17 extends Reach {}
-- /zenohd to networks/turtlesim_clients/multiplexer.json5
one sig Reach18 extends Reach {}
-- /zenohd to networks/turtlesim_clients/multiplexer.json5
one sig Reach19 extends Reach {}
-- /zenohd to networks/turtlesim_clients/multiplexer.json5
one sig Reach20 extends Reach {}
-- /zenohd to networks/turtlesim_clients/random.json5
one sig Reach21 extends Reach {}
-- /zenohd to networks/turtlesim_clients/random.json5
one sig Reach22 extends Reach {}
-- /zenohd to networks/turtlesim_clients/random.json5
one sig Reach23 extends Reach {}
-- /zenohd to networks/turtlesim_clients/turtlesim.json5
one sig Reach24 extends Reach {}
-- /zenohd to networks/turtlesim_clients/turtlesim.json5
one sig Reach25 extends Reach {}
-- /zenohd to networks/turtlesim_clients/turtlesim.json5
one sig Reach26 extends Reach {}

-- /keyboard by tls
one sig View0 extends View {}
-- /zenohd by tls
one sig View1 extends View {}
-- /multiplexer by tls
one sig View2 extends View {}
-- /random by tls
one sig View3 extends View {}
-- /turtlesim by tls
one sig View4 extends View {}
-- /keyboard by tls
one sig View5 extends View {}
-- /multiplexer by tls
one sig View6 extends View {}
-- /random by tls
one sig View7 extends View {}
-- /turtlesim by tls
one sig View8 extends View {}
-- /zenohd by tls
one sig View9 extends View {}

-- 0\x2f**
one sig Class0 extends Class {}
-- @ros2_lv/0\x2f**
one sig Class1 extends Class {}
-- 0/high_priority\x2f*\x2f*
one sig Class2 extends Class {}
-- 0/move_turtle\x2f*\x2f*
one sig Class3 extends Class {}
-- 0/low_priority\x2f*\x2f*
one sig Class4 extends Class {}
-- **
one sig Class5 extends Class {}
-- **\x2f@adv\x2f**
one sig Class6 extends Class {}
-- **
one sig Class7 extends Class {}
-- **
one sig Class8 extends Class {}

-- 0\x2f**
one sig Expression0 extends Expression {}
-- @ros2_lv/0\x2f**
one sig Expression1 extends Expression {}
-- 0/high_priority\x2f*\x2f*
one sig Expression2 extends Expression {}
-- 0/move_turtle\x2f*\x2f*
one sig Expression3 extends Expression {}
-- 0/low_priority\x2f*\x2f*
one sig Expression4 extends Expression {}

-- PUBLISHED 0\x2f**
one sig Sending0 extends Sending {}
-- PUBLISHED 0\x2f**
one sig Sending1 extends Sending {}
-- PUBLISHED 0\x2f**
one sig Sending2 extends Sending {}
-- PUBLISHED 0\x2f**
one sig Sending3 extends Sending {}
-- DELETED 0\x2f**
one sig Sending4 extends Sending {}
-- DELETED 0\x2f**
one sig Sending5 extends Sending {}
-- PUBLISHED @ros2_lv/0\x2f**
one sig Sending6 extends Sending {}
-- PUBLISHED @ros2_lv/0\x2f**
one sig Sending7 extends Sending {}
-- PUBLISHED @ros2_lv/0\x2f**
one sig Sending8 extends Sending {}
-- PUBLISHED @ros2_lv/0\x2f**
one sig Sending9 extends Sending {}
-- DELETED @ros2_lv/0\x2f**
one sig Sending10 extends Sending {}
-- DELETED @ros2_lv/0\x2f**
one sig Sending11 extends Sending {}
-- PUBLISHED 0/high_priority\x2f*\x2f*
one sig Sending12 extends Sending {}
-- PUBLISHED 0/high_priority\x2f*\x2f*
one sig Sending13 extends Sending {}
-- PUBLISHED 0/high_priority\x2f*\x2f*
one sig Sending14 extends Sending {}
-- PUBLISHED 0/high_priority\x2f*\x2f*
one sig Sending15 extends Sending {}
-- DELETED 0/high_priority\x2f*\x2f*
one sig Sending16 extends Sending {}
-- DELETED 0/high_priority\x2f*\x2f*
one sig Sending17 extends Sending {}
-- PUBLISHED 0/move_turtle\x2f*\x2f*
one sig Sending18 extends Sending {}
-- PUBLISHED 0/move_turtle\x2f*\x2f*
one sig Sending19 extends Sending {}
-- PUBLISHED 0/move_turtle\x2f*\x2f*
one sig Sending20 extends Sending {}
-- PUBLISHED 0/move_turtle\x2f*\x2f*
one sig Sending21 extends Sending {}
-- DELETED 0/move_turtle\x2f*\x2f*
one sig Sending22 extends Sending {}
-- DELETED 0/move_turtle\x2f*\x2f*
one sig Sending23 extends Sending {}
-- PUBLISHED 0/low_priority\x2f*\x2f*
one sig Sending24 extends Sending {}
-- PUBLISHED 0/low_priority\x2f*\x2f*
one sig Sending25 extends Sending {}
-- PUBLISHED 0/low_priority\x2f*\x2f*
one sig Sending26 extends Sending {}
-- PUBLISHED 0/low_priority\x2f*\x2f*
one sig Sending27 extends Sending {}
-- DELETED 0/low_priority\x2f*\x2f*
one sig Sending28 extends Sending {}
-- DELETED 0/low_priority\x2f*\x2f*
one sig Sending29 extends Sending {}
-- PUBLISHED **
one sig Sending30 extends Sending {}
-- PUBLISHED **
one sig Sending31 extends Sending {}
-- PUBLISHED **
one sig Sending32 extends Sending {}
-- PUBLISHED **
one sig Sending33 extends Sending {}
-- DELETED **
one sig Sending34 extends Sending {}
-- DELETED **
one sig Sending35 extends Sending {}
-- PUBLISHED **\x2f@adv\x2f**
one sig Sending36 extends Sending {}
-- PUBLISHED **\x2f@adv\x2f**
one sig Sending37 extends Sending {}
-- PUBLISHED **\x2f@adv\x2f**
one sig Sending38 extends Sending {}
-- PUBLISHED **\x2f@adv\x2f**
one sig Sending39 extends Sending {}
-- DELETED **\x2f@adv\x2f**
one sig Sending40 extends Sending {}
-- DELETED **\x2f@adv\x2f**
one sig Sending41 extends Sending {}
-- REQUESTED **
one sig Sending42 extends Sending {}
-- REQUESTED **
one sig Sending43 extends Sending {}
-- REQUESTED **
one sig Sending44 extends Sending {}
-- REQUESTED **
one sig Sending45 extends Sending {}
-- REPLIED **
one sig Sending46 extends Sending {}
-- REPLIED **
one sig Sending47 extends Sending {}
-- REPLIED **
one sig Sending48 extends Sending {}
-- REPLIED **
one sig Sending49 extends Sending {}

-- /keyboard
one sig Name0 extends Name {}
-- /multiplexer
one sig Name1 extends Name {}
-- /random
one sig Name2 extends Name {}
-- /turtlesim
one sig Name3 extends Name {}
-- /zenohd
one sig Name4 extends Name {}

-- tls
one sig Protocol0 extends Protocol {}

fun session: Participant -> Process {
	Participant0 -> Process0
	+ Participant1 -> Process1
	+ Participant2 -> Process2
	+ Participant3 -> Process3
}

fun outsider: set Participant { Participant5 }

fun unseen: set Participant { none }

fun attacking: set Participant { Participant }

fun listening: set Participant { Participant }

fun source: set Participant { Participant3 }

fun target: set Participant { Participant2 }

fun through: set Participant { Participant4 }

fun mode: Process -> Mode {
	(Process0 + Process1 + Process2 + Process3) -> CLIENT
	+ Process4 -> ROUTER
}

fun subject: Process -> Subject {
	Process0 -> Subject0
	+ Process1 -> Subject1
	+ Process2 -> Subject2
	+ Process3 -> Subject3
	+ Process4 -> (Subject4 + Subject5 + Subject6 + Subject7)
}

fun brokering: set Process { none }

fun unrestricted: set Process { none }

fun default_allow: set Process { none }

fun rule: Subject -> Rule {
	(Subject0 + Subject1 + Subject2 + Subject3) -> Rule0
	+ Subject4 -> (Rule1 + Rule2 + Rule3)
	+ Subject5 -> (Rule1 + Rule4 + Rule5 + Rule6 + Rule7)
	+ Subject6 -> (Rule1 + Rule8 + Rule9)
	+ Subject7 -> (Rule1 + Rule10 + Rule11)
}

fun common_name: Subject -> Name {
	(Subject0 + Subject1 + Subject2 + Subject3) -> Name4
	+ Subject4 -> Name0
	+ Subject5 -> Name1
	+ Subject6 -> Name2
	+ Subject7 -> Name3
}

fun protocol: Subject -> Protocol { none -> none }

fun unproven: set Subject { none }

fun by_id: set Subject { none }

fun message: Rule -> Kind {
	Rule0 -> (PUT + SUBSCRIBE)
	+ (Rule2 + Rule4 + Rule7 + Rule8 + Rule11) -> PUT
	+ (Rule3 + Rule5 + Rule6 + Rule9 + Rule10) -> SUBSCRIBE
}

fun flow: Rule -> Flow {
	(Rule0 + Rule1) -> Flow
	+ (Rule2 + Rule4 + Rule6 + Rule8 + Rule10) -> INGRESS
	+ (Rule3 + Rule5 + Rule7 + Rule9 + Rule11) -> EGRESS
}

fun expression: Rule -> Expression {
	Rule0 -> (Expression0 + Expression1)
	+ Rule1 -> Expression1
	+ (Rule2 + Rule3) -> Expression2
	+ (Rule4 + Rule5 + Rule10 + Rule11) -> Expression3
	+ (Rule6 + Rule7) -> (Expression2 + Expression4)
	+ (Rule8 + Rule9) -> Expression4
}

fun allow_rule: set Rule { Rule }

fun near: Link -> Process {
	Link0 -> Process0
	+ Link1 -> Process1
	+ Link2 -> Process2
	+ Link3 -> Process3
	+ (Link4 + Link5 + Link6 + Link7) -> Process4
}

fun far: Link -> Process {
	(Link0 + Link1 + Link2 + Link3) -> Process4
	+ Link4 -> Process0
	+ Link5 -> Process1
	+ Link6 -> Process2
	+ Link7 -> Process3
}

fun sees: Link -> View {
	(Link0 + Link1 + Link2 + Link3) -> View1
	+ Link4 -> View0
	+ Link5 -> View2
	+ Link6 -> View3
	+ Link7 -> View4
}

fun seen: Link -> View {
	Link0 -> View0
	+ Link1 -> View2
	+ Link2 -> View3
	+ Link3 -> View4
	+ (Link4 + Link5 + Link6 + Link7) -> View1
}

fun plain: set Link { none }

fun holder: Reach -> Participant {
	(Reach0 + Reach1 + Reach2) -> Participant0
	+ (Reach3 + Reach4 + Reach5) -> Participant1
	+ (Reach6 + Reach7 + Reach8) -> Participant2
	+ (Reach9 + Reach10 + Reach11) -> Participant3
	+ ((Reach12 + Reach13 + Reach14 + Reach15 + Reach16 + Reach17 + Reach18) + (Reach19 + Reach20 + Reach21 + Reach22 + Reach23 + Reach24 + Reach25 + Reach26)) -> Participant4
}

fun at: Reach -> Process {
	((Reach0 + Reach1 + Reach2 + Reach3 + Reach4 + Reach5 + Reach6) + (Reach7 + Reach8 + Reach9 + Reach10 + Reach11 + Reach12 + Reach13 + Reach14)) -> Process4
	+ (Reach15 + Reach16 + Reach17) -> Process0
	+ (Reach18 + Reach19 + Reach20) -> Process1
	+ (Reach21 + Reach22 + Reach23) -> Process2
	+ (Reach24 + Reach25 + Reach26) -> Process3
}

fun acts_as: Reach -> Mode {
	((Reach0 + Reach3 + Reach6 + Reach9) + (Reach12 + Reach15 + Reach18 + Reach21 + Reach24)) -> ROUTER
	+ ((Reach1 + Reach4 + Reach7 + Reach10) + (Reach13 + Reach16 + Reach19 + Reach22 + Reach25)) -> PEER
	+ ((Reach2 + Reach5 + Reach8 + Reach11) + (Reach14 + Reach17 + Reach20 + Reach23 + Reach26)) -> CLIENT
}

fun known: Reach -> View {
	(Reach0 + Reach1 + Reach2) -> View5
	+ (Reach3 + Reach4 + Reach5) -> View6
	+ (Reach6 + Reach7 + Reach8) -> View7
	+ (Reach9 + Reach10 + Reach11) -> View8
	+ ((Reach12 + Reach13 + Reach14 + Reach15 + Reach16 + Reach17 + Reach18) + (Reach19 + Reach20 + Reach21 + Reach22 + Reach23 + Reach24 + Reach25 + Reach26)) -> View9
}

fun known_name: View -> Name {
	(View0 + View5) -> Name0
	+ (View1 + View9) -> Name4
	+ (View2 + View6) -> Name1
	+ (View3 + View7) -> Name2
	+ (View4 + View8) -> Name3
}

fun speaks: View -> Protocol { View -> Protocol0 }

fun uncontrolled: set View { none }

fun chosen: set View { (View5 + View6 + View7 + View8 + View9) }

fun verbatim: set Class { (Class1 + Class6) }

fun includes: Expression -> Class {
	Expression0 -> (Class0 + Class2 + Class3 + Class4)
	+ Expression1 -> Class1
	+ Expression2 -> Class2
	+ Expression3 -> Class3
	+ Expression4 -> Class4
}

fun meets: Expression -> Class {
	Expression0 -> (Class0 + Class2 + Class3 + Class4 + Class5 + Class7 + Class8)
	+ Expression1 -> Class1
	+ Expression2 -> (Class0 + Class2 + Class5 + Class7 + Class8)
	+ Expression3 -> (Class0 + Class3 + Class5 + Class7 + Class8)
	+ Expression4 -> (Class0 + Class4 + Class5 + Class7 + Class8)
}

fun within: Expression -> Class {
	Expression0 -> (Class0 + Class5 + Class7 + Class8)
	+ Expression1 -> Class1
	+ Expression2 -> (Class0 + Class2 + Class5 + Class7 + Class8)
	+ Expression3 -> (Class0 + Class3 + Class5 + Class7 + Class8)
	+ Expression4 -> (Class0 + Class4 + Class5 + Class7 + Class8)
}

fun everything: set Expression { none }

fun class: Sending -> Class {
	((Sending0 + Sending1 + Sending2 + Sending3 + Sending4 + Sending5) -> Class0
	+ (Sending6 + Sending7 + Sending8 + Sending9 + Sending10 + Sending11) -> Class1
	+ (Sending12 + Sending13 + Sending14 + Sending15 + Sending16 + Sending17) -> Class2
	+ (Sending18 + Sending19 + Sending20 + Sending21 + Sending22 + Sending23) -> Class3)
	+ ((Sending24 + Sending25 + Sending26 + Sending27 + Sending28 + Sending29) -> Class4
	+ (Sending30 + Sending31 + Sending32 + Sending33 + Sending34 + Sending35) -> Class5
	+ (Sending36 + Sending37 + Sending38 + Sending39 + Sending40 + Sending41) -> Class6
	+ (Sending42 + Sending43 + Sending44 + Sending45) -> Class7
	+ (Sending46 + Sending47 + Sending48 + Sending49) -> Class8)
}

fun deed: Sending -> Deed {
	(((Sending0 + Sending1 + Sending2 + Sending3 + Sending6 + Sending7 + Sending8) + (Sending9 + Sending12 + Sending13 + Sending14 + Sending15 + Sending18 + Sending19)) + ((Sending20 + Sending21 + Sending24 + Sending25 + Sending26 + Sending27 + Sending30) + (Sending31 + Sending32 + Sending33 + Sending36 + Sending37 + Sending38 + Sending39))) -> PUBLISHED
	+ ((Sending4 + Sending5 + Sending10 + Sending11 + Sending16 + Sending17 + Sending22) + (Sending23 + Sending28 + Sending29 + Sending34 + Sending35 + Sending40 + Sending41)) -> DELETED
	+ (Sending42 + Sending43 + Sending44 + Sending45) -> REQUESTED
	+ (Sending46 + Sending47 + Sending48 + Sending49) -> REPLIED
}

fun wide: set Sending { (((Sending2 + Sending3 + Sending4 + Sending5 + Sending8 + Sending9 + Sending10 + Sending11) + (Sending14 + Sending15 + Sending16 + Sending17 + Sending20 + Sending21 + Sending22 + Sending23)) + ((Sending26 + Sending27 + Sending28 + Sending29 + Sending32 + Sending33 + Sending34 + Sending35) + (Sending38 + Sending39 + Sending40 + Sending41 + Sending44 + Sending45 + Sending48 + Sending49))) }

fun heard: set Sending { (((Sending1 + Sending3 + Sending5 + Sending7 + Sending9 + Sending11) + (Sending13 + Sending15 + Sending17 + Sending19 + Sending21 + Sending23)) + ((Sending25 + Sending27 + Sending29 + Sending31 + Sending33 + Sending35) + (Sending37 + Sending39 + Sending41 + Sending43 + Sending45 + Sending47 + Sending49))) }

fun middle: set Sending { Sending }

fun first: set Sending { none }

fun last: set Sending { none }

fun judged_as_put: set Kind { none }
