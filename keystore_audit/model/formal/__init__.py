"""What both engines are asked about, and what follows natively: rights, protection, flows (docs/model.md)."""
