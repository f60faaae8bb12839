"""Changes of the modules about flows and claims, and what finds each out."""

from __future__ import annotations

MUTANTS = {
    "a reader does not ask for the rights of the writer's realm": (
        "a realm that trusts less",
        "& reads_honestly[sending]",
        "",
    ),
    "an enclave acts as itself alone": (
        "one key, against the flow",
        "fun acts_as: Enclave -> Enclave {",
        "fun acts_as: Enclave -> Enclave { iden & Enclave -> Enclave }\nfun unused: Enclave -> Enclave {",
    ),
    "who could not be read is nobody else": (
        "one that may be anybody",
        " + one_key + anybody -> Enclave + Enclave -> anybody",
        " + one_key",
    ),
    "eavesdroppers have no keys but their own": (
        "heard with another's key",
        "c: e.acts_as.(knows[realm]) }",
        "c: e.(knows[realm]) }",
    ),
    "forgers have no keys but their own": (
        "one key, at the source",
        "c: e.acts_as.(feeds[realm])",
        "c: e.(feeds[realm])",
    ),
    "forgers write by right": ("a reader writes back", "e.acts_as.(feeds[realm])", "e.acts_as.(may_write[realm])"),
    "the outsider forges nothing": ("from the outsider", " + forgers -> realm.unguarded", ""),
    "the outsider injects everywhere": ("from the outsider, signed", "-> realm.unguarded", "-> realm.governed"),
    "the outsider reads nothing": ("to the outsider, in clear", " + eavesdroppers -> realm.in_clear", ""),
    "the outsider reads everything": ("to the outsider", "-> realm.in_clear", "-> realm.governed"),
    "forgers with a key send nothing without it": (
        "let in nowhere, forging",
        "forgers -> realm.unguarded",
        "(forgers & Outsider) -> realm.unguarded",
    ),
    "forgers with a key put nothing without it": (
        "let in nowhere, putting",
        "forgers -> realm.unguarded",
        "(forgers & Outsider) -> realm.unguarded",
    ),
    "eavesdroppers with a key hear nothing without it": (
        "let in nowhere, hearing",
        "eavesdroppers -> realm.in_clear",
        "(eavesdroppers & Outsider) -> realm.in_clear",
    ),
    "what is forged is not on the network": ("forged, and heard", "] + imposes[forgers, realm]\n", "]\n"),
    "who is let in nowhere reads nothing": ("let in nowhere, reading", "in_clear + open_to_known", "open_to_known"),
    "who may join may read": ("read without a grant", "& may_be_granted[realm, subscribe_allowed])", ")"),
    "who grants itself a right has it": (
        "read by a grant of its own",
        "& may_be_granted[realm, subscribe_allowed])",
        "& presentable[realm, subscribe_allowed])",
    ),
    "there are no others of the CA": (
        "read by others of the CA",
        "in_clear + open_to_known & (read_uncontrolled + unasked)",
        "in_clear",
    ),
    "others of the CA have no keys of messages": (
        "overheard by others of the CA",
        "(open_to_known - payload_protection",
        "(none -> none - payload_protection",
    ),
    "no others of the CA sign permissions": (
        "published by a grant that others of the CA sign",
        "(write_uncontrolled + unasked) + granted_by_known",
        "write_uncontrolled",
    ),
    "no others of the CA read by permissions that they sign": (
        "read by signing a grant",
        " + granted_by_known\n",
        "\n",
    ),
    "others sign permissions where the signer is pinned": (
        "one CA, and its signer pinned",
        "{ realm: Realm - pins_signer, t: realm.governed |",
        "{ realm: Realm, t: realm.governed |",
    ),
    "others below the CA sign no permissions": (
        "published by a grant that others below the CA sign",
        "realm.(permissions_ca + chained) }",
        "realm.permissions_ca }",
    ),
    "who is no enclave here joins by grants in force alone": (
        "let in by a grant that is over",
        "admitting.(realm.accepted.grant) |",
        "chosen.(realm.accepted.grant) |",
    ),
    "who is no enclave here may read whatever it reads": (
        "read elsewhere without a grant",
        "overhears_elsewhere[realm] + reads_elsewhere[realm] -",
        "overhears_elsewhere[realm] -",
    ),
    "who has a reader's key reads as itself alone": (
        "read by another's key",
        "in_any_guise[Enclave, knows[realm]]",
        "knows[realm]",
    ),
    "what no enclave here writes is hidden": (
        "written by nobody",
        "governed - message_protection[encrypting]",
        "(governed & written_at_all) - message_protection[encrypting]",
    ),
    "who is no enclave here overhears nothing": (
        "read elsewhere",
        "overhears_elsewhere[realm] + reads_elsewhere[realm]",
        "reads_elsewhere[realm]",
    ),
    "who is no enclave here relays nothing": (
        "relayed elsewhere",
        "-> (bare + realm.unasked) + relayed",
        "-> (bare + realm.unasked)",
    ),
    "who is no enclave here may read nothing": ("read elsewhere, by right", " - entitled_elsewhere[realm]", ""),
    "nobody comes in without an identity": (
        "apart, without identities",
        " + Enclave -> realm.unauthenticated_allowed",
        "",
    ),
    "eavesdroppers overhear what they read": ("packets that members open", "(knows[realm])", "(may_read[realm])"),
    "channels are never left out": (
        "over what is left out",
        "receives[sending, receiving].(usable & ",
        "receives[sending, receiving].(",
    ),
    "no hop by right": (
        "over an honest relay",
        "receives[sending, receiving].(usable & holders",
        "receives[sending, receiving].(usable & none & holders",
    ),
    "no hop by force": (
        "the source writes back",
        "is_told[eavesdroppers, receiving].(usable &",
        "is_told[eavesdroppers, receiving].(usable & none &",
    ),
    "who attacks gives its keys to those alone that peers let read": (
        "a stubborn reader, lured",
        " + { e: in_realm.realm, c: e.reads_alone }",
        "",
    ),
    "no implementation refuses its own readers": ("able, a reader refused", " - refused_reads", ""),
    "no implementation refuses its own writers": ("able, a writer refused", " - refused_writes", ""),
    "honest writers give their keys to whoever reads": (
        "a stubborn reader, honestly",
        "takes[receiving] & reads_honestly[sending]",
        "hears[receiving]",
    ),
    "who attacks takes samples from those alone that peers let write": (
        "a wilful writer",
        " + emits_alone[realm]]",
        "]",
    ),
    "nobody puts a sample that peers refuse": (
        "a wilful writer, to a channel",
        " { e: eavesdroppers & Enclave, c: e.acts_as.(emits_alone[realm]) }",
        " none -> none",
    ),
    "honest readers take samples that peers refuse": (
        "a wilful writer among the honest",
        "{ e: eavesdroppers & Enclave, c: e.acts_as.(emits_alone[realm]) }",
        "emits_alone[realm]",
    ),
    "who attacks gets a sample by right alone": (
        "a stubborn reader of a channel",
        "\ttakes[realm] + { e: eavesdroppers & Enclave, c: e.acts_as.(hears[realm]) }",
        "\ttakes[realm] + { e: eavesdroppers & Enclave, c: e.acts_as.(takes[realm]) }",
    ),
    "honest readers of a channel get what peers refuse them": (
        "a stubborn reader, the source alone",
        "takes[realm] + { e: eavesdroppers & Enclave",
        "hears[realm] + { e: eavesdroppers & Enclave",
    ),
    "who gets a sample does not pass it on": (
        "channel to channel",
        "getters[first, eavesdroppers, realm] in inside + through - target",
        "no getters[first, eavesdroppers, realm] & target",
    ),
    "who gets a sample has not arrived": (
        "the end is trusted",
        "in inside + through - target\n\t\tno inside",
        "in inside + through\n\t\tno inside",
    ),
    "nobody puts a sample": ("channel to channel", "no inside & putters[last, forgers, eavesdroppers, realm]", ""),
    "nobody is passed over": (
        "past a trusted relay",
        "in inside + through - (target - source)",
        "in inside - (target - source)",
    ),
    "everybody is passed over": (
        "over a relay",
        "in inside + through - (target - source)",
        "in inside + Enclave - (target - source)",
    ),
    "a flow begins nowhere": (
        "over a relay",
        "\tsource in inside\n\tall realm: Realm {\n\t\tgetters",
        "\tall realm: Realm {\n\t\tgetters",
    ),
    "a flow never ends": ("over a relay", "in inside + through - (target - source)", "in inside + through"),
    "abilities rest on rights of others": (
        "able by what another holds",
        "permissions :> realm.accepted",
        "Enclave -> realm.accepted",
    ),
    "who issues itself identities has its own rights alone": (
        "issued to itself",
        " + realm.issuing -> (realm.accepted.grant & in_force).allowed",
        "",
    ),
    "who issues itself identities joins by its own grants alone": (
        "issued to itself, let in as another",
        "entering[realm.accepted] + realm.issuing -> (realm.accepted.grant & (in_force + joins_out_of_date))",
        "entering[realm.accepted]",
    ),
    "who issues itself identities is known by its own": (
        "issued to itself, unknown itself",
        "realm.(authentic + issuing)",
        "realm.authentic",
    ),
    "honest readers sign themselves rights": (
        "a reader that could sign itself a right",
        "\tmay_read[realm] - usurped",
        "\tmay_read[realm] - none -> none & usurped",
    ),
    "honest writers sign themselves rights": (
        "a writer that could sign itself a right",
        "\tmay_write[realm] - usurped",
        "\tmay_write[realm] - none -> none & usurped",
    ),
    "who could attack has no rights of its own": (
        "a writer that could sign itself a right, and has it",
        "(uncontrolled + e.(with_met",
        "(none & e.(with_met",
    ),
    "who could attack joins as somebody else": (
        "a writer that could issue itself an identity",
        "known = realm.(authentic & (self_granting + issuing)),",
        "known = realm.(self_granting + issuing),",
    ),
    "publishers need a grant": (
        "writers whom nobody asks",
        "may_write[realm] + (granted[realm, publish_allowed]",
        "may_write[realm] & (granted[realm, publish_allowed]",
    ),
}
"""What it would mean; a question that finds it out; one change of the modules."""
