"""What real sessions refuse in a file, what an expression is, and what it holds: asked of the wheel."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random
from typing import Any

import pytest
import zenoh

from keystore_audit.model.matching import key_expressions
from keystore_audit.zenoh.configuration import read_configuration
from tests.amount import tried

RULE = {"id": "r", "messages": ["put"], "permission": "allow", "key_exprs": ["0/a"]}
SUBJECT = {"id": "s"}
POLICY = {"rules": ["r"], "subjects": ["s"]}


def section(**changed: Any) -> str:
    whole = {"enabled": True, "rules": [RULE], "subjects": [SUBJECT], "policies": [POLICY]} | changed
    return json.dumps({"access_control": {name: value for name, value in whole.items() if value != "left out"}})


def ruled(**changed: Any) -> str:
    rule = {name: value for name, value in (RULE | changed).items() if value != "left out"}
    return section(rules=[rule])


OPENED = "yes"
FILES = {
    "G00": (section(), True),
    "G01": (section(policies=[{"rules": ["nope"], "subjects": ["s"]}]), False),
    "G02": (section(policies=[{"rules": ["r"], "subjects": ["nope"]}]), False),
    "G03": (section(rules=[RULE, RULE]), False),
    "G04": (section(subjects=[SUBJECT, SUBJECT]), False),
    "G05": (section(policies=[{"id": "p"} | POLICY, {"id": "p"} | POLICY]), False),
    "G06": (section(rules=[], policies=[]), True),
    "G07": (section(rules="left out"), False),
    "G08": (section(rules=None, subjects=None, policies=None), False),
    "G10": (ruled(flows=[]), False),
    "G11": (ruled(key_exprs=[]), False),
    "G12": (ruled(messages=[]), False),
    "G13": (ruled(messages="left out"), False),
    "G14": (ruled(permission="Allow"), False),
    "G15": (ruled(messages=["get"]), False),
    "G16": (section(defualt_permission="deny"), False),
    "G17": (ruled(actions=["put"]), False),
    "G18": (section(subjects=[{"id": "s", "cert_common_name": ["/a"]}]), False),
    "G20": ('{"transport": {"link": {"tls": {"enable_mTLS": true}}}}', False),
    "no policies": (section(policies=[]), True),
    "G26": (section(policies=[{"rules": [], "subjects": ["s"]}]), False),
    "G27": (ruled(key_exprs=["0/foo*/**"]), False),
    "G28": (ruled(key_exprs=["0//a"]), False),
    "G29": (ruled(key_exprs=["**/**"]), False),
    "G30": ('{"access_control": {"enabled": true, "enabled": false}}', False),
    "G31": ('{"access_control": {"enabled": false, "enabled": true}}', False),
    "G33": ('{"access_control": {"enabled": false}, "access_control": {}}', False),
    "G32": ('{"mode": "peer", "mode": "peer"}', False),
    "G35": (section(subjects=[{"id": " "}], policies=[{"rules": ["r"], "subjects": [" "]}]), False),
    "G36": ('{"access_control": null}', False),
    "G37": (ruled(interfaces=["lo"]), False),
    "G38": ('{"access_control": {"enabled": "true"}}', False),
    "B19": (section(subjects=[{"id": "s", "cert_common_names": []}]), False),
    "B20": (section(subjects=[{"id": "s", "cert_common_names": [""]}]), False),
    "off": (section(enabled=False, rules=[RULE, RULE]), True),
    "null flows": (ruled(flows=None), True),
    "free": ('{"metadata": {"a": 1, "a": [2]}}', True),
    "mode": ('{"mode": "Peer"}', False),
    "endpoint": ('{"listen": {"endpoints": ["tcp"]}}', False),
    "of no mode": ('{"connect": {"endpoints": {"foo": ["tcp/127.0.0.1:1"]}}}', False),
    "protocols": ('{"listen": {"endpoints": ["tcp/[::1]:0"]}, "transport": {"link": {"protocols": ["tls"]}}}', False),
    "id": ('{"id": "xyz"}', False),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_file_starts_a_session_or_is_refused_by_both(name: str) -> None:
    text, starts = FILES[name]
    assert really_starts(text) is starts
    assert read_configuration(text).starts is starts


def really_starts(text: str) -> bool:
    try:
        configuration = zenoh.Config.from_json5(text)
        configuration.insert_json5("scouting/multicast/enabled", "false")
        if "listen" not in text:
            configuration.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
        zenoh.open(configuration).close()
    except zenoh.ZError:
        return False
    return True


def known(name: str) -> dict[str, Any]:
    from keystore_audit.zenoh import configuration

    found: dict[str, Any] = json.loads(Path(configuration.__file__).with_name("fields.json").read_text())[name]
    return found


SAMPLES = {
    "b": (True,), "n": (1, 16384), "l": ([],), "o": ({},), "z": (None,),
    "s": ("x", "peer", "tcp/127.0.0.1:7447", "ff", "allow", "lazy", "8bit", "0/a", "put", "tls", "ingress",
          "224.0.0.224:7446", "always", "current_exe_parent", "32bit"),
}  # fmt: skip


def wrapped(path: str, value: object) -> str:
    for name in reversed(path.split("/")):
        value = [value] if name == "[]" else {name: value}
    return json.dumps(value)


def test_every_field_takes_what_the_newest_release_takes() -> None:
    """By kind of value; of objects and lists, and of what hangs on other fields, the files above ask."""
    wrong = {}
    fields, needed = known("fields"), known("needed")
    dependent = {"transport/auth/usrpwd/user", "transport/auth/usrpwd/password"}
    for path, kinds in fields.items():
        if any(path.startswith(each) for each in needed) or path in dependent:
            continue
        taken = {kind for kind, values in SAMPLES.items() if any(accepted(wrapped(path, v)) for v in values)}
        if not taken - {"o", "l"} <= {*kinds} | ({*SAMPLES} if "*" in kinds else set()):
            wrong[path] = f"takes {taken}, the table has {kinds}"
        elif not {*kinds} & {"b", "n", "s"} <= taken:
            wrong[path] = f"the table has {kinds}, it takes {taken}"
    assert wrong == {}
    assert len(fields) > 200


def accepted(text: str) -> bool:
    try:
        zenoh.Config.from_json5(text)
    except zenoh.ZError:
        return False
    return True


PIECES = (
    "*",
    "**",
    "a",
    "b",
    "ab",
    "@a",
    "@",
    "a$*",
    "$*b",
    "a$*b",
    "$*a$*",
    "@a$*",
    "$*",
    "a*",
    "$",
    "a$*$*b",
    "",
    "?",
)


def expression(text: str) -> Any:
    try:
        return zenoh.KeyExpr(text)
    except zenoh.ZError:
        return None


def test_expressions_are_valid_and_hold_each_other_as_there() -> None:
    chance = Random(tried(7))
    compared = 0
    for _ in range(tried(100_000)):
        texts = ["/".join(chance.choices(PIECES, k=chance.randint(1, 5))) for _ in range(2)]
        real = [expression(text) for text in texts]
        assert [bool(key_expressions.wrong_with(text)) for text in texts] == [each is None for each in real], texts
        if None not in real:
            compared += 1
            assert key_expressions.includes(*texts) == real[0].includes(real[1]), texts
            assert key_expressions.intersects(*texts) == real[0].intersects(real[1]), texts
    assert compared > 1000


TEXTS = (
    "1", "+1", "-1", ".5", "5.", "012", "0x1F", "1e3", "Infinity", "-NaN", "123456789012345678901234567890",
    "9223372036854775807", "9223372036854775808", "'a'", '"a"', "'a\\\nb'", "'a\nb'", "'\\x41'", "'\\u0041'",
    "'\\q'", "'\\0'", "'\\01'", "'\\1'", "'\u2028'", "true", "True", "null", "undefined", "[1,]", "[,]", "[1,,2]",
    "[1 2]", "{a:1,}", "{,}", "{a:1 b:2}", "{'a':1}", "{a-b:1}", "{1:2}", "{$_:1}", "{\\u0061:1}", "{a:1,a:2}",
    "{a:{}}", "{}x", "/*c*/1", "//c\n1", "1//c", "/*", "", "[", "\ufeff1", "\u00a01", "{null:1}", "{true:1}", "{é:1}",
    "'\\\r\nb'", "1 2",
)  # fmt: skip


@pytest.mark.parametrize("text", TEXTS)
def test_json5_is_read_where_it_is_read_there(text: str) -> None:
    whole = f"{{metadata:{text}}}"
    assert (not read_configuration(whole).refusals) is accepted(whole)


def test_a_text_by_chance_is_json5_for_both_or_for_neither() -> None:
    chance = Random(tried(11))
    signs = ["{", "}", "[", "]", ",", ":", "a", "'b'", "1", "-", ".", "/*x*/", "//y\n", "\n", '"c"', "null", "\\", "'"]
    for _ in range(tried(50_000)):
        text = "{metadata:" + "".join(chance.choices(signs, k=chance.randint(1, 8))) + "}"
        assert (not read_configuration(text).refusals) is accepted(text), text
