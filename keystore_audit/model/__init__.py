"""What the documents mean: one normalised model. Nothing here opens a file."""
