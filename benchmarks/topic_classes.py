"""Measures topic classes alone, of expressions as fleets have them, each case in a process of its own."""

from __future__ import annotations

import random
import resource
import subprocess
import sys
import time

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.matching.atoms import classify
from keystore_audit.model.matching.expression import parse
from keystore_audit.profiles import Matcher

FIXED = ["*", "rt/*", "rq/*Request", "rt/robot?/cmd_vel", "*/get_parameters*", "rt/*/_action/feedback", "*_tf"]
FIXED += ["rt/robot[0-9]/odom", "rt/[!r]*", "rr/*Reply"]
FORMS = ["rt/robot{}/*", "rq/robot{}/*Request", "rt/robot{}/cam?/image*", "*/node{}/odom", "rr/robot{}*Reply"]
PARAMETER_SERVICES = ("describe", "get", "get_types", "list", "set", "set_atomically")
CASES = {
    # name: expressions with wildcards, others, matchers
    "5,000 expressions, 50 of them with wildcards": (50, 4_950, ("posix",)),
    "the same for libc's two and Cyclone DDS at once": (50, 4_950, ("posix", "posix-noescape", "cyclonedds")),
    "the same for OpenDDS": (50, 4_950, ("opendds",)),
    "the same with 10 wildcards for all four at once": (10, 4_950, tuple(Matcher)),
    "10,000 enclaves, 150,000 expressions, 53 with wildcards": (53, 150_000, ("posix",)),
    "the same for the three of them at once": (53, 150_000, ("posix", "posix-noescape", "cyclonedds")),
}


def expressions(wildcards: int, others: int) -> list[str]:
    """Names as permissions of a fleet hold them, and wildcards as people write them."""
    random_ = random.Random(others)
    texts = FIXED[:wildcards] + [random_.choice(FORMS).format(number) for number in range(wildcards - len(FIXED))]
    for enclave in range(others // 15 + 1):
        node = f"robot{enclave // 10}/node{enclave % 10}"
        texts += [f"rt/{node}/odom", f"rt/{node}/image_raw", f"rt/{node}/status"]
        for service in PARAMETER_SERVICES:
            texts += [f"rq/{node}/{service}_parametersRequest", f"rr/{node}/{service}_parametersReply"]
    return texts[: wildcards + others]


def measure(name: str) -> str:
    """One line of the table, measured here."""
    wildcards, others, matchers = CASES[name]
    texts = expressions(wildcards, others)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.process_time()
    by_meaning = {}
    for matcher in map(Matcher, matchers):
        for text in texts:
            pattern = parse(text, matcher)
            by_meaning.setdefault((pattern.rewinds, pattern.pieces), pattern)
    patterns = list(by_meaning.values())
    parsed = time.process_time()
    try:
        count = str(len(classify(patterns)))
    except BudgetExceeded:
        count = "beyond the budget"
    done = time.process_time()
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return f"| {name} | {count} | {parsed - begin:.2f} | {done - parsed:.2f} | {memory:.0f} |"


def main() -> None:
    """Prints one row for each case, the best of three."""
    if len(sys.argv) > 1:
        print(measure(sys.argv[1]))
        return
    print("| what | classes | parsing, s CPU | classes, s CPU | MB |")
    print("|---|---|---|---|---|")
    for name in CASES:
        rows = [subprocess.run([sys.executable, __file__, name], capture_output=True, text=True).stdout for _ in "123"]
        print(min(rows, key=lambda row: float(row.split("|")[4])), end="", flush=True)


if __name__ == "__main__":
    main()
