"""KA8: the links of sessions and routers of the middleware that routes (`--zenoh DIR`): who may have one at all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from keystore_audit.findings import Severity, outside
from keystore_audit.intent.environment import CONFIGURATION, Environment
from keystore_audit.keystore.layout import Role
from keystore_audit.profiles import facts
from keystore_audit.rules.registry import Context, Violation, listed, more_like, quoted, rule
from keystore_audit.truth import Truth
from keystore_audit.zenoh.answers import rights_in
from keystore_audit.zenoh.configuration import PROTOCOLS, SECURED, Endpoint, Mode
from keystore_audit.zenoh.links import alternative_names, fits
from keystore_audit.zenoh.network import CONNECTING, LISTENING, Network, Process, usability

CERTIFICATES: Final = ("root_ca_certificate", "listen_certificate", "connect_certificate")
KEYS: Final = ("listen_private_key", "connect_private_key")


def found(process: Process, message: str, *lines: int | None, **more: Any) -> Violation:
    """A violation in the file, filed under whose it is."""
    owner = process.owner.path if process.owner is not None else None
    places = [process.at(line) for line in lines or (None,)]
    return Violation(message, places, enclave=owner, **more)


def _ends(process: Process) -> tuple[Endpoint, ...]:
    return (*process.says.listens, *process.says.connects) if process.says.starts else ()


@rule(
    "KA801",
    Severity.CRITICAL,
    facts.ROUTED_TLS,
    outside("Set transport/link/tls/enable_mtls to true, and take enable_mtls=false out of the endpoint."),
)
def link_without_mutual_authentication(process: Process) -> Iterator[Violation]:
    """A process takes links by TLS from whoever connects, with any certificate or none.

    Nobody has to prove an identity, so that no rule about a certificate's name applies to such a link, and what is
    allowed to anybody is allowed to the whole network. The fragment of an endpoint wins over the section (measured).
    """
    open_ends = [end for end in process.says.listens if end.protocol in SECURED and not process.says.mutual(end)]
    if open_ends and process.says.starts:
        message = f"{process.name} takes links on {quoted(open_ends[0].text)} without a certificate of the other end"
        yield found(process, f"{message}{more_like(open_ends)}.", *(end.line for end in open_ends))


@rule(
    "KA802",
    Severity.CRITICAL,
    facts.ROUTED_LINKS,
    outside('Use tls endpoints alone, and set transport/link/protocols to ["tls"], so that no other one starts.'),
)
def plain_endpoint(process: Process) -> Iterator[Violation]:
    """A process has an endpoint without TLS: whoever reaches it has a link without an identity, and reads along.

    Where no endpoint is said the defaults count, which are plain and on every interface. On the loopback interface
    alone, whoever has a process on the host can do so: high.
    """
    plain = [end for end in _ends(process) if end.protocol in PROTOCOLS and end.protocol not in SECURED]
    plain = [end for end in plain if not end.multicast]
    if plain:
        severity = Severity.HIGH if all(end.loopback for end in plain) else None
        message = f"{process.name} has the endpoint {quoted(plain[0].text)}, without TLS{more_like(plain)}."
        yield found(process, message, *(end.line for end in plain), severity=severity)


@rule(
    "KA803",
    Severity.CRITICAL,
    facts.ROUTED_LINKS,
    outside("Take the multicast endpoint out."),
)
def multicast_link(process: Process) -> Iterator[Violation]:
    """A process has a UDP multicast endpoint: no access control is applied to such links, in either direction.

    Whoever hears the group reads all, and whatever is sent there is taken (measured).
    """
    ends = [end for end in _ends(process) if end.multicast]
    if ends:
        message = f"{process.name} has the multicast endpoint {quoted(ends[0].text)}, on which no rule counts."
        yield found(process, message, *(end.line for end in ends))


@rule(
    "KA810",
    Severity.HIGH,
    facts.ROUTED_LINKS,
    outside('Set transport/link/protocols to ["tls"], and scouting/multicast/enabled to false.'),
)
def plain_link_to_whom_announces(process: Process) -> Iterator[Violation]:
    """A peer with TLS connects without TLS to whoever announces a plain address to it (measured).

    Peers connect to all that they hear of: by gossip, to whoever has a link to the router; by multicast, to anybody on
    the network, critical. Over such a link nobody has an identity. Which protocols may be used at all is said apart.
    """
    says = process.says
    if says.starts and says.seeks and says.plain and any(end.protocol in SECURED for end in _ends(process)):
        who = "anybody on the network" if says.multicast else "any enclave"
        message = f"{process.name} connects without TLS to {who} that announces an address so."
        scouting = says.find("scouting")
        severity = Severity.CRITICAL if says.multicast else None
        yield found(process, message, scouting.line if scouting is not None else None, severity=severity)


@rule(
    "KA811",
    Severity.HIGH,
    facts.ROUTED_TLS,
    outside(
        "Issue certificates with the address or the DNS name as subject alternative name to whoever listens, and leave "
        "transport/link/tls/verify_name_on_connect at true."
    ),
)
def router_not_verified(process: Process, context: Context) -> Iterator[Violation]:
    """Whoever connects does not check whom it reached: each enclave can play the router, or any other listener.

    So can the holder of any certificate that a public authority made, since those are always trusted beside the CA of
    the keystore. Where a process denies by default and its rules go by names alone, whoever answers has the rights of
    his own name (measured), and can keep others' data away: low. Certificates as sros2 makes them have no alternative
    name: with the check no link comes about, medium.
    """
    secured = [end for end in _ends(process) if end in process.says.connects and end.protocol in SECURED]
    unchecked = [end for end in secured if process.says.tls(end, "verify_name_on_connect")[0] is False]
    if unchecked:
        message = f"{process.name} connects to {quoted(unchecked[0].text)} and takes any enclave for it"
        line = process.says.tls(unchecked[0], "verify_name_on_connect")[1]
        severity = Severity.LOW if process.says.access is not None and process.says.access.by_names else None
        yield found(process, f"{message}{more_like(unchecked)}.", line, severity=severity)
    checked = [end for end in secured if end not in unchecked]
    nameless = [
        each.name
        for each in (context.network.started if context.network is not None else ())
        if each.certificate is not None and not alternative_names(each.certificate)
        if any(fits(end, their).may for end in checked for their in each.says.listens)
    ]
    if nameless:
        message = f"{process.name} checks the names of certificates without any, {listed(nameless)}: it has no link."
        yield found(process, message, checked[0].line, severity=Severity.MEDIUM, key="nameless")


@rule(
    "KA813",
    Severity.MEDIUM,
    facts.ROUTED_TLS,
    outside("Set transport/link/tls/close_link_on_expiration to true."),
)
def link_outlives_certificate(process: Process) -> Iterator[Violation]:
    """A link stays when the certificate of its other end has ended: whoever is connected stays connected.

    There is no revocation, so that dates are the only end of a key that was lost (measured on both ends of a link).
    """
    secured = [end for end in _ends(process) if end.protocol in SECURED]
    lasting = [end for end in secured if process.says.tls(end, "close_link_on_expiration")[0] is not True]
    if lasting:
        message = f"{process.name} keeps links whose certificate has ended."
        yield found(process, message, lasting[0].line)


@rule(
    "KA814",
    Severity.HIGH,
    facts.ROUTED_TLS,
    outside("Issue all identities anew under another CA, and name that as root_ca_certificate."),
)
def links_never_revoked(process: Process) -> Iterator[Violation]:
    """The enclave has a crl.pem, and no link is ever refused for it: the middleware knows no revocation.

    The generator finds the list and writes nothing of it; a field `crl` is refused (measured).
    """
    crl = process.owner.crl if process.owner is not None else None
    revoked = sum(len(each.revoked) for each in crl.revocation_lists) if crl is not None else 0
    if crl is not None and revoked:
        message = f"{crl.file.place} revokes {revoked} certificates, and {process.name} takes them all the same."
        yield found(process, message, process.says.tls(None, CERTIFICATES[0])[1])


@rule(
    "KA815",
    Severity.HIGH,
    facts.ROUTED_TLS,
    outside("Name identity_ca.cert.pem of the keystore, with the one CA that makes identities."),
)
def other_roots_trusted(process: Process, context: Context) -> Iterator[Violation]:
    """A process trusts another CA than the enclave's identity CA, or several: whoever holds one of these keys is in.

    All that stand in the file are trusted; that one has ended or is no CA does not count (measured).
    """
    said, line = process.says.tls(None, CERTIFICATES[0])
    named = context.network.named if context.network is not None and isinstance(said, str) else None
    read = named.certificates_at(said) if named is not None and isinstance(said, str) else None
    if read is None or process.owner is None:
        return
    own = {each.sha256 for each in process.owner.trusts(Role.IDENTITY_CA)}
    others = [each.subject for each in read.certificates if each.sha256 not in own]
    if others or len(read.certificates) > 1:
        what = f"trusts {listed(others)}" if others else f"trusts {len(read.certificates)} authorities"
        yield found(process, f"{process.name} {what} to make identities.", line)


@rule(
    "KA816",
    Severity.CRITICAL,
    facts.ROUTED_TLS,
    outside("Name the enclave's own key.pem beside its cert.pem; take the CA's key off the robot."),
)
def key_of_another(process: Process, context: Context) -> Iterator[Violation]:
    """A file names the private key of a CA, with which its process could make any identity.

    Where it is the key of another enclave than the certificate's, the process does not start (measured): high.
    """
    for name in KEYS:
        said, line = process.says.tls(None, name)
        there, owner = (False, None)
        if context.network is not None and isinstance(said, str):
            there, owner = context.network.named.key_of(said)
        if there and owner is None:
            yield found(process, f"{name} is the private key of a CA, {quoted(f'{said}')}.", line, key=name)
        elif there and owner is not process.owner:
            message = f"{name} is the key of {owner.path if owner is not None else ''}, and the certificate is not."
            yield found(process, message, line, severity=Severity.HIGH, key=name)


@rule(
    "KA817",
    Severity.HIGH,
    facts.ROUTED_TLS,
    outside("Name cert.pem and identity_ca.cert.pem of the enclave in the keystore, with a key that TLS 1.3 takes."),
)
def certificate_of_no_use(process: Process, context: Context) -> Iterator[Violation]:
    """A file names a certificate that is not in the keystore, or with which no link comes about.

    Keys of P-256, P-384, Ed25519 and RSA of 2048 bits do, P-521 and RSA of 1024 do not; an extended key usage has to
    be of both a client and a server (measured). Whose a certificate is that is not here cannot be told.
    """
    network = context.network
    for name in CERTIFICATES if network is not None else ():
        said, line = process.says.tls(None, name)
        read = network.named.certificates_at(said) if network is not None and isinstance(said, str) else None
        if isinstance(said, str) and read is None:
            message = f"{name} is {quoted(said)}, and the keystore has no such file."
            yield found(process, message, line, undecided=True, key=name)
        elif read is not None and read.first is not None and name != CERTIFICATES[0]:
            usable, why = usability(read.first, context.at, CONNECTING, LISTENING)
            if usable is not Truth.YES:
                yield found(process, f"{name} makes no link: {why}.", line, undecided=usable.may, key=name)


@rule(
    "KA820",
    Severity.HIGH,
    facts.ROUTED_FILES,
    outside("Write the file as the releases on the robot read it."),
)
def configuration_refused(process: Process, context: Context) -> Iterator[Violation]:
    """A process does not start with its file: a name twice or unknown, a wrong value, or an expression that is none.

    What only some of the releases that are judged refuse starts elsewhere.
    """
    asked = {version for release in context.releases for version in release.asked}
    refusals = [each for each in process.says.refusals if not each.releases or asked.intersection(each.releases)]
    if refusals:
        first = refusals[0]
        where = f" (releases {listed(first.releases)})" if first.releases else ""
        message = f"{process.name} does not start: {first.reason}{where}{more_like(refusals, ' reasons')}."
        yield found(process, message, *(each.line for each in refusals))


@rule(
    "KA825",
    Severity.CRITICAL,
    facts.ROUTED_PAGE,
    outside("Keep keys and passwords in files of their own that only the robot's user reads, and replace these."),
)
def secret_in_configuration(process: Process) -> Iterator[Violation]:
    """A configuration holds a private key or a password, which whoever reads the file has.

    What it is stands in no report.
    """
    if process.says.secrets or process.holds_key:
        yield found(process, f"{process.path} holds a private key or a password.", *process.says.secrets)


@rule(
    "KA826",
    Severity.HIGH,
    facts.ROUTED_PAGE,
    outside("Write it as JSON5, have the files of all processes in the folder, and do without what is not known."),
)
def network_unclear(network: Network) -> Iterator[Violation]:
    """Something of the network is not known here, so that nothing is denied for certain.

    Files in YAML, plugins and bridges, links that are no hosts and ports, names and passwords, several addresses of one
    endpoint, namespaces, and processes that connect to where none of the folder listens.
    """
    for place, why in rights_in(network).doubts:
        yield Violation(f"Cannot be told: {why}.", (place,), undecided=True, key=why)


def _environment(_keystore: Network, context: Context) -> Environment | None:
    return context.environment


@rule(
    "KA827",
    Severity.HIGH,
    facts.ROUTED_FILES,
    outside(f"Write it into the files, and leave {CONFIGURATION} out."),
    of=_environment,
)
def configuration_overridden(environment: Environment) -> Iterator[Violation]:
    """A variable replaces values of every file after it was read: with it, access control can be switched off.

    What it makes of the files is not worked out.
    """
    if environment.value(CONFIGURATION):
        place = environment.place(CONFIGURATION)
        yield Violation(f"{CONFIGURATION} replaces what the files say.", (place,), undecided=True)


def is_peer(process: Process) -> bool:
    """Whether it is linked with others beside its router."""
    says = process.says
    return says.mode is Mode.PEER and bool(says.listens or says.gossip or says.multicast)
