"""What changed in meaning between two keystores: one module for each layer of changes (docs/diff.md)."""
