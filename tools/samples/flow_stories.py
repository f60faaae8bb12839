"""Keystores and what users assert of them (`sample_keystores/settings/`): where data can get to, and how."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import LISTENER, LISTENER_GRANT, PERMISSIONS_CA, PROVEN, TALKER, TALKER_GRANT, TWO, governed, with_listener
from .documents import DISCOVERY, Criterion, DomainRule, Governance, Grant, Permissions, Rule, TopicRule, edited
from .healthy import TURTLESIM, VEHICLE, healthy
from .policy import Node, grant
from .smime import signed_by
from .store import Enclave, Link, Store
from .story import Case, Story, pair

ASSERTED = {name: ("--settings", f"settings/{name}.toml") for name in ("turtlesim", "vehicle", "chatter")}


def stories() -> Iterator[Story]:
    """The pairs of KA740 and KA742, and the samples below flows/."""
    yield from pair(
        "KA740",
        bad=Case(
            "The settings say that nothing gets from the listener to the talker. But the listener may publish "
            "/answer, to which the talker subscribes.",
            _answering("rt/answer"),
        ),
        good=Case("Nobody subscribes to what the listener publishes.", _answering("rt/question")),
        options=ASSERTED["chatter"],
    )
    yield from pair(
        "KA742",
        bad=Case(
            "Nothing untrusted may reach what is trusted. But the untrusted listener may publish /answer, to which "
            "the trusted talker subscribes.",
            _answering("rt/answer"),
        ),
        good=Case("Nobody subscribes to what the untrusted listener publishes.", _answering("rt/question")),
        options=("--settings", "settings/labels.toml"),
    )
    yield from _turtlesim()
    yield from _determinism()
    yield from _vehicle()
    yield from _unknown()
    yield from _partitions()
    yield from _domains()
    yield from _written_domains()


def _answering(subscribed: str) -> Store:
    """Talker and listener, where the talker subscribes to this beside what it publishes."""
    talking = Permissions(grants=(grant("/talker", Node(name="talker", publish=("chatter",), common=False)),))
    heard = replace(talking.grants[0], rules=(Rule(publish=("rt/chatter",), subscribe=(subscribed,)),))
    said = replace(LISTENER_GRANT, rules=(Rule(publish=("rt/answer",), subscribe=("rt/chatter", "rt/question")),))
    enclaves = (
        replace(TALKER, permissions=Permissions(grants=(heard,))),
        replace(LISTENER, permissions=Permissions(grants=(said,))),
    )
    return governed(replace(TWO, enclaves=enclaves), PROVEN)


def _story(family: str, name: str, text: str, store: Store, options: tuple[str, ...] = ()) -> Story:
    return Story(
        directory=f"flows/{family}_{name}", text=text, tree=store.tree(), options=(*ASSERTED[family], *options)
    )


def _turtlesim() -> Iterator[Story]:
    def random(*published: str) -> Store:
        node = Node(name="random", publish=("low_priority", *published))
        return healthy("flow turtlesim", {**TURTLESIM, "/random": node})

    yield _story(
        "turtlesim",
        "healthy",
        "Neither source moves the turtle except through the multiplexer, and only the keyboard publishes "
        "/high_priority.",
        random(),
    )
    yield _story(
        "turtlesim",
        "random_moves_turtle",
        "The random walker may also publish /move_turtle: it bypasses the multiplexer.",
        random("/move_turtle"),
    )
    yield _story(
        "turtlesim",
        "random_any_priority",
        "The random walker may publish /*_priority, which includes /high_priority.",
        random("/*_priority"),
    )
    split = random()
    shared = replace(split, permissions_ca=split.identity_ca)
    yield _story(
        "turtlesim",
        "shared_ca",
        "One authority signs identities and rights, as sros2 makes it. Cyclone DDS 0.10 does not pin the signer, so "
        "the random walker signs itself the right to publish /move_turtle.",
        shared,
        ("--profile", "cyclonedds-0.10"),
    )
    yield _story(
        "turtlesim",
        "split_cas",
        "Two authorities sign identities and rights: nobody signs their own rights.",
        split,
        ("--profile", "cyclonedds-0.10"),
    )


def _vehicle() -> Iterator[Story]:
    def vehicle(**changed: Node) -> Store:
        return healthy("flow vehicle", {**VEHICLE, **{f"/{name}": node for name, node in changed.items()}})

    infotainment, gateway = VEHICLE["/infotainment"], VEHICLE["/gateway"]
    yield _story(
        "vehicle",
        "healthy",
        "Nobody on whom the motor depends reads what the infotainment system publishes.",
        vehicle(),
    )
    yield _story(
        "vehicle",
        "plain_grant",
        "The gateway passes a limit on to the motor, and reads /media_state. The infotainment system reaches the "
        "motor over two rights that each look harmless.",
        vehicle(
            gateway=replace(
                gateway,
                subscribe=(*gateway.subscribe, "media_state"),
                publish=(*gateway.publish, "motor_limit"),
            )
        ),
    )
    unchecked = DomainRule(topics=(TopicRule(expression="rt/motor_limit", write_access_control=False), TopicRule()))
    yield _story(
        "vehicle",
        "governance_flag",
        "No grant lets the infotainment system publish /motor_limit, but the governance asks for none.",
        replace(vehicle(), governance=Governance(rules=(unchecked,))),
    )
    yield _story(
        "vehicle",
        "compromised_relay",
        "The gateway reads /motor_limit and /media_state and publishes neither. Whoever takes it over forges "
        "/motor_limit with its reader's key: only a compromised relay leads to the motor.",
        vehicle(gateway=replace(gateway, subscribe=(*gateway.subscribe, "media_state", "motor_limit"))),
    )
    yield _bridged(vehicle())
    yield _expiring(vehicle(), infotainment)
    yield _story(
        "vehicle",
        "gateway_reads",
        "The gateway reads /media_state and sends nothing to the motor. Whoever updates it to "
        "vehicle_gateway_writes completes a way to the motor.",
        vehicle(gateway=replace(gateway, subscribe=(*gateway.subscribe, "media_state"))),
    )
    yield _story(
        "vehicle",
        "gateway_writes",
        "The gateway passes a limit on to the motor and reads nothing from the infotainment system.",
        vehicle(gateway=replace(gateway, publish=(*gateway.publish, "motor_limit"))),
    )
    yield _moved(vehicle())


def _bridged(store: Store) -> Story:
    """The vehicle with a second domain for the workshop, in which the brake listens to the infotainment system."""
    workshop = {
        "/infotainment": Rule(publish=("rt/workshop",), domains=(1,)),
        "/brake": Rule(subscribe=("rt/workshop",), domains=(1,)),
    }
    grants = {path: grant(path, VEHICLE[path]) for path in workshop}
    permissions = {
        path: Permissions(grants=(replace(own, rules=(*own.rules, workshop[path])),)) for path, own in grants.items()
    }
    enclaves = [
        replace(enclave, permissions=permissions.get(enclave.path, enclave.permissions)) for enclave in store.enclaves
    ]
    return _story(
        "vehicle",
        "bridged_domain",
        "In domain 1, the workshop's, the infotainment system publishes what the brake reads. The brake carries it "
        "into domain 0, and to the motor.",
        replace(
            store,
            enclaves=tuple(enclaves),
            governance=Governance(rules=(DomainRule(), DomainRule(domains=(1,)))),
        ),
    )


def _moved(store: Store) -> Story:
    """The vehicle in another domain."""
    grants = ((each, replace(g, rules=tuple(replace(r, domains=(7,)) for r in g.rules))) for each, g in _grants(store))
    enclaves = tuple(replace(each, permissions=Permissions(grants=(own,))) for each, own in grants)
    return _story(
        "vehicle",
        "moved",
        "The whole vehicle in domain 7. While some enclaves are still in domain 0, updated ones may carry data "
        "between the domains with their old permissions.",
        replace(store, enclaves=enclaves, governance=Governance(rules=(DomainRule(domains=(7,)),))),
    )


def _grants(store: Store) -> Iterator[tuple[Enclave, Grant]]:
    for each in store.enclaves:
        assert isinstance(each.permissions, Permissions)
        yield from ((each, own) for own in each.permissions.grants)


def _expiring(store: Store, infotainment: Node) -> Story:
    """The vehicle with a wide grant that waits behind a narrow one of the infotainment system."""
    narrow = grant("/infotainment", infotainment, not_after="2027-03-01T00:00:00")
    wide = grant("/infotainment", replace(infotainment, publish=(*infotainment.publish, "motor_limit")))
    enclaves = tuple(
        replace(enclave, permissions=Permissions(grants=(narrow, wide))) if enclave.path == "/infotainment" else enclave
        for enclave in store.enclaves
    )
    return _story(
        "vehicle",
        "expiring_grant",
        "An old, wide grant of the infotainment system stands after the narrow one that decides today. Fast DDS "
        "skips expired grants: the wide one counts when the narrow one ends.",
        replace(store, enclaves=enclaves),
        ("--profile", "fastdds"),
    )


def _unknown() -> Iterator[Story]:
    document = Permissions(grants=(LISTENER_GRANT,)).xml()
    whole = signed_by(PERMISSIONS_CA).smime(document.encode())
    yield _story(
        "chatter",
        "unreadable_enclave",
        "The listener's permissions are cut off: whether it can reach the talker is unknown.",
        with_listener(changes={"permissions.p7s": whole[: len(whole) - 300]}),
    )
    yield _story(
        "chatter",
        "ambiguous_enclave",
        "A topic in the listener's permissions has a CDATA section, which parsers read differently: what they allow "
        "is unknown.",
        with_listener(permissions=edited(document, "rt/chatter", "rt/<![CDATA[chatter]]>")),
    )
    yield _story(
        "chatter",
        "linked_away_enclave",
        "A link leads to a folder outside the keystore: the enclave there may forward anything.",
        replace(TWO, changes={"enclaves/relay": Link(target="../../../elsewhere")}),
    )


def _partitions() -> Iterator[Story]:
    """The listener publishes /map in one partition, and the talker reads it in others."""
    secret = Criterion(topics=("rt/map",), partitions=("secret",))
    told = Permissions(grants=(replace(LISTENER_GRANT, rules=(Rule(publish=(secret,)), DISCOVERY)),))

    def store(partition: str) -> Store:
        read = Rule(subscribe=(replace(secret, partitions=(partition,)),))
        grant = replace(TALKER_GRANT, rules=(Rule(subscribe=(secret,), allow=False), read, DISCOVERY))
        talker = replace(TALKER, permissions=Permissions(grants=(grant,)))
        return replace(TWO, enclaves=(talker, replace(LISTENER, permissions=told)))

    yield _story(
        "chatter",
        "partition_pattern",
        "The listener publishes /map in the partition secret, where the talker may not read it. The talker may read "
        "it in *, where its reader meets the writers of all partitions.",
        store("*"),
    )
    yield _story(
        "chatter",
        "partition_named",
        "The same, but the talker may read /map only in the partition public, which meets no other.",
        store("public"),
    )


def _domains() -> Iterator[Story]:
    """The listener publishes /map in domain 0, and the talker may subscribe to it in another domain."""
    told = Permissions(grants=(replace(LISTENER_GRANT, rules=(Rule(publish=("rt/map",)), DISCOVERY)),))
    governance = Governance(rules=(DomainRule(domains=(0, 9)),))

    def store(*domains: int) -> Store:
        read = Rule(subscribe=("rt/map",), domains=domains)
        talker = replace(TALKER, permissions=Permissions(grants=(replace(TALKER_GRANT, rules=(read,)),)))
        return replace(TWO, governance=governance, enclaves=(talker, replace(LISTENER, permissions=told)))

    yield _story(
        "chatter",
        "other_domain",
        "The talker may subscribe to /map only in domain 9, where nobody publishes it. Fast DDS lets it subscribe "
        "in domain 0 too: only a listener that attacks writes to it there.",
        store(9),
    )
    yield _story(
        "chatter", "same_domain", "The same, but in domains 0 and 9: whoever publishes /map reaches it.", store(0, 9)
    )


def _written_domains() -> Iterator[Story]:
    """The talker may read /map in domain 0, and the listener may publish it in one that is not governed."""
    told = Permissions(grants=(replace(TALKER_GRANT, rules=(Rule(subscribe=("rt/map",)), DISCOVERY)),))

    def store(*domains: int) -> Store:
        written = Rule(publish=("rt/map",), domains=domains)
        listener = replace(LISTENER, permissions=Permissions(grants=(replace(LISTENER_GRANT, rules=(written,)),)))
        return replace(TWO, enclaves=(replace(TALKER, permissions=told), listener))

    yield _story(
        "chatter",
        "written_elsewhere",
        "The listener may publish /map only in domain 9, which is not governed. Fast DDS lets it publish in domain "
        "0 too: only a compromised talker accepts it.",
        store(9),
    )
    yield _story(
        "chatter",
        "written_here",
        "The same, but in domains 0 and 9: an honest talker accepts it too.",
        store(0, 9),
    )


def _determinism() -> Iterator[Story]:
    """The TurtleSim with what its multiplexer does declared in settings."""
    store = healthy("flow turtlesim", TURTLESIM)
    yield Story(
        directory="flows/turtlesim_fixed_priority",
        text="The multiplexer takes the keyboard's command first: what is sent decides how the turtle moves.",
        tree=store.tree(),
        options=("--settings", "settings/turtlesim_priority.toml"),
    )
    yield Story(
        directory="flows/turtlesim_arrival_order",
        text="The multiplexer takes whichever command comes first: two runs with the same commands differ.",
        tree=store.tree(),
        options=("--settings", "settings/turtlesim_arrival.toml"),
    )
    keyboard = Node(name="keyboard", publish=("high_priority",), subscribe=("joystick",))
    joystick = Node(name="joystick", publish=("joystick",))
    watched = healthy("flow turtlesim", {**TURTLESIM, "/keyboard": keyboard, "/joystick": joystick})
    yield Story(
        directory="flows/turtlesim_joystick",
        text=(
            "The keyboard's node reads the joystick, but nothing says what it forwards: whether the joystick moves "
            "the turtle is unknown."
        ),
        tree=watched.tree(),
        options=("--settings", "settings/turtlesim_joystick.toml"),
    )
