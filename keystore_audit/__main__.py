"""`python -m keystore_audit` is the command `keystore-audit`."""

from keystore_audit.cli import main

if __name__ == "__main__":
    main()
