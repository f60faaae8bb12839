"""What somebody without any key of the keystore can do: DDS-Security 1.1, 9.5."""

from __future__ import annotations

from keystore_audit.properties.property import Property, Role

OUTSIDERS_CANNOT_READ = Property(
    id="outsiders-cannot-read",
    statement="No payload is readable without a key of this keystore.",
    attacker="passive outsider",
    clause="DDS-Security 1.1, 9.4.1.2.5.5 and 9.4.1.2.6 (metadata and data protection kinds)",
    assertion="OutsidersCannotRead",
    roles=(Role.REALM, Role.CHANNEL),
)

OUTSIDERS_CANNOT_LEARN_NAMES = Property(
    id="outsiders-cannot-learn-names",
    statement="No topic name is readable in discovery without a key of this keystore.",
    attacker="passive outsider",
    clause="DDS-Security 1.1, 9.4.1.2.5.3 and 9.4.1.2.6.2 (discovery protection)",
    assertion="OutsidersCannotLearnNames",
    roles=(Role.REALM, Role.CHANNEL),
)

OUTSIDERS_CANNOT_INJECT = Property(
    id="outsiders-cannot-inject",
    statement="No reader takes a sample that was made without a key of this keystore.",
    attacker="active outsider",
    clause="DDS-Security 1.1, 9.4.1.2.5.5 and 9.4.1.2.6 (rtps, metadata and data protection kinds)",
    assertion="OutsidersCannotInject",
    roles=(Role.REALM, Role.CHANNEL),
)

OUTSIDERS_CANNOT_REPLAY = Property(
    id="outsiders-cannot-replay",
    statement="No reader takes a recorded sample for a new one, nor a HEARTBEAT or GAP made without a key.",
    attacker="active outsider",
    clause="DDS-Security 1.1, 9.5.3.3 and 9.4.1.2.6 (rtps and metadata protection kinds)",
    assertion="OutsidersCannotReplay",
    roles=(Role.REALM, Role.CHANNEL),
)

OUTSIDERS_CANNOT_FORGE_LIVELINESS = Property(
    id="outsiders-cannot-forge-liveliness",
    statement="Nobody without a key of this keystore can assert that a writer is alive.",
    attacker="active outsider",
    clause="DDS-Security 1.1, 9.4.1.2.5.4 and 9.4.1.2.6.3 (liveliness protection)",
    assertion="OutsidersCannotForgeLiveliness",
    roles=(Role.REALM, Role.CHANNEL),
)

PROPERTIES = (
    OUTSIDERS_CANNOT_READ,
    OUTSIDERS_CANNOT_LEARN_NAMES,
    OUTSIDERS_CANNOT_INJECT,
    OUTSIDERS_CANNOT_REPLAY,
    OUTSIDERS_CANNOT_FORGE_LIVELINESS,
)
