"""Who alone may publish: what the keystore grants to somebody else, what anybody can do, and who could forge."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from tests.cli.keystores import AT, answer, document_of, grant_of, keystore, properties, rule, signed_keystore
from tests.keystore.builder import GOVERNANCE, authority, certificate, crl, write_enclave

SETTINGS = """single_writer = ["/x"]
[[property]]
name = "only-talker"
only_publish = { topic = "/x", enclaves = "/talker" }
"""
PROFILE = ("--profile", "cyclonedds-11")
OPEN = (
    GOVERNANCE.replace(b">ENCRYPT<", b">NONE<")
    .replace(b">SIGN<", b">NONE<")
    .replace(b"<allow_unauthenticated_participants>false", b"<allow_unauthenticated_participants>true")
)


def built(root: Path, *, ghost: str = "", governance: bytes = GOVERNANCE, path: str = "/ghost") -> Path:
    """`ghost`: the rules that the talker's document has for somebody who is no enclave here, by the name of `path`."""
    talker = document_of(grant_of("/talker", rule(("rt/x",))), grant_of(path, ghost) if ghost else "")
    listener = document_of(grant_of("/listener", rule((), ("rt/x",))))
    return signed_keystore(root, {"/talker": talker, "/listener": listener}, governance=governance)


def found(root: Path) -> dict[str, Any]:
    every = properties(root, SETTINGS, *PROFILE)
    return {name: every[name] for name in ("only-talker", "single-writer-x")}


@pytest.mark.parametrize(("ghost", "status"), [("rt/x", "violated"), ("rt/y", "holds")])
def test_a_grant_for_a_subject_that_no_enclave_has_counts(tmp_path: Path, ghost: str, status: str) -> None:
    answers = found(built(tmp_path / "keys", ghost=rule((ghost,))))
    assert {each["status"] for each in answers.values()} == {status}
    told = answers["only-talker"]["profiles"]["cyclonedds-11"]["counterexample"]
    if status == "violated":
        assert "CN=/ghost" in told["text"]
        step = told["steps"][0]
        assert step["path"] == "enclaves/talker/permissions.p7s"
        assert f"{step['path']}:{step['line']}" in told["text"]


def test_a_grant_after_one_for_the_same_subject_does_not_count(tmp_path: Path) -> None:
    """The first grant that names a subject decides, whoever has it."""
    talker = grant_of("/talker", rule(("rt/x",)))
    denied, allowed = (grant_of("/ghost", rule((each,))) for each in ("rt/y", "rt/x"))
    for grants, status in (((denied, allowed), "holds"), ((allowed, denied), "violated")):
        root = signed_keystore(tmp_path / status, {"/talker": document_of(talker, *grants)})
        assert found(root)["only-talker"]["status"] == status


@pytest.mark.parametrize(("governance", "status"), [(OPEN, "violated"), (GOVERNANCE, "holds")])
def test_where_anybody_joins_and_is_heard_anybody_publishes(tmp_path: Path, governance: bytes, status: str) -> None:
    answers = found(built(tmp_path / "keys", governance=governance))
    assert {each["status"] for each in answers.values()} == {status}
    told = answers["only-talker"]["profiles"]["cyclonedds-11"]["counterexample"]
    assert told is None if status == "holds" else told["text"].startswith("Anybody on the network may join")


@pytest.mark.parametrize(
    ("off", "status"), [(("join", "write"), "violated"), (("join", "read"), "holds"), (("write", "read"), "holds")]
)
def test_where_no_grant_is_asked_for_whoever_has_an_identity_publishes(
    tmp_path: Path, off: tuple[str, ...], status: str
) -> None:
    """The only enclave of this keystore is not the only one that its identity CA vouches for."""
    governance = GOVERNANCE
    for each in off:
        flag = f"enable_{each}_access_control>".encode()
        governance = governance.replace(b"<" + flag + b"true", b"<" + flag + b"false")
    answers = found(keystore(tmp_path / "keys", {"/talker": (rule(("rt/x",)),)}, governance=governance))
    assert {each["status"] for each in answers.values()} == {status}
    told = answers["only-talker"]["profiles"]["cyclonedds-11"]["counterexample"]
    assert told is None if status == "holds" else "Anybody with an identity of the CA may publish" in told["text"]


@pytest.mark.parametrize(
    ("profile", "status"), [("cyclonedds-0.10", "violated"), ("fastdds-2.9", "violated"), ("cyclonedds-11", "holds")]
)
@pytest.mark.parametrize("one", [True, False])
def test_whoever_has_an_identity_of_the_one_ca_signs_itself_the_right(
    tmp_path: Path, profile: str, status: str, *, one: bool
) -> None:
    """No other enclave need be in this keystore, and no grant for anybody else."""
    identity = authority("sros2CA")
    permissions = identity if one else authority("permissionsCA")
    document = document_of(grant_of("/talker", rule(("rt/x",))))
    directory = tmp_path / "keys/enclaves/talker"
    write_enclave(directory, certificate("/talker", identity), document, identity, permissions, GOVERNANCE)
    asked = properties(tmp_path / "keys", SETTINGS, "--profile", profile)["only-talker"]
    assert asked["status"] == (status if one else "holds")
    told = asked["profiles"][profile]["counterexample"]
    if asked["status"] == "violated":
        assert "Anybody with an identity of the CA that is fit to sign may publish /x" in told["text"]
        assert told["steps"][0]["path"] == "enclaves/talker/identity_ca.cert.pem"


@pytest.mark.parametrize(
    ("profile", "off", "status"),
    [("opendds", "write", "violated"), ("cyclonedds-11", "write", "holds"), ("opendds", "read", "holds")],
)
def test_who_joins_by_a_grant_that_is_over_publishes_where_nobody_asks_for_one(
    tmp_path: Path, profile: str, off: str, status: str
) -> None:
    """To OpenDDS dates are about endpoints alone, and without access control no grant is asked for an endpoint."""
    flag = f"enable_{off}_access_control>".encode()
    governance = GOVERNANCE.replace(b"<" + flag + b"true", b"<" + flag + b"false")
    talker = grant_of("/talker", rule(("rt/x",)))
    ghost = grant_of("/ghost", rule(("rt/x",))).replace("2034-", "2025-")
    document = document_of(talker, ghost)
    root = signed_keystore(tmp_path / "keys", {"/talker": document}, governance=governance)
    assert properties(root, SETTINGS, "--profile", profile)["only-talker"]["status"] == status


def unread(root: Path, who: str, file: str, *others: str) -> Path:
    """A keystore in which one file of an enclave is too large to be read. `others`: who publishes beside the talker."""
    enclaves = {path: (rule(("rt/x",)),) for path in ("/talker", *others)}
    keystore(root, {**enclaves, "/listener": (rule((), ("rt/x",)),)})
    place = root / "enclaves" / who / file
    (root / "enclaves/talker.old.pem").write_bytes((root / "enclaves/talker/cert.pem").read_bytes())
    place.write_bytes(b"#" * 5_000_000)
    return root


FILES = ["cert.pem", "identity_ca.cert.pem", "permissions_ca.cert.pem", "governance.p7s"]


@pytest.mark.parametrize("file", FILES)
def test_that_a_publisher_was_not_read_is_no_proof_that_another_publishes(tmp_path: Path, file: str) -> None:
    """The grant of the one enclave that may publish was taken for a stranger's."""
    answers = found(unread(tmp_path / "keys", "talker", file))
    assert {each["status"] for each in answers.values()} == {"unknown"}


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("who", ["talker", "third"])
def test_what_another_is_granted_is_proof_whoever_was_not_read(tmp_path: Path, who: str, file: str) -> None:
    answers = found(unread(tmp_path / "keys", who, file, "/third"))
    assert {each["status"] for each in answers.values()} == {"violated"}
    told = answers["only-talker"]["profiles"]["cyclonedds-11"]["counterexample"]["text"]
    by_path = who == "talker" or file != "cert.pem"
    assert told.startswith("/third may publish" if by_path else "Whoever is CN=/third, which is no enclave that could")


def test_whom_an_unread_document_names_is_no_certificate_that_happens_to_be_there(tmp_path: Path) -> None:
    """The text named the identity CA, and said that it had a grant."""
    root = unread(tmp_path / "keys", "talker", "governance.p7s")
    every = properties(root, '[[property]]\nname = "all"\nonly_publish = { topic = "/x", enclaves = "/*" }\n')
    asked_for = every["all"]
    assert asked_for["status"] == "unknown"
    told = {each["counterexample"]["text"] for each in asked_for["profiles"].values()}
    unread_files = "enclaves/talker/governance.p7s, a CA file could not be read."
    assert told == {f"It cannot be ruled out for /x (topic) in domain 0: {unread_files}"}
    assert [each for each in asked_for["forgers"] if "CA" in each] == []


@pytest.mark.parametrize("profile", ["spec", "fastdds-3.6", "cyclonedds-11"])
@pytest.mark.parametrize(("topic", "status"), [("rt/x", "violated"), ("rt/y", "holds")])
def test_who_has_a_longer_name_than_an_enclave_is_not_that_enclave(
    tmp_path: Path, topic: str, status: str, profile: str
) -> None:
    """Cyclone DDS takes a grant of CN=/talker/arm for one of CN=/talker too: it was taken to be the enclave's alone."""
    root = built(tmp_path / "keys", ghost=rule((topic,)), path="/talker/arm")
    every = properties(root, SETTINGS, "--profile", profile)
    for name in ("only-talker", "single-writer-x"):
        assert every[name]["status"] == status
        told = every[name]["profiles"][profile]["counterexample"]
        assert told is None or told["text"].startswith("Whoever is CN=/talker/arm, which is no enclave of this")


def with_ghost(root: Path, *, taken: bool = True, revoked: bool = False, publisher: str = "/talker") -> Path:
    """The talker's document also grants the topic to a subject that an enclave has.

    `taken`: by its peers, since their authority issued its certificate. `publisher`: whom the first grant names.
    """
    identity, permissions = authority("identityCA"), authority("permissionsCA")
    grant = grant_of("/ghost", rule(("rt/x",)))
    talker = grant_of(publisher, rule(("rt/x",)))
    reader = document_of(grant_of("/ghost", rule((), ("rt/x",))))
    issuer = identity if taken else authority("another CA")
    ghost = certificate("/ghost", issuer)
    for path, own, document in (
        ("/talker", certificate("/talker", identity), document_of(talker, grant)),
        ("/ghost", ghost, reader),
    ):
        directory = root / "enclaves" / path.strip("/")
        write_enclave(directory, own, document, identity, permissions, GOVERNANCE)
        if revoked:
            revocations = crl(identity, [ghost.certificate.serial_number])
            (directory / "crl.pem").write_bytes(revocations.public_bytes(Encoding.PEM))
    return root


BOTH = """single_writer = ["/x"]
[[property]]
name = "only-talker"
only_publish = { topic = "/x", enclaves = "/talker" }
[[property]]
name = "ghost-too"
only_publish = { topic = "/x", enclaves = ["/talker", "/ghost"] }
"""


@pytest.mark.parametrize("refused", [{"taken": False}, {"revoked": True}])
@pytest.mark.parametrize("profile", ["spec", "cyclonedds-11"])
def test_an_enclave_that_peers_refuse_is_not_who_the_grant_names(
    tmp_path: Path, refused: dict[str, bool], profile: str
) -> None:
    """Another robot may have the subject with a certificate that they take, and so may whom the settings allow."""
    every = properties(with_ghost(tmp_path / "keys", **refused), BOTH, "--profile", profile)
    told = every["only-talker"]["profiles"][profile]["counterexample"]["text"]
    assert told.startswith("Whoever is CN=/ghost other than /ghost, whose certificate peers refuse, may publish /x")
    statuses = {name: every[name]["status"] for name in ("only-talker", "single-writer-x", "ghost-too")}
    assert statuses == {"only-talker": "violated", "single-writer-x": "violated", "ghost-too": "holds"}


@pytest.mark.parametrize(
    ("enclaves", "linked", "status"),
    [("/*", True, "unknown"), ("/*", False, "violated"), ("/listener", True, "violated")],
)
def test_who_may_be_behind_a_link_is_no_stranger_for_certain(
    tmp_path: Path, enclaves: str, linked: bool, status: str
) -> None:
    """Where a pattern may mean it. An enclave that is named is there."""
    listener = grant_of("/listener", rule((), ("rt/x",)))
    hidden = grant_of("/hidden", rule(("rt/x",)))
    root = signed_keystore(tmp_path / "keys", {"/listener": document_of(listener, hidden)})
    if linked:
        (root / "enclaves/hidden").symlink_to(tmp_path)
    every = properties(root, SETTINGS.replace("/talker", enclaves), *PROFILE)
    assert every["only-talker"]["status"] == status
    assert every["single-writer-x"]["status"] == ("unknown" if linked else "violated")


@pytest.mark.parametrize(
    ("profile", "path", "named"),
    [
        ("cyclonedds-11", "/talker/arm", {"CN=/talker/arm": "CN=/talker"}),
        ("cyclonedds-0.10", "/arm", {"CN=/arm": "CN=/"}),
        ("fastdds-3.6", "/talker/arm", {}),
    ],
)
def test_whose_subject_is_made_of_parts_of_a_grants_is_said_beside(
    tmp_path: Path, profile: str, path: str, named: dict[str, str]
) -> None:
    """Whether the CA vouches for such a one elsewhere no keystore says: it holds."""
    root = keystore(tmp_path / "keys", {path: (rule(("rt/x",)),)})
    asked = properties(root, SETTINGS.replace('"/talker"', f'"{path}"'), "--profile", profile)["only-talker"]
    assert asked["status"] == "holds"
    assert asked["also_named"] == named


def test_who_is_named_by_parts_may_be_here_and_the_first_grant_decides(tmp_path: Path) -> None:
    """An enclave of such a subject violates it. The first grant that names a subject decides about it."""
    arm = grant_of("/talker/arm", rule(("rt/x",)))
    settings = SETTINGS.replace('"/talker"', '"/talker/arm"')
    both = {"/talker": (rule((), ("rt/z",)),), "/talker/arm": (rule(("rt/x",)),)}
    root = keystore(tmp_path / "here", both)
    asked = properties(root, settings, *PROFILE)["only-talker"]
    assert (asked["status"], asked["also_named"]) == ("violated", {"CN=/talker/arm": "CN=/"})
    before = grant_of("/", rule((), ("rt/z",)))
    denied = signed_keystore(tmp_path / "keys", {"/talker/arm": document_of(before, arm)})
    asked = properties(denied, settings, *PROFILE)["only-talker"]
    assert asked["also_named"] == {"CN=/talker/arm": "CN=/talker"}
    first = grant_of("/talker/leg", rule((), ("rt/z",)))
    shared = signed_keystore(tmp_path / "more", {"/talker/arm": document_of(first, arm)})
    asked = properties(shared, settings, *PROFILE)["only-talker"]
    assert asked["also_named"] == {}


def test_of_two_publishers_that_were_not_read_nobody_knows_that_they_are_two(tmp_path: Path) -> None:
    root = unread(tmp_path / "keys", "talker", "cert.pem", "/third")
    (root / "enclaves/third/cert.pem").write_bytes(b"#" * 5_000_000)
    assert {each["status"] for each in found(root).values()} == {"unknown"}


def test_the_one_writer_may_be_who_is_refused_here(tmp_path: Path) -> None:
    """Whoever has its subject is one, wherever it runs."""
    root = with_ghost(tmp_path / "keys", taken=False, publisher="/ghost")
    assert properties(root, BOTH, *PROFILE)["single-writer-x"]["status"] == "holds"


def test_an_outsider_that_only_forges_is_said_beside_and_violates_nothing(tmp_path: Path) -> None:
    closed = OPEN.replace(b"<allow_unauthenticated_participants>true", b"<allow_unauthenticated_participants>false")
    answers = found(built(tmp_path / "keys", governance=closed))
    assert {each["status"] for each in answers.values()} == {"holds"}
    assert {tuple(each["forgers"]) for each in answers.values()} == {("/listener", "anybody on the network")}


@pytest.mark.parametrize("spelling", ["CN=/talker", 'CN="/talker"', "CN=/talker,"])
def test_an_enclave_that_a_grant_names_in_other_words_is_nobody_else(tmp_path: Path, spelling: str) -> None:
    talker = grant_of("/talker", rule(("rt/x",))).replace("CN=/talker", spelling)
    root = signed_keystore(tmp_path / "keys", {"/talker": document_of(talker)})
    every = properties(root, SETTINGS, "--profile", "fastdds-3.6")
    assert every["only-talker"]["status"] == "holds"


@pytest.mark.parametrize("form", ["text", "html", "markdown", "junit"])
def test_who_could_forge_is_said_where_the_property_holds(tmp_path: Path, form: str) -> None:
    root = built(tmp_path / "keys")
    assert found(root)["only-talker"]["forgers"] == ["/listener"]
    words = ("--engine", "native", "--at", AT, *PROFILE, "--settings", tmp_path / "keystore-audit.toml", "-f", form)
    text = " ".join(answer("audit", root, *words, *(["-v"] if form == "text" else []))[1].replace("\\", "").split())
    assert text.count("These could pose as a permitted publisher: /listener, with the keys they hold.") == 2
