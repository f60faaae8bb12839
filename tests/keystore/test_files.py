"""Files of an untrusted directory: what is read, what is refused, and that nothing outside is ever opened."""

from __future__ import annotations

import hashlib
import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore import descent, root
from keystore_audit.keystore.files import EntryKind, File, Status
from keystore_audit.keystore.layout import discover
from keystore_audit.keystore.root import MAX_FILE_BYTES, Root
from tests.keystore.builder import authority


@pytest.fixture
def keystore(tmp_path: Path) -> Path:
    """A directory with a neighbour that nobody may read."""
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside/secret").write_bytes(b"secret")
    path = tmp_path / "keystore"
    (path / "public").mkdir(parents=True)
    (path / "enclaves/talker").mkdir(parents=True)
    (path / "public/ca.cert.pem").write_bytes(b"the certificate")
    return path


def read(path: Path, relative: bytes | str) -> File:
    with Root.open(path) as opened:
        return opened.file(relative)


@pytest.mark.parametrize(
    ("target", "status"),
    [
        ("../../public/ca.cert.pem", Status.PRESENT),
        ("../../public/./ca.cert.pem", Status.PRESENT),
        ("..//../public//ca.cert.pem", Status.PRESENT),
        ("{root}/public/ca.cert.pem", Status.PRESENT),
        ("{root}/enclaves/../public/ca.cert.pem", Status.PRESENT),
        ("../../../keystore/public/ca.cert.pem", Status.PRESENT),  # leaves and comes back
        ("../../public/hop", Status.PRESENT),
        ("../../public/absolute", Status.PRESENT),
        ("../../pub/ca.cert.pem", Status.PRESENT),  # over a link to a directory, but its real path is inside
        ("../../public/ca.cert.pem/", Status.DANGLING),
        ("../../public/ca.cert.pem/..", Status.DANGLING),
        ("../../public/ca.cert.pem/x", Status.DANGLING),
        ("../../public/none", Status.DANGLING),
        ("x" * 300, Status.UNREADABLE),  # ENAMETOOLONG
        ("link.pem", Status.LOOP),
        ("../../public/circle", Status.LOOP),
        ("../..", Status.DIRECTORY),
        ("../../public", Status.DIRECTORY),
        ("../../public/", Status.DIRECTORY),
        ("../../public/.", Status.DIRECTORY),
        ("/etc/passwd", Status.OUTSIDE),
        ("/dev/zero", Status.OUTSIDE),
        ("/", Status.OUTSIDE),
        ("../../../outside/secret", Status.OUTSIDE),
        ("../../../outside/none", Status.OUTSIDE),
        ("../../..", Status.OUTSIDE),
        ("../../../keystore2/ca.cert.pem", Status.OUTSIDE),
        ("{root}/../outside/secret", Status.OUTSIDE),
        ("{root}2/ca.cert.pem", Status.OUTSIDE),
        ("../../public/escape", Status.OUTSIDE),
        ("../../out/secret", Status.OUTSIDE),
    ],
)
def test_links_are_followed_inside_only(keystore: Path, target: str, status: Status) -> None:
    os.symlink("ca.cert.pem", keystore / "public/hop")
    os.symlink(f"{keystore}/public/ca.cert.pem", keystore / "public/absolute")
    os.symlink("../public/circle2", keystore / "public/circle")
    os.symlink("circle", keystore / "public/circle2")
    os.symlink("../../outside/secret", keystore / "public/escape")
    os.symlink("../outside", keystore / "out")
    os.symlink("public", keystore / "pub")
    target = target.format(root=keystore)
    link = keystore / "enclaves/talker/link.pem"
    os.symlink(target, link)
    file = read(keystore, "enclaves/talker/link.pem")
    assert (file.status, file.link) == (status, target)
    if status is Status.PRESENT:
        assert (file.resolved, file.content) == ("public/ca.cert.pem", b"the certificate")
        assert file.place == os.path.relpath(link.resolve(), keystore)
    else:
        assert (file.resolved, file.content, file.sha256) == (None, None, None)
        assert file.detail
        assert "secret" not in str(file.content)


def test_the_kernel_agrees_where_links_lead(keystore: Path) -> None:
    """Whatever a chain of links looks like, it ends where realpath(3) says, if that is inside."""
    seen: set[Status] = set()

    ends = ("public/ca.cert.pem", "ca.cert.pem", "public/c", "b", "enclaves/talker/a", "public", "talker/../talker/a")
    ends += ("keystore/public/ca.cert.pem", "public/ca.cert.pem/.", "./public/../b", "none", "outside/secret", "/c")
    target = st.tuples(st.booleans(), st.integers(0, 4), st.sampled_from(ends))

    @settings(max_examples=300, deadline=None, derandomize=True)
    @given(st.tuples(target, target, target))
    def check(targets: tuple[tuple[bool, int, str], ...]) -> None:
        links = [keystore / "enclaves/talker/a", keystore / "b", keystore / "public/c"]
        for link, (absolute, ups, end) in zip(links, targets, strict=True):
            link.unlink(missing_ok=True)
            os.symlink((f"{keystore}/" if absolute else "") + "../" * ups + end, link)
        file = read(keystore, "enclaves/talker/a")
        seen.add(file.status)
        real = os.path.realpath(links[0])
        inside = real == str(keystore) or real.startswith(f"{keystore}/")
        try:
            content: bytes | None = links[0].read_bytes()
        except OSError:
            content = None
        assert file.content == (content if inside else None)
        if file.status is Status.PRESENT:
            assert file.resolved == os.path.relpath(real, keystore)
        if file.status is Status.DIRECTORY:
            assert os.path.isdir(real)
        if file.status in (Status.DANGLING, Status.LOOP):
            assert not links[0].exists()

    check()
    assert {Status.PRESENT, Status.DANGLING, Status.DIRECTORY, Status.LOOP, Status.OUTSIDE} <= seen


def test_a_root_reached_over_a_link_is_the_root_for_absolute_links_too(keystore: Path) -> None:
    alias = keystore.parent / "alias"
    os.symlink("keystore", alias)
    for number, spelling in enumerate((keystore, alias)):
        os.symlink(f"{spelling}/public/ca.cert.pem", keystore / f"absolute{number}")
    for number in (0, 1):
        assert read(alias, f"absolute{number}").status is Status.PRESENT
    assert read(keystore, "absolute1").status is Status.OUTSIDE  # a robot may have no such alias


def test_links_to_directories_are_never_a_way(keystore: Path) -> None:
    os.symlink("public", keystore / "pub")
    os.symlink("../outside", keystore / "out")
    with Root.open(keystore) as opened:
        for relative in ("pub/ca.cert.pem", "out/secret"):
            file = opened.file(relative)
            assert file.status is Status.UNREADABLE
            assert "links to directories are not followed" in file.detail
        for relative in ("pub", "out"):
            listing = opened.entries(relative)
            assert (listing.directory.status, listing.entries) == (Status.UNREADABLE, ())
        for relative in ("../outside/secret", "public/../../outside/secret"):
            assert opened.file(relative).status is Status.OUTSIDE


def test_forty_links_are_followed_and_no_more(keystore: Path) -> None:
    chain = ["../public/ca.cert.pem", *(f"link{number}" for number in range(41))]
    for number, target in enumerate(chain):
        os.symlink(target, keystore / f"enclaves/link{number}")
    with Root.open(keystore) as opened:
        assert opened.file("enclaves/link39").content == (keystore / "enclaves/link39").read_bytes()
        assert opened.file("enclaves/link40").status is Status.LOOP
    with pytest.raises(OSError, match="Too many levels"):
        (keystore / "enclaves/link40").read_bytes()


def test_only_regular_files_are_opened(keystore: Path) -> None:
    """A pipe that nobody writes to would be waited for as long as pytest's `faulthandler_timeout` lets a test run."""
    os.mkfifo(keystore / "fifo")
    with socket.socket(socket.AF_UNIX) as server:
        here = Path.cwd()
        os.chdir(keystore)  # a socket's path has at most 107 characters
        try:
            server.bind("socket")
        finally:
            os.chdir(here)
        os.symlink("fifo", keystore / "link")
        with Root.open(keystore) as opened:
            for relative, words in (("fifo", "named pipe"), ("socket", "socket"), ("link", "named pipe")):
                file = opened.file(relative)
                assert file.status is Status.SPECIAL
                assert words in file.detail
            assert opened.file("public").status is Status.DIRECTORY
            assert opened.file("").status is Status.DIRECTORY


@pytest.mark.skipif(os.geteuid() != 0, reason="only root makes device files")
def test_devices_are_not_opened(keystore: Path) -> None:
    try:
        os.mknod(keystore / "zero", 0o600 | 0o020000, os.makedev(1, 5))
    except PermissionError:
        pytest.skip("this container lets nobody make device files")
    assert read(keystore, "zero").status is Status.SPECIAL


def test_large_files_are_refused_unread(keystore: Path) -> None:
    sparse = keystore / "sparse"
    with sparse.open("wb") as stream:
        stream.truncate(10 * 1024**3)
    (keystore / "limit").write_bytes(b"x" * MAX_FILE_BYTES)
    (keystore / "over").write_bytes(b"x" * (MAX_FILE_BYTES + 1))
    with Root.open(keystore) as opened:
        assert opened.file("limit").status is Status.PRESENT
        hashed = hashlib.sha256(b"x" * (MAX_FILE_BYTES + 1)).hexdigest()
        for relative, sha256 in (("over", hashed), ("sparse", None)):  # the search ends long before the second does
            file = opened.file(relative)
            assert (file.status, file.content, file.sha256) == (Status.TOO_LARGE, None, sha256)
            assert str((keystore / relative).stat().st_size) in file.detail


def test_a_copy_beyond_the_limit_of_all_files_hides_no_message(keystore: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has the same hash as the one that was read, and comes first by its name."""
    message = b'Content-Type: multipart/signed; protocol="application/x-pkcs7-signature"; boundary=x\n\n'
    for name in ("a", "b"):
        (keystore / name).write_bytes(message)
    monkeypatch.setattr(root, "MAX_TOTAL_BYTES", len(message))
    with Root.open(keystore) as opened:
        read, copy = opened.file("b"), opened.file("a")
        assert (read.status, copy.status, copy.sha256) == (Status.PRESENT, Status.TOO_LARGE, read.sha256)
        assert [(file.path, file.content) for file in opened.messages()] == [("b", message)]


def test_what_a_file_says_of_its_size_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of /proc have no size and content nevertheless."""
    with Root.open("/proc/self") as opened:
        file = opened.file("status")
        assert file.status is Status.PRESENT
        assert file.content is not None
        assert file.content.startswith(b"Name:")
        monkeypatch.setattr(root, "MAX_FILE_BYTES", 10)
        assert opened.file("limits").status is Status.TOO_LARGE


def test_all_files_together_are_bounded(keystore: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(root, "MAX_TOTAL_BYTES", 20)
    (keystore / "second").write_bytes(b"0123456789")
    (keystore / "third").write_bytes(b"01234")
    with Root.open(keystore) as opened:
        statuses = [opened.file(name).status for name in ("public/ca.cert.pem", "second", "third")]
    assert statuses == [Status.PRESENT, Status.TOO_LARGE, Status.PRESENT]


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything; the same runs as another user below")
def test_unreadable_files_and_directories_as_this_user(keystore: Path) -> None:
    _unreadable(keystore)
    _lost_and_found(keystore)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user; the same runs as this one above")
def test_unreadable_files_and_directories_as_another_user() -> None:
    child = os.fork()
    if child == 0:  # since there is no way back
        code = 1
        try:
            os.setgroups([])
            os.setgid(65534)
            os.setuid(65534)
            import tempfile

            with tempfile.TemporaryDirectory() as directory:
                path = Path(directory) / "keystore"
                (path / "public").mkdir(parents=True)
                (path / "public/ca.cert.pem").write_bytes(b"the certificate")
                _unreadable(path)
                _lost_and_found(path)
            code = 0
        finally:
            os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def _unreadable(path: Path) -> None:
    (path / "locked").write_bytes(b"x")
    (path / "locked").chmod(0)
    public = path / "public"
    try:
        for mode, status in ((0o000, Status.UNREADABLE), (0o100, Status.PRESENT)):
            public.chmod(mode)
            with Root.open(path) as opened:
                assert opened.file("locked").status is Status.UNREADABLE
                assert opened.file("public/ca.cert.pem").status is status
                assert opened.entries("public").directory.status is Status.UNREADABLE
                assert opened.entries("").directory.status is Status.DIRECTORY
    finally:
        public.chmod(0o700)


def _lost_and_found(path: Path) -> None:
    """What ext4 keeps for itself in the root of a volume is nobody's enclave, and is looked over nowhere else."""
    (path / "enclaves/talker").mkdir(parents=True)
    (path / "enclaves/talker/cert.pem").touch()
    for place, told in (("lost+found", []), ("enclaves/lost+found", ["enclaves/lost+found"])):
        directory = path / place
        directory.mkdir(parents=True, mode=0)
        with Root.open(path) as opened:
            layout = discover(opened)
        directory.rmdir()
        assert [each.path for each in layout.unreadable_directories] == told


def test_each_inode_is_read_once(keystore: Path) -> None:
    os.link(keystore / "public/ca.cert.pem", keystore / "copy")
    os.symlink("public/ca.cert.pem", keystore / "link")
    with Root.open(keystore) as opened:
        first = opened.file("public/ca.cert.pem")
        (keystore / "copy").write_bytes(b"changed meanwhile")
        for relative in ("copy", "link", "public/ca.cert.pem"):
            assert opened.file(relative).content is first.content


def test_sealed_files_keep_their_bytes_to_themselves(keystore: Path) -> None:
    with Root.open(keystore) as opened:
        sealed = opened.sealed("public/ca.cert.pem")
        assert sealed.content is None
        assert sealed.sha256 == hashlib.sha256(b"the certificate").hexdigest()
        assert opened.unsealed(sealed).content == b"the certificate"
        assert opened.sealed("public/ca.cert.pem").content is None
        assert b"the certificate" not in repr(vars(opened)).encode()
        assert all(reading.content is None for reading in opened._readings.values())
        assert opened.file("public/ca.cert.pem").content == b"the certificate"


def test_a_sealed_file_hands_out_what_was_hashed_or_nothing(keystore: Path) -> None:
    """A statement names the hash of what was judged, whatever lies there by then."""
    key = authority().key_pem
    (keystore / "old.pem").write_bytes(key)
    with Root.open(keystore) as opened:
        secret, other = opened.sealed("old.pem"), opened.sealed("public/ca.cert.pem")
        for name in ("old.pem", "public/ca.cert.pem"):
            (keystore / name).write_bytes(b"changed meanwhile")
        assert opened.unsealed(secret).content == key
        replaced = opened.unsealed(other)
        assert (replaced.status, replaced.content, replaced.sha256) == (Status.UNREADABLE, None, other.sha256)


def test_names_that_are_no_utf8_keep_apart(keystore: Path) -> None:
    os.mkdir(bytes(keystore) + b"/caf\xe9")
    for name, content in ((b"caf\xe9/a\nb", b"1"), (b"caf%E9", b"2"), ("café".encode(), b"3"), (b"\x1b]0;x\x07", b"4")):
        with open(bytes(keystore) + b"/" + name, "wb") as stream:
            stream.write(content)
    with Root.open(keystore) as opened:
        entries = [entry.name for entry in opened.entries("").entries]
        assert entries == sorted(os.listdir(bytes(keystore)))
        shown = {opened.file(name).path: opened.file(name).content for name in entries}
        assert shown["caf%25E9"] == b"2"
        assert shown["café"] == b"3"
        assert shown["%1B]0;x%07"] == b"4"
        odd = opened.sealed(b"caf\xe9/a\nb")
        assert odd.path == "caf%E9/a%0Ab"
        assert opened.unsealed(odd).content == b"1"


def test_any_name_has_an_answer(keystore: Path) -> None:
    with Root.open(keystore) as opened:

        @settings(max_examples=200, deadline=None)
        @given(st.one_of(st.binary(max_size=40), st.text(alphabet=st.sampled_from("/.ab\0\ud800"), max_size=20)))
        def check(relative: bytes | str) -> None:
            try:
                relative = os.fsencode(relative)
            except UnicodeEncodeError:
                return  # no path of this system
            assert opened.file(relative).status is not Status.PRESENT
            opened.entries(relative)

        check()
        assert opened.file("x/" * 3000 + "y").status is Status.UNREADABLE  # no robot can ask for it either
    with Root.open(keystore) as opened:
        assert opened.file("x" * 5000).status is Status.UNREADABLE
        assert opened.entries("").directory.status is Status.DIRECTORY
        assert opened.file("x" * 4000).status is Status.MISSING  # as the list says


def test_listing_tells_kinds_and_targets_and_follows_nothing(keystore: Path) -> None:
    os.symlink("/etc", keystore / "etc")
    os.mkfifo(keystore / "fifo")
    (keystore / "a").write_bytes(b"")
    with Root.open(keystore) as opened:
        listed = [(entry.name, entry.kind, entry.target) for entry in opened.entries("").entries]
    assert listed == [
        (b"a", EntryKind.FILE, None),
        (b"enclaves", EntryKind.DIRECTORY, None),
        (b"etc", EntryKind.LINK, b"/etc"),
        (b"fifo", EntryKind.SPECIAL, None),
        (b"public", EntryKind.DIRECTORY, None),
    ]


def test_too_many_entries_surface(keystore: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(root, "MAX_ENTRIES", 10)
    many = keystore / "many"
    many.mkdir()
    for number in range(9):
        (many / str(number)).touch()
    with Root.open(keystore) as opened:
        assert opened.entries("").directory.status is Status.DIRECTORY
        assert not opened.exhausted
        listing = opened.entries("many")
        assert (listing.directory.status, listing.entries) == (Status.UNREADABLE, ())
        assert "more than" in listing.directory.detail
        assert opened.exhausted


def test_too_deep_directories_surface(keystore: Path) -> None:
    deep = keystore
    here = os.open(keystore, os.O_RDONLY)
    for _ in range(descent.MAX_DEPTH + 2):
        os.mkdir("d", dir_fd=here)
        below = os.open("d", os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = below
        deep = deep / "d"
    os.close(here)
    with Root.open(keystore) as opened:
        limit = "/".join("d" * descent.MAX_DEPTH)
        assert opened.entries(limit).directory.status is Status.DIRECTORY
        assert opened.file(limit + "/d").status is Status.DIRECTORY
        for relative in (limit + "/d", limit + "/d/d"):
            listing = opened.entries(relative)
            assert listing.directory.status is Status.UNREADABLE
            assert str(descent.MAX_DEPTH) in listing.directory.detail
        assert opened.file(limit + "/d/d").status is Status.UNREADABLE


def test_descriptors_are_few_and_closed(keystore: Path) -> None:
    def open_descriptors() -> int:
        return len(os.listdir("/proc/self/fd"))

    for number in range(300):
        (keystore / f"enclaves/e{number}").mkdir()
        (keystore / f"enclaves/e{number}/cert.pem").write_bytes(b"x")
    before = open_descriptors()
    with Root.open(keystore) as opened:
        for number in range(300):
            assert opened.file(f"enclaves/e{number}/cert.pem").status is Status.PRESENT
        assert open_descriptors() - before < 70
    assert open_descriptors() == before


@pytest.mark.parametrize("path", ["missing", "file", "nul\0", "loop"])
def test_what_is_no_directory_is_nothing_to_audit(tmp_path: Path, path: str) -> None:
    (tmp_path / "file").touch()
    os.symlink("loop", tmp_path / "loop")
    with pytest.raises(NothingToAudit, match="expected the directory of an SROS2 keystore"):
        Root.open(f"{tmp_path}/{path}")


def test_swapping_components_never_shows_what_is_outside(keystore: Path) -> None:
    """While another thread swaps a directory and a file for links that leave, no read ever gives their bytes."""
    (keystore / "dir").mkdir()
    (keystore / "dir/secret").write_bytes(b"harmless")
    os.symlink("../outside", keystore / "dir.link")
    os.symlink("../outside/secret", keystore / "file.link")
    (keystore / "file.real").write_bytes(b"harmless")
    os.rename(keystore / "file.real", keystore / "file")
    stop = threading.Event()

    def swap() -> None:
        while not stop.is_set():
            for name in ("dir", "file"):
                os.rename(keystore / name, keystore / f"{name}.real")
                os.rename(keystore / f"{name}.link", keystore / name)
                os.rename(keystore / name, keystore / f"{name}.link")
                os.rename(keystore / f"{name}.real", keystore / name)

    thread = threading.Thread(target=swap)
    thread.start()
    statuses: set[Status] = set()
    try:
        end = time.monotonic() + 1.5
        while time.monotonic() < end:
            for relative in ("dir/secret", "file"):
                file = read(keystore, relative)
                statuses.add(file.status)
                assert file.content in (None, b"harmless")
    finally:
        stop.set()
        thread.join()
    assert Status.PRESENT in statuses
    assert len(statuses) > 1  # the race did happen


WATCHED = """
import os, sys
from keystore_audit.keystore.root import Root  # imported before watching
from keystore_audit.keystore.layout import discover
import cryptography.x509
keystore = os.path.realpath(sys.argv[1])
opened = []
real_open = os.open
def watched_open(*args, **kwargs):
    descriptor = real_open(*args, **kwargs)
    opened.append(os.readlink(f"/proc/self/fd/{descriptor}"))
    return descriptor
os.open = watched_open
paths = []
def hook(event, args):
    if event == "open" and watching:
        paths.append((args[0], args[2]))
watching = True
sys.addaudithook(hook)
with Root.open(sys.argv[1]) as root:
    layout = discover(root)
    root.unsealed(root.sealed("enclaves/talker/key.pem"))
watching = False
assert len(opened) == len(paths) > 10, (len(opened), len(paths))
strangers = [path for path in opened if not (path + "/").startswith(keystore + "/")]
followed = [path for path, flags in paths[1:] if not flags & os.O_NOFOLLOW or b"/" in os.fsencode(path)]
print(strangers, followed)
"""


def test_nothing_outside_is_opened(keystore: Path) -> None:
    """Every open of a discovery is watched, in the process and by the kernel's name of the descriptor."""
    talker = keystore / "enclaves/talker"
    for name in ("cert.pem", "key.pem", "permissions.xml"):
        (talker / name).write_bytes(b"x")
    os.symlink("../../../outside/secret", talker / "permissions.p7s")
    os.symlink("/etc/passwd", talker / "governance.p7s")
    os.symlink("/dev/zero", talker / "crl.pem")
    os.symlink("../../public/ca.cert.pem", talker / "identity_ca.cert.pem")
    os.symlink("../../../outside", talker / "below")
    os.symlink("/proc/self/root/etc", keystore / "enclaves/etc")
    os.symlink("../outside", keystore / "private")
    run = subprocess.run([sys.executable, "-c", WATCHED, keystore], capture_output=True, text=True, check=False)
    assert (run.stdout, run.stderr) == ("[] []\n", "")


def test_links_lead_over_a_bounded_number_of_names(keystore: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a limit, links of 2,000 names that lead to one another take a minute for each thousand."""
    for number in range(20):
        ways = "./" * number + "public/../" * 300  # a way that was walked is not walked again: each is another one
        os.symlink(ways + "public/ca.cert.pem", keystore / f"link{number:02}")
    monkeypatch.setattr(descent, "MAX_STEPS", 3000)
    with Root.open(keystore) as opened:
        statuses = [opened.file(f"link{number:02}").status for number in range(20)]
    assert statuses == [Status.PRESENT] * 4 + [Status.UNREADABLE] * 16
