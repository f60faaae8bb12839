"""What processes of the middleware that routes let through, by the files that they start with (docs/zenoh.md)."""
