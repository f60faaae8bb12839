"""Reads a keystore and returns evidence: what is there, who signed it, what each parser reads.

Nothing here gives a verdict. An expired certificate parses fine, and whether a signer may sign
is the answer of `keystore_audit.model.trust.verdicts`.
"""
