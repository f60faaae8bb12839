"""Changes of the modules about flows and claims, and what finds each out."""

from __future__ import annotations

MUTANTS = {
    "a reader does not ask for the rights of the writer's trust domain": (
        "a trust domain that trusts less",
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
        "c: e.acts_as.(knows[trust_domain]) }",
        "c: e.(knows[trust_domain]) }",
    ),
    "forgers have no keys but their own": (
        "one key, at the source",
        "c: e.acts_as.(feeds[trust_domain])",
        "c: e.(feeds[trust_domain])",
    ),
    "forgers write by right": (
        "a reader writes back",
        "e.acts_as.(feeds[trust_domain])",
        "e.acts_as.(may_write[trust_domain])",
    ),
    "the outsider forges nothing": ("from the outsider", " + forgers -> trust_domain.unguarded", ""),
    "the outsider injects everywhere": (
        "from the outsider, signed",
        "-> trust_domain.unguarded",
        "-> trust_domain.governed",
    ),
    "the outsider reads nothing": ("to the outsider, in clear", " + eavesdroppers -> trust_domain.in_clear", ""),
    "the outsider reads everything": ("to the outsider", "-> trust_domain.in_clear", "-> trust_domain.governed"),
    "forgers with a key send nothing without it": (
        "let in nowhere, forging",
        "forgers -> trust_domain.unguarded",
        "(forgers & Outsider) -> trust_domain.unguarded",
    ),
    "forgers with a key put nothing without it": (
        "let in nowhere, putting",
        "forgers -> trust_domain.unguarded",
        "(forgers & Outsider) -> trust_domain.unguarded",
    ),
    "eavesdroppers with a key hear nothing without it": (
        "let in nowhere, hearing",
        "eavesdroppers -> trust_domain.in_clear",
        "(eavesdroppers & Outsider) -> trust_domain.in_clear",
    ),
    "what is forged is not on the network": ("forged, and heard", "] + imposes[forgers, trust_domain]\n", "]\n"),
    "who is let in nowhere reads nothing": ("let in nowhere, reading", "in_clear + open_to_known", "open_to_known"),
    "who may join may read": ("read without a grant", "& may_be_granted[trust_domain, subscribe_allowed])", ")"),
    "who grants itself a right has it": (
        "read by a grant of its own",
        "& may_be_granted[trust_domain, subscribe_allowed])",
        "& presentable[trust_domain, subscribe_allowed])",
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
        "{ trust_domain: TrustDomain - pins_signer, t: trust_domain.governed |",
        "{ trust_domain: TrustDomain, t: trust_domain.governed |",
    ),
    "others below the CA sign no permissions": (
        "published by a grant that others below the CA sign",
        "trust_domain.(permissions_ca + chained) }",
        "trust_domain.permissions_ca }",
    ),
    "who is no enclave here joins by grants in force alone": (
        "let in by a grant that is over",
        "admitting.(trust_domain.accepted.grant) |",
        "chosen.(trust_domain.accepted.grant) |",
    ),
    "who is no enclave here may read whatever it reads": (
        "read elsewhere without a grant",
        "overhears_elsewhere[trust_domain] + reads_elsewhere[trust_domain] -",
        "overhears_elsewhere[trust_domain] -",
    ),
    "who has a reader's key reads as itself alone": (
        "read by another's key",
        "in_any_guise[Enclave, knows[trust_domain]]",
        "knows[trust_domain]",
    ),
    "what no enclave here writes is hidden": (
        "written by nobody",
        "governed - message_protection[encrypting]",
        "(governed & written_at_all) - message_protection[encrypting]",
    ),
    "who is no enclave here overhears nothing": (
        "read elsewhere",
        "overhears_elsewhere[trust_domain] + reads_elsewhere[trust_domain]",
        "reads_elsewhere[trust_domain]",
    ),
    "who is no enclave here relays nothing": (
        "relayed elsewhere",
        "-> (bare + trust_domain.unasked) + relayed",
        "-> (bare + trust_domain.unasked)",
    ),
    "who is no enclave here may read nothing": ("read elsewhere, by right", " - entitled_elsewhere[trust_domain]", ""),
    "nobody comes in without an identity": (
        "apart, without identities",
        "+ Enclave -> trust_domain.unauthenticated_allowed",
        "",
    ),
    "eavesdroppers overhear what they read": (
        "packets that members open",
        "(knows[trust_domain])",
        "(may_read[trust_domain])",
    ),
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
        " + { e: in_trust_domain.trust_domain, c: e.reads_alone }",
        "",
    ),
    "no implementation refuses its own readers": ("able, a reader refused", " - refused_reads", ""),
    "no implementation refuses its own writers": ("able, a writer refused", " - refused_writes", ""),
    "honest writers give their keys to whoever reads": (
        "a stubborn reader, honestly",
        "(takes[receiving] + takes_alone[receiving])\n\t& reads_honestly[sending]",
        "hears[receiving]",
    ),
    "who attacks takes samples from those alone that peers let write": (
        "a wilful writer",
        " + emits_alone[trust_domain]]",
        "]",
    ),
    "nobody puts a sample that peers refuse": (
        "a wilful writer, to a channel",
        " { e: eavesdroppers & Enclave, c: e.acts_as.(emits_alone[trust_domain]) }",
        " none -> none",
    ),
    "honest readers take samples that peers refuse": (
        "a wilful writer among the honest",
        "{ e: eavesdroppers & Enclave, c: e.acts_as.(emits_alone[trust_domain]) }",
        "emits_alone[trust_domain]",
    ),
    "who attacks gets a sample by right alone": (
        "a stubborn reader of a channel",
        "takes_alone[trust_domain]\n\t+ { e: eavesdroppers & Enclave, c: e.acts_as.(hears[trust_domain]) }",
        "takes_alone[trust_domain]\n\t+ { e: eavesdroppers & Enclave, c: e.acts_as.(takes[trust_domain]) }",
    ),
    "honest readers of a channel get what peers refuse them": (
        "a stubborn reader, the source alone",
        "takes[trust_domain] + takes_alone[trust_domain]",
        "hears[trust_domain]",
    ),
    "who gets a sample does not pass it on": (
        "channel to channel",
        "getters[first, eavesdroppers, trust_domain] in inside + through - target",
        "no getters[first, eavesdroppers, trust_domain] & target",
    ),
    "who gets a sample has not arrived": (
        "the end is trusted",
        "in inside + through - target\n\t\tno inside",
        "in inside + through\n\t\tno inside",
    ),
    "nobody puts a sample": (
        "channel to channel",
        "no inside & putters[last, forgers, eavesdroppers, trust_domain]",
        "",
    ),
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
        "\tsource in inside\n\tall trust_domain: TrustDomain {\n\t\tgetters",
        "\tall trust_domain: TrustDomain {\n\t\tgetters",
    ),
    "a flow never ends": ("over a relay", "in inside + through - (target - source)", "in inside + through"),
    "abilities rest on rights of others": (
        "able by what another holds",
        "permissions :> trust_domain.accepted",
        "Enclave -> trust_domain.accepted",
    ),
    "who issues itself identities has its own rights alone": (
        "issued to itself",
        "+ trust_domain.issuing -> (trust_domain.accepted.grant & in_force).allowed",
        "",
    ),
    "who issues itself identities joins by its own grants alone": (
        "issued to itself, let in as another",
        "+ trust_domain.issuing -> (trust_domain.accepted.grant & (in_force + joins_out_of_date))",
        "",
    ),
    "who issues itself identities is known by its own": (
        "issued to itself, unknown itself",
        "trust_domain.(authentic + issuing)",
        "trust_domain.authentic",
    ),
    "honest readers sign themselves rights": (
        "a reader that could sign itself a right",
        "\tmay_read[trust_domain] - usurped",
        "\tmay_read[trust_domain] - none -> none & usurped",
    ),
    "honest writers sign themselves rights": (
        "a writer that could sign itself a right",
        "\tmay_write[trust_domain] - usurped",
        "\tmay_write[trust_domain] - none -> none & usurped",
    ),
    "who could attack has no rights of its own": (
        "a writer that could sign itself a right, and has it",
        "(uncontrolled + e.(with_met",
        "(none & e.(with_met",
    ),
    "who could attack joins as somebody else": (
        "a writer that could issue itself an identity",
        "known = trust_domain.(authentic & (self_granting + issuing)),",
        "known = trust_domain.(self_granting + issuing),",
    ),
    "publishers need a grant": (
        "writers whom nobody asks",
        "may_write[trust_domain] + (granted[trust_domain, publish_allowed]",
        "may_write[trust_domain] & (granted[trust_domain, publish_allowed]",
    ),
}
"""What it would mean; a question that finds it out; one change of the modules."""
