"""Finds sentences that are hard to read: longer than 25 words, or with a word that has a plainer one.

`python tools/words.py [PART...] [PREFIX]` lists them, of all parts (docs, code, samples) and places or of those named.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tools.samples import catalogue  # noqa: E402

LONGEST: Final = 25
PLAINER: Final = {
    r"mend(s|ed|ing)?": "fix",
    r"whoever may": "who can",
    r"save (in|for|where|when)": "except",
    r"besides": "also",
    r"anew": "again",
    r"hence|thereof|therein|wherefore": "so",
    r"lest": "so that not",
    r"of (his|her) own": "its own",
    r"hangs on": "depends on",
}
_HARD: Final = [(re.compile(rf"\b(?:{word})\b", re.IGNORECASE), plain) for word, plain in PLAINER.items()]
_CODE: Final = re.compile(r"^ *```.*?^ *```|\x08.*?(?:\n\s*\n|\Z)", re.DOTALL | re.MULTILINE)  # \b: click's lists
_LINK: Final = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_LITERAL: Final = re.compile(r"`[^`\n]+`|<!--.*?-->")
_BLOCK: Final = re.compile(r"\n\s*\n|\n\s*(?:[-*] |\d+\. |#+ )|\|")
_COMMENT: Final = re.compile(r"(?:^[ \t]*#(?!!).*\n)+", re.MULTILINE)
_FILLED: Final = re.compile(r"\{([%{]).*?[%}]\}", re.DOTALL)
_TAG: Final = re.compile(r"<[^>]*>")
_END: Final = re.compile(r"(?<=[.!?])[)\"*]*\s+(?=[^a-z])")


def sentences(text: str) -> Iterator[str]:
    """Yield the sentences of Markdown or plain text: without code, a literal as one word, a cell of a table alone."""
    plain = _LITERAL.sub("X", _LINK.sub(r"\1", _CODE.sub("\n\n", text)))
    for block in _BLOCK.split("\n" + plain):
        for sentence in _END.split(" ".join(block.split())):
            if sentence and "$" not in sentence:  # a script that is written
                yield sentence


def hard(text: str) -> Iterator[str]:
    """Yield what is hard to read in a text, each as "reason: sentence"."""
    for sentence in sentences(text):
        words = sum(any(map(str.isalnum, word)) for word in sentence.split())
        if words > LONGEST:
            yield f"{words} words: {sentence}"
        for word, plain in _HARD:
            if found := word.search(sentence):
                yield f"{found[0]!r}, say {plain}: {sentence}"


def texts(part: str) -> Iterator[tuple[str, str]]:
    """Yield place and text of what is read in docs, code (strings, comments, tables, templates) or stories."""
    if part == "docs":
        for path in [*ROOT.glob("*.md"), *sorted(ROOT.glob("docs/*.md"))]:
            yield path.relative_to(ROOT).as_posix(), path.read_text("utf-8")
    elif part == "code":
        for path in sorted(ROOT.glob("keystore_audit/**/*.py")):
            source = path.read_text("utf-8")
            for line, text in (*_strings(ast.parse(source)), *_comments(source)):
                yield f"{path.relative_to(ROOT).as_posix()}:{line}", text
        for path in sorted(ROOT.glob("keystore_audit/**/*.j2")):
            yield path.relative_to(ROOT).as_posix(), _TAG.sub("\n\n", _FILLED.sub("X", path.read_text("utf-8")))
        table = ROOT / "keystore_audit" / "profiles" / "quirks.toml"
        for text in re.findall(r'"([^"\n]+ [^"\n]+)"', table.read_text("utf-8")):
            yield table.relative_to(ROOT).as_posix(), text
    elif part == "samples":
        for story in catalogue.stories():
            yield story.directory, story.text


def _strings(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and text of each string; what a formatted one fills in is one word."""
    if isinstance(node, ast.JoinedStr):
        yield node.lineno, "".join(str(part.value) if isinstance(part, ast.Constant) else "X" for part in node.values)
        return
    if isinstance(node, ast.Constant):
        if isinstance(node.value, str):
            yield node.lineno, node.value
        return
    for child in ast.iter_child_nodes(node):
        yield from _strings(child)


def _comments(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and text of comments on lines of their own, those that follow each other as one."""
    for found in _COMMENT.finditer(source):
        yield source.count("\n", 0, found.start()) + 1, re.sub(r"(?m)^[ \t]*# ?", "", found[0])


PARTS: Final = ("docs", "code", "samples")


def main() -> int:
    """List what is hard to read; return 1 where something is."""
    asked = [part for part in sys.argv[1:] if part in PARTS] or PARTS
    prefixes = tuple(word for word in sys.argv[1:] if word not in PARTS) or ("",)
    found = 0
    for part in asked:
        for place, text in texts(part):
            for complaint in hard(text) if place.startswith(prefixes) else ():
                found += 1
                print(f"{place}: {complaint}")
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
