"""The schemas of what the program reads and writes, for the tests of both."""

from __future__ import annotations

import json
from functools import cache

import jsonschema

from keystore_audit import resources


@cache
def schema(name: str) -> jsonschema.Draft202012Validator:
    """What a file of this sort is held against."""
    found = json.loads((resources.schemas() / f"{name}.schema.json").read_text("utf-8"))
    jsonschema.Draft202012Validator.check_schema(found)
    return jsonschema.Draft202012Validator(found)
