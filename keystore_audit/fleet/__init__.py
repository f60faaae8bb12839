"""Many keystores in one run: found, compared with each other, audited side by side, each on its own."""
