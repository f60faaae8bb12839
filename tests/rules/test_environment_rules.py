"""KA67x: an environment that makes the keystore void, each beside one that does not; and what picks the profiles."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from keystore_audit.errors import UsageError
from keystore_audit.findings import Result
from keystore_audit.intent.environment import Environment, read_environment
from keystore_audit.profiles import DEFAULT, VARIANTS, resolve, running
from tests.rules.evidence import healthy, judged

RIGHT = "ROS_SECURITY_ENABLE=true\nROS_SECURITY_STRATEGY=Enforce\nROS_SECURITY_KEYSTORE=/keys\n"

CASES = {
    "KA673": "ROS_SECURITY_ENCLAVE_OVERRIDE=/talker\n",
    "KA677": "ROS_DISTRO=galactic\n",
}
"""What one line more does to the right environment."""


def read(tmp_path: Path, text: str | bytes) -> Environment:
    file = tmp_path / "robot.env"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_environment(file)


@pytest.mark.parametrize(("profiles", "expected"), [("all", Result.OPEN), ("fastdds-2.6.4", Result.FAIL)])
def test_an_unknown_distribution_leaves_it_incomplete_unless_profiles_are_chosen(
    profiles: str, expected: Result, tmp_path: Path
) -> None:
    environment = read(tmp_path, RIGHT + CASES["KA677"])
    judgement = judged(healthy(), environment=environment, profiles=resolve([profiles]))
    (outcome,) = (each for each in judgement.outcomes if each.rule == "KA677")
    assert outcome.outcome is expected


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("ROS_DISTRO=humble", "humble"),
        ("export ROS_DISTRO='humble'  # so", "humble"),
        ('ROS_DISTRO="humble"', "humble"),
        ('export ROS_SECURITY_ENABLE="true"\nA=1\nexport ROS_DISTRO=humble', "humble"),
        ("ROS_DISTRO=jazzy\n\n# later\n ROS_DISTRO=humble", "humble"),
        ("export ROS_DISTRO=humble # a comment", "humble"),
        ("PATH=$PATH:/bin\nROS_DISTRO=humble", "humble"),
        ("A='foxy; x' # it's so\nB='-a -b x \"z\\\" z'\nC=${HOME}/$D/*.so:~\nROS_DISTRO=humble", "humble"),
        ("A='http://h/?a=1&b=2&SECONDS=5'\nB='<Log/>'\nexport C=\"$D/x\"\nROS_DISTRO=humble", "humble"),
        ("ROS_DISTRO=humble\nSHLVL=1\nOPTIND=2\nRANDOM=\nUID=1000 # me\nHISTSIZE=-1\nTMOUT='0'", "humble"),
        ("ROS_DISTRO=", ""),
        ("", ""),
    ],
)
def test_assignments_are_read(text: str, value: str, tmp_path: Path) -> None:
    assert read(tmp_path, text).value("ROS_DISTRO") == value


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ROS_DISTRO=humble\nif true; then", "robot.env:2: no assignment"),
        ("ROS_DISTRO=$(uname)", "robot.env:1: a value that only a shell could work out"),
        ("\nROS_DISTRO=`id`", "robot.env:2: a value"),
        ('ROS_DISTRO="$HOME"', "robot.env:1: a value"),
        ("ROS_DISTRO=a b", "robot.env:1: a value"),
        ("ROS_DISTRO='humble", "robot.env:1: a value"),
        ("ROS_DISTRO=humble # a comment", "robot.env:1: a comment"),
        ("ROS_SECURITY_ENABLE=true ", "robot.env:1: blanks behind a value"),
        ('ROS_SECURITY_ENABLE="true"\t', "robot.env:1: blanks behind a value"),
        ('ROS_SECURITY_ENABLE="true"', "robot.env:1: quotes, which `docker run`"),
        ("\nROS_SECURITY_STRATEGY='Enforce'", "robot.env:2: quotes, which `docker run`"),
        ("ROS_SECURITY_STRATEGY=Enforce\nexport ROS_SECURITY_ENABLE=true", "robot.env:2: some lines have export"),
        ("export ROS_DISTRO=humble\nexport A=1\nROS_DOMAIN_ID=5", "robot.env:3: some lines have export"),
        ("ROS_SECURITY_ENABLE=true\nROS_SECURITY_STRATEGY=Enforce\nexport A=1", "robot.env:3: some lines have export"),
        ("ROS_DISTRO=humble\r\n", "robot.env:1: a carriage return"),
        ("ROS_DISTRO=humble\u00a0", "robot.env:1: a value"),
        ("A=1 ROS_DISTRO=humble", "robot.env:1: more than one assignment"),
        ("A=1; unset ROS_DISTRO", "robot.env:1: more than one assignment"),
        ("A=1; . /etc/robot", "robot.env:1: more than one assignment"),
        ("A=1;source ./weaken", "robot.env:1: more than one assignment"),
        ("A=1 source ./weaken", "robot.env:1: more than one assignment"),
        ("A= 'source' ./weaken", "robot.env:1: more than one assignment"),
        ("A=1 B=2 C=3 eval x", "robot.env:1: more than one assignment"),
        ("A=1 >/dev/null source ./weaken", "robot.env:1: more than one assignment"),
        ("A=1&&return", "robot.env:1: more than one assignment"),
        ("A=a;b", "robot.env:1: more than one assignment"),
        ("A=`id`", "robot.env:1: more than one assignment"),
        ('A=$(echo "a)");export ROS_DISTRO=humble "b"', "robot.env:1: more than one assignment"),
        ('A="$(echo "a)");export ROS_DISTRO=humble "b"', "robot.env:1: more than one assignment"),
        ("A=$(\nROS_DISTRO=humble\nB=1)", "robot.env:1: more than one assignment"),
        ("A=1 <<B=2\nROS_DISTRO=humble\nB=2", "robot.env:1: more than one assignment"),
        ('A="${ROS_DISTRO:=humble}"', "robot.env:1: more than one assignment"),
        ("A=$ROS_DISTRO", "the name of a variable that counts"),
        ("A='ROS_DISTRO=foxy; x'", "the name of a variable that counts"),
        ("A=http://h/?a=1&b=2", "robot.env:1: more than one assignment"),
        ("B=-a -b", "robot.env:1: more than one assignment"),
        ("A=$'\\'';export ROS_DISTRO=humble;B=''''", "robot.env:1: "),
        ("A=$'\\'''\nROS_DISTRO=humble\nB=$'\\'''", "robot.env:1: more than one assignment"),
        ("A=1\u00a0#'\nROS_DISTRO=humble\nB=1\u00a0#'", "robot.env:1: more than one assignment"),
        ("A=1 B=2\u00a0-c source ./weaken", "robot.env:1: more than one assignment"),
        ('export A=1 ROS_"DISTRO"=humble', "robot.env:1: more than one assignment"),
        ("A=1\\\nROS_DISTRO=humble", "robot.env:1: a line that goes on"),
        ("# a comment \\\nROS_DISTRO=humble", "robot.env:1: a line that goes on"),
        ('A="x\nROS_DISTRO=humble\nB=x"', "robot.env:1: more than one assignment"),
        ("BASH_ENV=/etc/robot", "robot.env:1: bash runs"),
        ("A=1 B=2 BASH_ENV=/etc/robot", "robot.env:1: more than"),
        ("A=x&BASH_ENV=/etc/robot", "robot.env:1: more than"),
        ("PROMPT_COMMAND='unset x'", "robot.env:1: bash runs"),
        ("LD_PRELOAD=/tmp/x.so", "robot.env:1: every process loads what LD_PRELOAD names"),
        ("export LD_LIBRARY_PATH=/tmp", "robot.env:1: every process loads"),
        ("PYTHONPATH=/tmp", "robot.env:1: Python runs"),
        ("OPENSSL_CONF='/tmp/openssl.cnf'", "robot.env:1: OpenSSL loads"),
        ("FAKETIME=-2y", "robot.env:1: FAKETIME is another clock"),
        ("RANDOM='DISTRO=0'", "robot.env:1: RANDOM is a number"),
        ("OPTIND=$X", "robot.env:1: OPTIND is a number"),
        ("A=1 RANDOM='ROS_DISTRO=0'", "robot.env:1: more than"),
        ("A=1;B=2;OPTIND='ROS_DISTRO=0'", "robot.env:1: more than"),
        ("A=1 RANDOM=1\tSRANDOM='ROS_DISTRO=0'", "robot.env:1: more than"),
        (b"A=1\n\xff", "robot.env:2: this is not UTF-8"),
        (b"#" * (1024 * 1024 + 1), "larger than"),
    ],
)
def test_what_only_a_shell_could_tell_is_an_error(text: str | bytes, said: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError) as caught:
        read(tmp_path, text)
    assert said in caught.value.message


@pytest.mark.parametrize(
    ("distribution", "middleware", "expected"),
    [
        ("humble", "rmw_fastrtps_cpp", ("fastdds-2.6",)),
        ("humble", "rmw_cyclonedds_cpp", ("cyclonedds-0.10",)),
        ("jazzy", "", ("fastdds-2.14", "cyclonedds-0.10")),
        ("", "rmw_cyclonedds_cpp", ("cyclonedds-0.10", "cyclonedds-11")),
        ("", "", DEFAULT),
        ("foxy", "", tuple(VARIANTS)),
        ("all", "", tuple(VARIANTS)),
        ("galactic", "rmw_cyclonedds_cpp", tuple(name for name in VARIANTS if name.startswith("cyclonedds-"))),
    ],
)
def test_the_variants_that_run(distribution: str, middleware: str, expected: tuple[str, ...]) -> None:
    assert running(distribution, middleware) == expected


SIGNS = "'\"\\$`();&|<> \u00a0=-#{}!a1"
WORDS = ("ROS_DISTRO=x", "export ", "unset ", "${", ":=", "$(", "$'", "<<a", "eval ", ". ", "# ")
SHELLS_OWN = re.findall(
    r"\w+",
    """
    BASH BASHOPTS BASHPID BASH_ARGV0 BASH_COMMAND BASH_COMPAT BASH_SUBSHELL COLUMNS DIRSTACK EPOCHSECONDS EUID
    FUNCNAME GROUPS HISTCMD HISTSIZE HOME IFS LANG LC_ALL LINENO LINES MAILCHECK OPTERR OPTIND PATH
    POSIXLY_CORRECT PPID PS4 PWD RANDOM REPLY SECONDS SHELLOPTS SHLVL SRANDOM TMOUT UID _
    """,
)
PIECES = st.sampled_from([*SIGNS, *WORDS])


@settings(max_examples=400)
@given(name=st.sampled_from(["A", *SHELLS_OWN]), value=st.lists(PIECES, max_size=9).map("".join), export=st.booleans())
@example(name="RANDOM", value="'ROS_DISTRO=0'", export=False)
@example(name="A", value="1 RANDOM='ROS_DISTRO=0'", export=False)
@example(name="A", value="1;RANDOM='ROS_DISTRO=0'", export=False)
@example(name="HISTCMD", value="\xa0", export=False)
@example(name="OPTIND", value="09", export=False)
@example(name="SRANDOM", value="-", export=False)
def test_a_shell_has_what_was_read(
    name: str, value: str, export: bool, oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """What precedes and follows the line of another variable is what bash has, or the line is refused."""
    folder = tmp_path_factory.mktemp("shell")
    line = f"{'export ' if export else ''}{name}={value}"
    try:
        read(folder, f"ROS_DISTRO=humble\n{line}\nROS_DOMAIN_ID=3\n")
    except UsageError:
        return
    script = '. ./robot.env >/dev/null 2>&1; printf %s "$ROS_DISTRO $ROS_DOMAIN_ID"'
    command = [oracle("bash"), "--noprofile", "--norc", "-c", script]
    done = subprocess.run(command, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, timeout=10)
    assert done.stdout == b"humble 3"
