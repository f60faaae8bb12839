/** Any application at all: the names of the generated module `nodes`, as free relations. */
module nodes
open keystore

abstract sig Node {}

sig AnyNode extends Node {
	runs_in: lone Enclave,
	publishes_to, subscribes_to: set Channel
}
