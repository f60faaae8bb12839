"""What is odd about the rules of documents: rules without effect, expressions without names, half a wiring."""
