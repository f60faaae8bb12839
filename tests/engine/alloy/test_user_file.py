"""Users' Alloy files are read as the Analyzer reads them, and refused where they could say something else."""

from __future__ import annotations

import tempfile
from pathlib import Path

import jpype
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from keystore_audit.engine.alloy.user_file import CONSISTENT, UserFile, read_user_file, read_user_files, vocabulary
from keystore_audit.errors import UsageError
from keystore_audit.findings import Severity
from keystore_audit.given import GivenFile
from keystore_audit.intent.source import Source
from tests.amount import tried
from tests.engine.alloy_batch import start_jvm

HEAD = "module asked\nopen keystore_audit\n"


def read(text: str, path: str = "dir/my_file.als") -> UserFile:
    return read_user_file(Source(file=GivenFile.of(path, b""), real="/dir/my_file.als", text=text))


def refused(text: str) -> str:
    with pytest.raises(UsageError) as caught:
        read(text)
    place, _, message = caught.value.message.partition(": ")
    assert place.startswith("dir/my_file.als:")
    assert len(message) > 15
    return f"{place.removeprefix('dir/my_file.als:')} {message}"


def test_commands_names_severities_and_statements_are_read() -> None:
    file = read(
        HEAD
        + "//@ enclave Arm = /arm/*\n//@ enclave Arm = /hand\n//@ topic Force = /force\n//@ topic Raw = dds:any\n"
        + "//@ severity NoForce = low\n//@ statement NoForce = Nothing – moves.\n"
        + "assert NoForce { no Arm }\ncheck NoForce for 0\nrun someArm { some Arm } for 0\n"
        + "run NoArm { no Arm } for 0 expect 0\ncheck OutsidersCannotRead for 0 expect 1"
    )
    assert [(a.id, a.kind, a.instance, a.severity, a.location.line) for a in file.commands] == [
        ("my-file-no-force", "check", False, Severity.LOW, 10),
        ("my-file-some-arm", "run", True, Severity.HIGH, 11),
        ("my-file-no-arm", "run", False, Severity.HIGH, 12),
        ("my-file-outsiders-cannot-read", "check", True, Severity.HIGH, 13),
    ]
    assert file.commands[0].statement == "Nothing – moves. (Alloy alone decides this.)"
    assert [(p.name, p.globs.enclaves, p.globs.topics, p.place) for p in file.places] == [
        ("Arm", ("/arm/*", "/hand"), (), "dir/my_file.als:3"),
        ("Force", (), ("rt/force",), "dir/my_file.als:5"),
        ("Raw", (), ("any",), "dir/my_file.als:6"),
    ]


def test_the_analyzer_is_given_the_users_own_lines() -> None:
    text = HEAD + "-- für\r\nrun A {} for 0 expect 1 -- expect\r\n"
    given_text = read(text).text
    assert given_text.startswith(HEAD + "-- f?r\nrun A {} for 0          -- expect\n")
    assert given_text.endswith(f"run {CONSISTENT} {{}} for 0\n")


REFUSED = {
    "fact { no Enclave }": "3 'fact'",
    "sig Mine {}": "3 'sig'",
    "one sig Mine extends Enclave {}": "3 'sig'",
    "enum Colour { Red }": "3 'enum'",
    "pred p { always some Enclave }": "3 'always'",
    "let two = Enclave": "3 expected one of the modules",
    "check A for 5": "3 expected `check NAME for 0`",
    "check A": "3 expected `check NAME for 0`",
    "check A for 0 but 3 Enclave": "3 'but'",
    "check { no Enclave } for 0": "3 expected `check NAME for 0`",
    "A: check { no Enclave } for 0": "3 expected one of the modules",
    "check A for 0 check A for 0": "3 a second command",
    "check A for 0 expect 2": "3 expected `check NAME for 0`",
    "assert A { #Enclave = TrustDomain }": "3 expected Alloy without texts, numbers",
    "assert A { some Enclave and 1 in TrustDomain }": "3 expected no numbers",
    "assert A { Int in none }": "3 'Int'",
    'assert A { some "x" }': "3 expected Alloy without texts",
    "assert A { some Enclave' }": "3 expected Alloy without texts",
    "assert A { some `x }": "3 expected Alloy without texts",
    "assert A { some Enclave": "3 expected `pred NAME { ... }`",
    "assert OutsidersCannotRead { }": "3 'OutsidersCannotRead' has a meaning",
    "fun may_write: Enclave { Enclave }": "3 'may_write' has a meaning",
    "fun acts_as: Enclave { Enclave }": "3 'acts_as' has a meaning",
    f"pred {CONSISTENT} {{}}": f"3 '{CONSISTENT}' has a meaning",
    "open keystore": "3 expected one of the modules",
    "open propagation": "3 expected one of the modules",
    "open util/ordering": "3 expected one of the modules",
    "open util/integer": "3 expected one of the modules",
    "open ../../etc/passwd": "3 expected one of the modules",
    "open keystore_audit/../x": "3 expected one of the modules",
    "module other/asked": "3 expected `module NAME`",
    "/**/ run A {} for 0": "3 expected Alloy without texts",
    "/* run A {} for 0": "3 expected Alloy without texts",
    "run A {} for 0 // x\rfact { no Enclave }": "3 expected no control character",
    "run A {} for 0 // x\u2028fact { no Enclave }": "3 expected no control character",
    "run A {} for 0\n//@ enclave Arm": "4 expected `//@ enclave Name",
    "run A {} for 0\n//@ enclaves Arm = /x": "4 expected `//@ enclave Name",
    "run A {} for 0\n//@ enclave Arm = x": "4 'x' is no enclave's path",
    "run A {} for 0\n//@ topic Arm = x": "4 'x' is no topic",
    "run A {} for 0\n//@ enclave arm = /x": "4 'arm' is no name",
    "run A {} for 0\n//@ enclave E0_arm = /x": "4 'E0_arm' is no name",
    "run A { some x, Enclave: none | x = x } for 0": "3 'Enclave' has a meaning",
    "run A { let Enclave = none | no Enclave } for 0": "3 'Enclave' has a meaning",
    "pred p[Enclave: none] { no Enclave } run A {} for 0": "3 'Enclave' has a meaning",
    "//@ enclave X = /x\nrun A { no { disj X, y: univ | X = y } } for 0": "4 'X' has a meaning",
    "run A {} for 0\n//@ enclave Enclave = /x": "4 'Enclave' has a meaning",
    "run A {} for 0\n//@ enclave ENCRYPT = /x": "4 'ENCRYPT' has a meaning",
    "run A {} for 0\n//@ enclave X = /x\n//@ topic X = /x": "5 'X' has a meaning",
    "run A {} for 0\n//@ severity B = low": "4 there is no command 'B'",
    "run A {} for 0\n//@ severity A = worst": "4 'worst' is no severity",
    "pred p {}": "1 expected a check or a run",
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_refused_is_said_with_its_line(text: str) -> None:
    assert refused(HEAD + text).startswith(REFUSED[text]), refused(HEAD + text)


@pytest.mark.parametrize(
    "formula",
    [
        "all x: Enclave, c: Channel | x = x and c = c",
        "all x: one Enclave, c: one Channel | x = x",
        "some l: Enclave - X, r: TrustDomain | some X.(feeds[r]) & l.(knows[r])",
        "let x = X, y = Enclave | x = y",
        "one Enclave and some granted[TrustDomain, publish_allowed]",
    ],
)
def test_words_of_the_vocabulary_are_no_variables_where_they_are_used(formula: str) -> None:
    assert read(f"{HEAD}//@ enclave X = /x\nrun A {{ {formula} }} for 0\n").commands != ()


def test_a_file_that_does_not_open_the_vocabulary_is_refused() -> None:
    assert "open keystore_audit" in refused("run A {} for 0\n")
    assert "open keystore_audit" in refused("")


def test_limits() -> None:
    many = "".join(f"run A{number} {{}} for 0\n" for number in range(51))
    assert "50 at most, found 51" in refused(HEAD + many)
    with pytest.raises(UsageError, match="larger than"):
        read(HEAD + "-" * 100_000)
    names = "".join(f"//@ enclave Name{number} = /x\n" for number in range(101))
    assert "more than 100 names" in refused(HEAD + "run A {} for 0\n" + names)


def test_ids_are_unique_over_files(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.als").write_text(HEAD + "run Twice {} for 0\n")
    with pytest.raises(UsageError, match=r"b/same.als:3: .*'same-twice', is taken at .*a/same.als:3"):
        read_user_files([tmp_path / "a" / "same.als", tmp_path / "b" / "same.als"])
    (tmp_path / "outsiders.als").write_text(HEAD + "run CannotRead {} for 0\n")
    with pytest.raises(UsageError, match="always decided"):
        read_user_files([tmp_path / "outsiders.als"])


def test_every_word_of_the_modules_is_vocabulary() -> None:
    words = vocabulary()
    assert {"may_write", "Enclave", "NONE", "SIGN_WITH_ORIGIN_AUTHENTICATION", "OutsidersCannotRead"} <= words
    assert {"written", "separated", "Outsider", "one_key", "GrantsAreEnforced"} <= words


PIECES = (
    "fact { no none }", "fact{}", "run A {} for 0", "run B {} for 0 expect 1", "/*", "*/", "/**", "/**/", "//", "--",
    "-->", "\n", "\r", " ", "*", "/", '"', "'", "\\", "x", "pred p {}", "{", "}", "/***/", "/*/", "<!--", "```", "---",
)  # fmt: skip


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
@settings(max_examples=tried(150), derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@example(pieces=["/**/", "fact { no none }", "/* */", "run A {} for 0"])
@example(pieces=["--", "\r", "fact { no none }", "\n", "run A {} for 0"])
@example(pieces=["/*/", "run A {} for 0", "/*", "*/", "fact{}", "/**", "*/"])
@given(pieces=st.lists(st.sampled_from(PIECES), max_size=12))
def test_what_is_taken_for_a_comment_is_one_to_the_analyzer(pieces: list[str]) -> None:
    """Whatever the reader takes, the Analyzer sees the same commands and no fact in it, or refuses it too."""
    text = "module asked\n" + " ".join(pieces) + "\n"
    try:
        file = read(text.replace("module asked", "module asked open keystore_audit"))
    except UsageError:
        return
    start_jvm()
    parse = jpype.JClass("edu.mit.csail.sdg.parser.CompUtil").parseEverything_fromFile
    with tempfile.TemporaryDirectory() as folder:
        main = Path(folder) / "asked.als"
        main.write_text(file.text.replace(" open keystore_audit", ""))
        try:
            world = parse(jpype.JClass("edu.mit.csail.sdg.alloy4.A4Reporter").NOP, None, str(main))
        except jpype.JException:
            return
        assert [str(command.label) for command in world.getAllCommands()] == [
            *(asked.name for asked in file.commands),
            CONSISTENT,
        ]
        assert world.getAllFacts().size() == 0
