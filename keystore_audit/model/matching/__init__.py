"""How expressions match names: the languages of the implementations, as automata."""
