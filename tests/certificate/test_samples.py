"""Certificates of all samples check, and damaged ones do not; `cannot_tell.txt` lists the samples without, and why.

What is asked about a sample is picked by chance: flows between its enclaves, who publishes its topics, and their
encryption. Of samples with the same files one is asked about. To write the list again:

    PYTHONPATH=. python -m tests.certificate.test_samples
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from itertools import permutations, product
from pathlib import Path
from random import Random
from typing import Final

import pytest
from msgspec.structs import replace

from keystore_audit.certificate import checking
from keystore_audit.certificate.checking import Checker, Encrypted, NoFlow, OnlyPublish, Property
from keystore_audit.certificate.errors import CannotTell, Refused
from keystore_audit.certificate.powers import OUTSIDER
from keystore_audit.certificate.reading import Store, read
from keystore_audit.profiles import DEFAULT
from keystore_audit.prove import prove
from tests.amount import SHARE, tried
from tests.certificate.asking import EVERY, damaged, reading, verdict

SAMPLES: Final = Path(__file__).resolve().parents[2] / "sample_keystores"
LISTED: Final = Path(__file__).with_name("cannot_tell.txt")
NOTHING: Final = "nothing that was asked holds"
PROPERTIES: Final = tried(5)
DAMAGES: Final = tried(100) if SHARE >= 1 else 3


def distinct() -> list[str]:
    """A sample of each content."""
    found: dict[str, str] = {}
    for path in sorted(SAMPLES.rglob("*.toml")):
        root = path.with_suffix("")
        files = sorted(each for each in root.rglob("*") if each.is_file())
        content = (f"{each.relative_to(root)} {sha256(each.read_bytes()).hexdigest()}" for each in files)
        if files:
            found.setdefault("\n".join(content), root.relative_to(SAMPLES).as_posix())
    return sorted(found.values())


def questions(store: Store, random: Random) -> list[Property]:
    """What can be asked there, in any order."""
    paths = [each.path for each in store.enclaves]
    writers: dict[str, list[str]] = {}
    for enclave in store.enclaves:
        for rule in (rule for grant in enclave.permissions.grants for rule in grant.rules if rule.allow):
            for topic in rule.publish:
                writers.setdefault(f"dds:{topic}", []).append(enclave.path)
    flows = [*permutations([*paths, OUTSIDER], 2), *product(writers, [OUTSIDER]), *product([OUTSIDER], writers)]
    asked: list[Property] = [NoFlow(*each, random.choice(("source", "relays", "relays"))) for each in flows]
    asked += [NoFlow(source, target, "honest") for source, target in flows if source != OUTSIDER]
    asked += [NoFlow(first, last, "relays", (middle,)) for first, middle, last in list(permutations(paths, 3))[:9]]
    for topic, who in writers.items():
        encrypted = (Encrypted(topic, against) for against in (OUTSIDER, "insider"))
        asked += [OnlyPublish(topic, tuple(dict.fromkeys(who))), *encrypted]
    random.shuffle(asked)
    return asked


def proved(sample: str, random: Random) -> Iterator[tuple[Checker, bytes]]:
    """Certificates of a sample, under some profiles. Raises CannotTell."""
    root, left = SAMPLES / sample, PROPERTIES
    asked = questions(checking.read(root), random)
    while left and asked:
        each, profiles = asked.pop(), tuple(random.sample(DEFAULT, random.choice((1, 1, 2, len(DEFAULT)))))
        given = replace(EVERY, profiles=profiles)
        try:
            content = prove(root, each, reading(profiles), given)[1]
        except Refused:
            continue
        if content is not None:
            yield Checker(root, each, given), content
            left -= 1


def told(sample: str) -> str:
    """Why a sample has no certificates, nothing if it has."""
    try:
        return "" if [*proved(sample, Random(sample))] else NOTHING
    except CannotTell as why:
        return str(why)


@pytest.mark.parametrize("sample", distinct())
def test_certificates_of_a_sample_check_and_damaged_ones_do_not(sample: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checking, "read", cache(read))
    listed = dict(line.split(": ", 1) for line in LISTED.read_text("utf-8").splitlines())
    random, why = Random(sample), listed.get(sample, "")
    if why and why != NOTHING:
        with pytest.raises(CannotTell, match=f"^{re.escape(why)}$"):
            next(proved(sample, random))
        return
    count = 0
    for checker, content in proved(sample, random):
        count += 1
        assert verdict(content, checker) == "accepted"
        for number, other in enumerate(damaged(content, random, DAMAGES)):
            assert verdict(other, checker) == "refused", number
    assert (count == 0) is (why == NOTHING)


if __name__ == "__main__":
    checking.read = cache(read)
    lines = [f"{sample}: {why}\n" for sample in distinct() if (why := told(sample))]
    LISTED.write_text("".join(lines), "utf-8")
