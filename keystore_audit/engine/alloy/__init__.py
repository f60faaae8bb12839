"""The real Alloy Analyzer, run as a child process."""
