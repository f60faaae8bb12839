"""What somebody without any key can do in a realm, as sets of channels: where there is somebody to do it to.

The definitions are in docs/model.md. Where there is nothing in the clear, nobody is asked what enclaves do.
"""

from __future__ import annotations

from keystore_audit.model.formal.attacker import RealmView
from keystore_audit.model.formal.bit_sets import union


def read(view: RealmView) -> int:
    """Channels whose payload is readable."""
    return view.readable and view.readable & _written(view)


def learn_of(view: RealmView) -> int:
    """Channels whose topic name is readable in discovery."""
    p = view.protection
    clear = p.governed & ~(p.rtps_encrypts | p.discovery_hidden)
    return clear and clear & (_written(view) | _read(view))


def inject_into(view: RealmView) -> int:
    """Channels on which a reader takes samples."""
    return view.injectable and view.injectable & _read(view)


def replay(view: RealmView) -> int:
    """Channels on which a reader takes old samples again."""
    clear = view.unauthenticated & ~view.protection.metadata_authenticates
    return clear and clear & _read(view)


def assert_liveliness_of(view: RealmView) -> int:
    """Channels on which it can be said that a writer is alive."""
    clear = view.unauthenticated & ~view.protection.liveliness_authenticates
    return clear and clear & _read(view)


def _written(view: RealmView) -> int:
    """Channels with a writer, though it may be one that honest readers refuse."""
    return union(able.writes_at_all for able in view.everybody())


def _read(view: RealmView) -> int:
    """Channels with a reader, though it may be one that honest writers refuse."""
    return union(able.reads_at_all for able in view.everybody())
