"""Where implementations decide differently about one keystore, and which line and which peculiarity is why."""
