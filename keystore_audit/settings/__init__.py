"""What users assert of their keystore, and which findings they accept: settings and baselines (docs/settings.md)."""
