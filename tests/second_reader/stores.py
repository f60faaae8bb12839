"""Random stores from the pool of `material`: one seed, one store (keys and signatures apart, which are new each time).

A store says which features it has.
"""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path
from random import Random

from msgspec import Struct, field

from tests.keystore.builder import write
from tests.second_reader import material as m

UNREAD = frozenset({"outside link", "pkcs11", "locked key"})
"""Features by which something stays unknown: elsewhere no atom may be opaque."""


class Store(Struct):
    """What lies where. Contents are bytes, links are texts."""

    files: dict[str, bytes | str] = field(default_factory=dict)
    features: set[str] = field(default_factory=set)

    def write(self, root: Path) -> Path:
        """Write it."""
        return write(root, self.files)

    @property
    def may_be_unknown(self) -> bool:
        """Whether something in it was not read."""
        return bool(self.features & UNREAD)


def store(seed: int) -> Store:
    """The store of a seed."""
    return _Maker(Random(seed)).store()


def _ups(folder: str) -> str:
    return "../" * (folder.count("/") + 1)


class _Maker:
    def __init__(self, random: Random) -> None:
        self._random = random
        self._made = Store()
        self._files = self._made.files

    def store(self) -> Store:
        random = self._random
        self._names = sorted(random.sample(m.NAMES, random.choice((1, 2, 2, 3, 3, 4))))
        layout = random.choice(("sros2",) * 8 + ("copies", "flat", "enclave"))
        self._made.features.add(layout)
        if layout == "enclave":
            self._names = self._names[:1]
        self._one_ca = random.random() < 0.3
        self._identity = self._ca_file(("shared",) if self._one_ca else m.IDENTITY_CAS[1:], "several identity CAs")
        self._permissions = self._ca_file(
            ("shared",) if self._one_ca else m.PERMISSIONS_CAS[1:], "several permissions CAs"
        )
        signers = [by for by in self._permissions if by in m.governances()] or ["permissions"]
        self._signer = signers[0]
        self._shared = self._governance()
        if layout in ("sros2", "copies"):
            self._public()
            self._put("enclaves/governance.p7s", self._shared)
        elif layout == "flat":
            self._put("ca.cert.pem", self._pem(self._identity))
            self._put("governance.p7s", self._shared)
        for name in self._names:
            folder = {"flat": name[1:], "enclave": ""}.get(layout, f"enclaves{name}")
            self._enclave(name, folder, links=layout == "sros2")
        self._others(layout)
        return self._made

    def _has(self, feature: str, chance: float) -> bool:
        found = self._random.random() < chance
        if found:
            self._made.features.add(feature)
        return found

    def _put(self, path: str, content: bytes | str) -> None:
        self._files.setdefault(path, content)

    def _ca_file(self, pool: tuple[str, ...], feature: str) -> list[str]:
        """The authorities of a CA file, in order."""
        chosen = [self._random.choice(pool[:2])]
        if self._has(feature, 0.25):
            more = [
                name
                for name in (*pool, "shared", *m.CROSS, "no authority", "permissions expired")
                if name not in chosen
            ]
            chosen += self._random.sample(more, self._random.choice((1, 1, 2)))
            if self._random.random() < 0.3:
                self._random.shuffle(chosen)
        return chosen

    @staticmethod
    def _pem(names: list[str]) -> bytes:
        return b"".join(m.authorities()[name].pem for name in names)

    def _governance(self) -> bytes:
        return self._random.choice(m.governances()[self._by(0.1)])

    def _by(self, odd: float) -> str:
        """Who signs: the permissions CA nearly always."""
        if self._random.random() < odd:
            self._made.features.add("odd signer")
            return self._random.choice(list(m.governances()))
        return self._signer

    def _public(self) -> None:
        if self._one_ca and self._identity == self._permissions:
            self._put("public/ca.cert.pem", self._pem(self._identity))
            self._put("private/ca.key.pem", m.authorities()["shared"].key_pem)
            for stem in ("identity_ca", "permissions_ca"):
                self._put(f"public/{stem}.cert.pem", "ca.cert.pem")
                self._put(f"private/{stem}.key.pem", "ca.key.pem")
            return
        for stem, names in (("identity_ca", self._identity), ("permissions_ca", self._permissions)):
            self._put(f"public/{stem}.cert.pem", self._pem(names))
            if self._random.random() < 0.5:
                self._put(f"private/{stem}.key.pem", m.authorities()[names[0]].key_pem)

    def _enclave(self, name: str, folder: str, *, links: bool) -> None:
        random = self._random
        at = f"{folder}/" if folder else ""
        own = m.identities()[name]
        usual = [by for by in self._identity if by in own] or ["identity"]
        kind = random.choice(list(own)) if self._has("odd identity", 0.2) else usual[0]
        chain = own[kind].pem
        if self._has("second certificate in cert.pem", 0.1):
            chain += random.choice((own["by permissions"], own["another subject"], m.authorities()["identity"])).pem
        self._put(f"{at}cert.pem", chain)
        if not self._has("no key", 0.1):
            self._put(f"{at}key.pem", own[kind].key_pem)
        self._trust(folder, at, links=links)
        if not self._has("no permissions", 0.05):
            whose = random.choice(m.NAMES) if self._has("permissions of another", 0.05) else name
            self._put(f"{at}permissions.p7s", self._document(whose, 0.15))
        if self._has("crl", 0.1):
            self._put(f"{at}crl.pem", random.choice(list(m.lists().values())))
        if self._has("pkcs11", 0.02):
            self._put(f"{at}key.p11", b"pkcs11:token=robot;object=key\n")
        if self._has("outside link", 0.02):
            self._files[f"{at}{random.choice(('permissions.p7s', 'identity_ca.cert.pem'))}"] = "/dev/null/elsewhere"

    def _trust(self, folder: str, at: str, *, links: bool) -> None:
        random = self._random
        for stem, names in (("identity_ca", self._identity), ("permissions_ca", self._permissions)):
            if self._has("own CA file", 0.08):
                pool = m.IDENTITY_CAS if stem == "identity_ca" else m.PERMISSIONS_CAS
                self._put(f"{at}{stem}.cert.pem", self._pem(random.sample(pool, random.choice((1, 2)))))
            elif links:
                self._put(f"{at}{stem}.cert.pem", f"{_ups(folder)}public/{stem}.cert.pem")
            else:
                self._put(f"{at}{stem}.cert.pem", self._pem(names))
        if self._has("identity in a CA file", 0.05):
            other = m.identities()[random.choice(m.NAMES)]["self"]
            self._files[f"{at}identity_ca.cert.pem"] = self._pem(self._identity) + other.pem
        if self._has("own governance", 0.1):
            self._put(f"{at}governance.p7s", self._governance())
        elif links:
            self._put(f"{at}governance.p7s", f"{'../' * folder.count('/')}governance.p7s")
        else:
            self._put(f"{at}governance.p7s", self._shared)

    def _document(self, name: str, odd: float) -> bytes:
        return self._random.choice(m.permissions()[name][self._by(odd)])

    def _somewhere(self, *names: str) -> str:
        """A place that no layout knows."""
        places = ["old/", "docs/", "enclaves/", f"enclaves{self._names[0]}/", "public/", "backup/2024/", ""]
        if "flat" in self._made.features or "enclave" in self._made.features:
            places = ["old/", "docs/", "backup/2024/"]
        return self._random.choice(places) + self._random.choice(names)

    def _others(self, layout: str) -> None:
        """What lies beside the enclaves."""
        random = self._random
        name = random.choice((*self._names, *m.NAMES))
        if self._has("unmanaged permissions", 0.35):
            for _ in range(random.choice((1, 1, 2))):
                self._put(self._somewhere("permissions.p7s.bak", "rights.txt", "p.p7s", "x"), self._document(name, 0.3))
        if self._has("unmanaged governance", 0.1):
            self._put(self._somewhere("governance.p7s.old", "open.p7s"), self._governance())
        if self._has("below other header lines", 0.1):
            mail = b"Subject: rights\nFrom: robot\n" + self._document(name, 0.1)
            self._put(self._somewhere("mail.eml", "note.txt"), mail)
        if self._has("copy of a document", 0.1):
            self._put(self._somewhere("copy.p7s"), self._shared)
        self._keys_and_certificates(name)
        if self._has("prose", 0.3):
            self._put(self._somewhere("README.txt"), b"How this was made: ros2 security create_keystore.\n")
        if layout == "sros2" and self._has("enclave by link", 0.05):
            self._put("enclaves/alias", self._names[0][1:])
        if self._has("other forms", 0.1):
            content = random.choice((m.identities()[name]["identity"].key_pem, self._document(name, 0.1)))
            shown = content.decode().encode("utf-16") if random.random() < 0.5 else b64encode(b64encode(content))
            self._put(self._somewhere("notes.bin"), shown)
        if self._has("link to a file", 0.1):
            target = random.choice([path for path in self._files if path.startswith("enclaves/")] or ["ca.cert.pem"])
            if target in self._files:
                self._put("docs/link", f"../{target}")

    def _keys_and_certificates(self, name: str) -> None:
        """Those of nobody, or of somebody elsewhere."""
        random, every = self._random, m.identities()
        if self._has("certificate alone", 0.3):
            kind = random.choice(list(every[name]))
            content = every[name][kind].pem if random.random() < 0.7 else every[name][kind].der
            self._put(self._somewhere("robot.pem", "cert.crt", "c.der"), content)
        if self._has("cross certificate", 0.2):
            cross = m.authorities()[random.choice(m.CROSS)]
            self._put(self._somewhere("cross.pem", "ca.old.crt"), b"a note\n" + cross.pem)
        if self._has("unmanaged identity", 0.2):
            whose = every[random.choice(("/stranger", name))]
            kind = random.choice(list(whose))
            self._put(self._somewhere("their.pem"), whose[kind].pem)
            self._put(self._somewhere("their.key.pem", "id_key"), whose[kind].key_pem)
        if self._has("key alone", 0.1):
            self._put(self._somewhere("lost.key"), every[name]["identity"].key_pem)
        if self._has("locked key", 0.02):
            self._put(self._somewhere("safe.key"), m.locked_key())
