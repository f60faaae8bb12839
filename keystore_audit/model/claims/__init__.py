"""What users say of a keystore, in their words, and what that means in one system (docs/settings.md)."""
