"""The shell script that does what the steps of findings say, in the layout that sros2 makes since Foxy.

It is made for one keystore in one state. It holds the digest of every public file that it reads or replaces, and the
target of each link. It stops before its first write if one of them differs now. So a second run, an exchanged link or a
keystore edited meanwhile changes nothing. All new files are made in a folder below the keystore's root, since a
move is one step only within a file system. Then they are moved into their places; where a command fails, the old ones
are moved back. Names are never source text: each is one word (`_Words`). Every path begins with a folder's name, so
that none is an option.
"""

from __future__ import annotations

import os
import shlex
import string
from collections.abc import Iterable, Iterator
from typing import Final
from urllib.parse import unquote_to_bytes

from keystore_audit.findings import Act, Finding, FixKind
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.text import terminal

_SAFE: Final = frozenset(string.ascii_letters + string.digits + "/._-")
_EDITS: Final = (Act.EDIT, Act.EDIT_GOVERNANCE, Act.EDIT_PERMISSIONS)
_EC: Final = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -sha256"
_SHOW: Final = "openssl smime -verify -noverify -text -in FILE.p7s"
_REQUEST: Final = '"$stage/request"'
_SERIAL: Final = '-set_serial "0x$(openssl rand -hex 16)"'
_ROLES: Final = {Role.IDENTITY_CA: "identity", Role.PERMISSIONS_CA: "permissions"}

_HEAD: Final = r"""set -eu
umask 077
LC_ALL=C
export LC_ALL
stage=./.keystore-audit.new
stop() { printf '%s\n' "$1" | cat -v >&2; exit 1; }
changed() { stop "$1 is a link, or not what it was when this script was made: nothing was changed; make it again"; }
folder() { [ -d "$1" ] && [ ! -L "$1" ] || changed "$1"; }
plain() { [ -f "$1" ] && [ ! -L "$1" ] || changed "$1"; }
digest() { openssl dgst -sha256 -r < "$1" | cut -c 1-64; }
file() { plain "$1"; [ "$(digest "$1")" = "$2" ] || changed "$1"; }
link() { [ -L "$1" ] && [ "$(readlink "$1")" = "$2" ] || changed "$1"; }
absent() { [ ! -e "$1" ] && [ ! -L "$1" ] || changed "$1"; }
writable() { [ -d "$1" ] && [ -w "$1" ] || stop "$1 cannot be written into"; }
key() {
  [ -f "$1" ] || stop "$1 is missing: run this where the private keys are"
  [ "$(openssl pkey -in "$1" -passin pass: -pubout 2> "$stage/said")" = "$(openssl x509 -in "$2" -noout -pubkey)" ] ||
    stop "$1 is not the private key of $2, or has a password"
}
review() {
  openssl smime -verify -noverify -nosigs -text -in "$2" 2> "$stage/said" | tr -d '\r' > "$stage/signed" || :
  tr -d '\r' < "$1" > "$stage/unsigned"
  cmp -s "$stage/signed" "$stage/unsigned" && return
  differ=yes
  printf '%s: what is signed (-), and what would be signed now (+)\n' "$1" | cat -v >&2
  diff "$stage/signed" "$stage/unsigned" | sed 's/^</-/; s/^>/+/' | cat -v >&2
}
sign() { openssl smime -sign -text -in "$1" -out "$2" -signer "$3" -inkey "$4"; chmod 644 "$2"; }
put() {
  if [ -e "$2" ] || [ -L "$2" ]; then cp -pP "$2" "$stage/copy"; mv "$stage/copy" "$stage/old/$1"
  else : > "$stage/none/$1"; fi
  mv -f "$stage/new/$1" "$2"
}
back() {
  if [ -e "$stage/old/$1" ] || [ -L "$stage/old/$1" ]; then mv -f "$stage/old/$1" "$2" || left=yes
  elif [ -e "$stage/none/$1" ]; then rm -f "$2" || left=yes; fi
}
end() {
  status=$?
  trap '' EXIT HUP INT TERM
  set +e
  [ "$done" = yes ] || undo
  [ "$left" = yes ] || rm -rf "$stage"
  [ "$left" = no ] || printf '%s\n' "The old files could not all be put back: they are in $stage/old." >&2
  exit "$status"
}
begin() {
  mkdir "$stage" || stop "$stage is there: a run was cut short. Put back what $stage/old holds, and remove it"
  trap end EXIT
  trap 'exit 1' HUP INT TERM
  mkdir "$stage/new" "$stage/old" "$stage/none"
}
done=no
left=no
differ=no"""


def script(findings: Iterable[Finding], keystore: Keystore) -> str:
    """The script for these findings of one code, all of this keystore; in ASCII, so that it can be shown."""
    return "\n".join(_Script(tuple(findings), keystore).lines()) + "\n"


def _raw(path: str) -> bytes:
    """The file's real name, of the form in which a report has it (`text.percent_path`)."""
    return unquote_to_bytes(path.encode("utf-8", "surrogateescape"))


class _Words:
    """Names as single words of a shell, in quotes.

    A name that a terminal might obey is in a variable that printf fills (POSIX.1-2017, printf: octal escapes). A mark
    stands behind it, since the shell drops line ends there.
    """

    def __init__(self) -> None:
        self._names: dict[bytes, str] = {}

    def of(self, name: bytes) -> str:
        """The word for this name."""
        text = name.decode("ascii", "replace")
        if text == terminal(text) and "\ufffd" not in text:
            return shlex.quote(text)
        return f'"${self._names.setdefault(name, f"name{len(self._names)}")}"'

    def lines(self) -> Iterator[str]:
        """What gives the variables their values."""
        for name, variable in self._names.items():
            escaped = "".join(chr(byte) if chr(byte) in _SAFE else f"\\{byte:03o}" for byte in name)
            yield f"{variable}=$(printf '{escaped}_')"
            yield f"{variable}=${{{variable}%_}}"


class _Script:
    """What one script does, in the order in which it was asked for."""

    def __init__(self, findings: tuple[Finding, ...], keystore: Keystore) -> None:
        self._findings, self._keystore = findings, keystore
        self._checks: dict[str, str] = {}
        self._keys: dict[str, None] = {}
        self._reviews: dict[str, None] = {}
        self._makes: list[str] = []
        self._puts: list[str] = []
        self._modes: dict[str, None] = {}
        self._told: list[str] = []
        self._staged: dict[str, str] = {}
        self._digests = dict(keystore.contents)
        self._words = _Words()
        self._acts: dict[Act, dict[str, None]] = {}
        for finding in findings:
            for step in finding.fix.steps:
                if step.act is not None and step.paths:
                    self._acts.setdefault(step.act, {}).update(dict.fromkeys(step.paths))

    def lines(self) -> Iterator[str]:
        """The whole script."""
        first = self._findings[0]
        for act, paths in self._acts.items():
            self._act(act, tuple(paths))
        yield "#!/bin/sh"
        yield f"# {first.code} {first.name}"
        yield from self._comments()
        if not (self._puts or self._modes):
            yield "# There is nothing here that a script does."
            yield "exit 1"
            return
        yield _HEAD
        lines = [*self._body()]
        yield from self._words.lines()
        yield f"undo() {{ {' '.join(f'back {n} {place};' for n, place in enumerate(self._puts))} :; }}"
        yield from lines

    def _body(self) -> Iterator[str]:
        yield f"cd {self._words.of(os.fsencode(os.path.abspath(self._keystore.root)))}"
        yield from self._checks.values()
        if self._puts:
            yield "begin"
            yield from self._keys
            yield from self._reviews
            yield from self._reviewed()
            yield from self._makes
            yield from (f"put {n} {place}" for n, place in enumerate(self._puts))
            yield "done=yes"
        yield from self._modes
        yield from self._told

    def _word(self, path: str) -> str:
        return self._words.of(_raw(path))

    def _comments(self) -> Iterator[str]:
        """What somebody has to do before, each sentence once; names in it are one line that steers no terminal."""
        said = dict.fromkeys(
            (finding.fix.kind.value, step.text, str(place) if finding.fix.kind is FixKind.DECISION else "")
            for finding in self._findings
            for place in (finding.locations[:1] or ("",))
            for step in finding.fix.steps
        )
        for kind, text, place in said:
            yield f"# {kind}: {terminal(f'{text} [{place}]' if place else text)}"

    def _reviewed(self) -> Iterator[str]:
        if not self._reviews:
            return
        if self._acts.keys() & {*_EDITS}:
            yield '[ "$differ" = yes ] || stop "The .xml says what is signed already: edit it first, as said above"'
        yield '[ "$differ" = no ] || [ "${REVIEWED-}" = yes ] ||'
        yield '  stop "That would be signed, whoever wrote it. If it is meant, run this again with REVIEWED=yes"'

    def _act(self, act: Act, paths: tuple[str, ...]) -> None:
        if act is Act.SIGN or act in _EDITS:
            for path in paths:
                self._sign(path, edited=act in _EDITS)
        elif act is Act.ISSUE:
            self._issue(paths)
        elif act is Act.RENEW:
            self._renew(paths)
        elif act is Act.LINK:
            for path in paths:
                self._link(path)
        elif act is Act.NEW_PERMISSIONS_CA:
            for path in self._authority("permissions", paths):
                self._sign(path)
        elif act is Act.NEW_IDENTITY_CA:
            self._issue(self._authority("identity", paths))
        else:
            self._mode(act, paths)

    def _was(self, path: str) -> None:
        """Check that what is there is what was audited, and that no folder on the way is a link."""
        parts = path.split("/")
        for number in range(1, len(parts)):
            folder = "/".join(parts[:number])
            self._checks.setdefault(folder, f"folder {self._word(folder)}")
        if path in self._checks:
            return
        place = os.path.join(os.fsencode(self._keystore.root), _raw(path))
        if os.path.islink(place):
            check = f"link {self._word(path)} {self._words.of(os.readlink(place))}"
        elif os.path.isdir(place):
            check = f"folder {self._word(path)}"
        elif path in self._digests and not path.endswith("key.pem"):
            check = f"file {self._word(path)} {self._digests[path]}"
        elif os.path.lexists(place):
            check = f"plain {self._word(path)}"
        else:
            check = f"absent {self._word(path)}"
        self._checks[path] = check

    def _new(self, path: str) -> str:
        """Where the new file for this place is made."""
        self._was(path)
        folder = path.rpartition("/")[0] or "."
        self._checks.setdefault(f"{folder}/", f"writable {self._word(folder)}")
        number = len(self._puts)
        self._puts.append(self._word(path))
        self._staged[path] = f'"$stage/new/{number}"'
        return self._staged[path]

    def _signer(self, role: Role) -> tuple[str, str]:
        """Certificate and key of the authority, as words: those that are being made, else those that are there."""
        name = _ROLES[role]
        names = f"public/{name}_ca.cert.pem", f"private/{name}_ca.key.pem"
        if names[0] in self._staged:
            return self._staged[names[0]], self._staged[names[1]]
        place = next((file.place for file in self._keystore.layout.authorities if file.path == names[0]), names[0])
        read = (file for file in self._keystore.authorities if file.file.place == place)
        held = {certificate.key for file in read for certificate in file.certificates[:1]}
        key = next((each.file.place for each in self._keystore.authority_keys if each.key in held), names[1])
        self._was(place)
        if place not in self._staged:
            self._keys[f"key {self._word(key)} {self._word(place)}"] = None
        return self._staged.get(place, self._word(place)), self._word(key)

    def _sign(self, path: str, *, edited: bool = False) -> None:
        """Sign the .xml beside; `edited`: since the script was made, as somebody decided."""
        if path in self._staged:
            return
        beside = f"{path.removesuffix('.p7s')}.xml"
        shared = self._keystore.layout.governance
        copied = shared is not None and path in self._digests and self._digests[path] == shared.sha256
        if beside not in self._digests and copied and shared is not None:
            beside = f"{shared.place.removesuffix('.p7s')}.xml"
        certificate, key = self._signer(Role.PERMISSIONS_CA)
        self._was(path)
        if edited:
            told = shlex.quote(f" is missing: make it of what is signed ({_SHOW}), and edit it")
            word = self._word(beside)
            self._checks[beside] = f"[ -e {word} ] || stop {word}{told}; plain {word}"
        elif beside in self._digests:
            self._was(beside)
        else:
            self._checks[beside] = f"stop {self._word(beside)}' is missing: there is nothing to sign'"
        self._reviews[f"review {self._word(beside)} {self._word(path)}"] = None
        self._makes.append(f"sign {self._word(beside)} {self._new(path)} {certificate} {key}")

    def _issue(self, paths: Iterable[str]) -> None:
        certificate, key = self._signer(Role.IDENTITY_CA)
        wanted = {*paths}
        for enclave in self._keystore.enclaves:
            files = enclave.files.files
            if files[Role.CERTIFICATE].path in wanted and files[Role.CERTIFICATE].path not in self._staged:
                self._identity(enclave, certificate, key)

    def _identity(self, enclave: Enclave, certificate: str, key: str) -> None:
        files = enclave.files.files
        subject = shlex.quote("/CN=" + enclave.path.replace("/", r"\/"))
        own, made = self._new(files[Role.KEY].path), self._new(files[Role.CERTIFICATE].path)
        command = (
            f"openssl x509 -req -sha256 -days 365 -copy_extensions copy -in {_REQUEST} -CA {certificate} -CAkey {key} "
            f"{_SERIAL} -out {made}"
        )
        self._makes += [
            f"openssl req -new {_EC} -subj {subject} -addext basicConstraints=CA:FALSE -keyout {own} -out {_REQUEST}",
            command,
            f"chmod 644 {made}",
        ]

    def _authority(self, name: str, paths: tuple[str, ...]) -> tuple[str, ...]:
        """A new key and certificate, and copies where enclaves have them. Returns the paths that are left."""
        key, certificate = map(self._new, paths[:2])
        self._makes += [
            f"openssl req -x509 {_EC} -days 3650 -subj /CN={name}CA -keyout {key} -out {certificate}",
            f"chmod 644 {certificate}",
        ]
        copies = [path for path in paths[2:] if path.endswith(f"{name}_ca.cert.pem")]
        self._makes += [f"cp -p {certificate} {self._new(path)}" for path in copies]
        self._tell(name, paths[1])
        return tuple(path for path in paths[2:] if path not in copies)

    def _tell(self, name: str, public: str) -> None:
        """The line of the settings that declares the authority, which is another one now."""
        self._told.append(
            "printf '%s\\n' 'In [authorities] of the settings, replace the line of this role and keep the other:' "
            f'"{name} = [\\"sha256:$(openssl x509 -in {self._word(public)} -outform DER | openssl dgst -sha256 -r | '
            'cut -c 1-64)\\"]"'
        )

    def _renew(self, paths: tuple[str, ...]) -> None:
        """The same key and name in a new certificate; then the documents that name the old one."""
        files = {file.file.place: file for file in self._keystore.authorities}
        keys = {each.key: each.file.place for each in self._keystore.authority_keys}
        for path in (path for path in paths if path in files):
            key = keys.get(files[path].certificates[0].key, "private/ca.key.pem")
            self._was(path)
            self._keys[f"key {self._word(key)} {self._word(path)}"] = None
            new = self._new(path)
            self._makes += [
                f"openssl x509 -x509toreq -in {self._word(path)} -signkey {self._word(key)} -out {_REQUEST}",
                f"openssl req -x509 -sha256 -days 3650 -in {_REQUEST} -key {self._word(key)} -out {new}",
                f"chmod 644 {new}",
            ]
            for role, name in _ROLES.items():
                if any(enclave.files.files[role].place == path for enclave in self._keystore.enclaves):
                    self._tell(name, path)
        for path in (path for path in paths if path not in files):
            self._sign(path)

    def _link(self, path: str) -> None:
        name = path.rpartition("/")[2]
        up = "../" * path.count("/")
        target = f"{up[3:]}governance.p7s" if name == "governance.p7s" else f"{up}public/{name}"
        self._makes.append(f"ln -s {target} {self._new(path)}")

    def _mode(self, act: Act, paths: tuple[str, ...]) -> None:
        for path in paths:
            self._was(path)
        change = "600" if act is Act.CLOSE_KEY else "go-w"
        self._modes[f"chmod {change} {' '.join(f'./{self._word(path)}' for path in paths)}"] = None
