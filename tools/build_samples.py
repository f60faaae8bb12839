"""Builds `sample_keystores/`, checks it against the stories, or notes what the tool finds in it."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tools.samples import catalogue, expectation  # noqa: E402
from tools.samples.compare import differences, same  # noqa: E402
from tools.samples.store import Tree, read, write  # noqa: E402
from tools.samples.story import Story, description_of, read_description  # noqa: E402

SAMPLES = ROOT / "sample_keystores"


def build(story: Story, samples: Path = SAMPLES) -> None:
    """Write `story` below `samples`; a signed document that says the same already stays as it is."""
    sample = samples / story.directory
    committed: Tree = read(sample) if sample.is_dir() else {}
    tree = {
        path: committed[path]
        if path in committed and same(path, committed[path], entry, by_meaning=story.by_meaning)
        else entry
        for path, entry in story.tree.items()
    }
    expected = read_description(sample)
    if sample.is_dir():
        shutil.rmtree(sample)
    write(tree, sample, story.key_mode)
    description_of(sample).write_text(story.description(expected), "utf-8")
    for path, content in story.beside.items():
        (samples / path).parent.mkdir(parents=True, exist_ok=True)
        (samples / path).write_bytes(content)


def check(story: Story, samples: Path = SAMPLES) -> list[str]:
    """What differs between `story`, built anew in a temporary folder, and what stands below `samples`."""
    sample = samples / story.directory
    if not sample.is_dir():
        return [f"{story.directory}: is missing"]
    with tempfile.TemporaryDirectory() as folder:
        rebuilt = Path(folder) / "sample"
        write(story.tree, rebuilt, story.key_mode)
        found = differences(read(sample), read(rebuilt), by_meaning=story.by_meaning)
        lines = [f"{story.directory}/{line}" for line in found]
    description = description_of(sample)
    wanted = story.description(read_description(sample))
    if not description.is_file() or description.read_text("utf-8") != wanted:
        lines.append(f"{story.directory}.toml: differs from the story")
    for path, content in story.beside.items():
        if not (samples / path).is_file() or (samples / path).read_bytes() != content:
            lines.append(f"{path}: differs from the story")
    return lines


HAND_WRITTEN = ("alloy_properties", "environments", "graphs", "launch", "policies", "settings", "suppressions")
"""Folders beside the keystores: what systems are meant to be, compared with the keystores by tests/intent."""


def leftovers() -> list[str]:
    """Directories and descriptions that no story builds."""
    known = {SAMPLES / story.directory for story in catalogue.stories()}
    beside = {SAMPLES / path for story in catalogue.stories() for path in story.beside}
    built = (
        known
        | beside
        | {folder for file in beside for folder in file.parents}
        | {description_of(sample) for sample in known}
        | {SAMPLES / "README.md"}
    )
    built |= {folder for sample in known for folder in sample.parents}
    known |= {SAMPLES / folder for folder in HAND_WRITTEN}
    built |= known
    return [
        f"{place.relative_to(SAMPLES)}: no story builds it"
        for place in sorted(SAMPLES.rglob("*"))
        if place not in built and known.isdisjoint(place.parents)
    ]


def expect(story: Story) -> None:
    """Audit the sample of `story` and write the findings into its description."""
    sample = SAMPLES / story.directory
    description_of(sample).write_text(story.description(expectation.audit(sample)), "utf-8")


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with a fresh build, write nothing")
    parser.add_argument("--expect", action="store_true", help="audit each sample and write its expected findings")
    parser.add_argument(
        "--only", metavar="GLOB", default="*", help="directories below sample_keystores, e.g. 'rules/KA2*'"
    )
    options = parser.parse_args()
    wrong: list[str] = [] if options.only != "*" or not options.check else leftovers()
    for story in catalogue.stories(options.only):
        if options.check:
            wrong += check(story)
        elif options.expect:
            expect(story)
        else:
            build(story)
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
