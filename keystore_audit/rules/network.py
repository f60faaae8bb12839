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
    outside("Set transport/link/tls/enable_mtls to true, and remove enable_mtls=false from the endpoint."),
)
def link_without_mutual_authentication(process: Process) -> Iterator[Violation]:
    """A process accepts TLS links from anybody, with any certificate or none.

    Rules for certificate names do not apply to such a link: what anybody may do, the whole network may do. The fragment
    of an endpoint wins over the section (measured).
    """
    open_ends = [end for end in process.says.listens if end.protocol in SECURED and not process.says.mutual(end)]
    if open_ends and process.says.starts:
        message = f"{process.name} accepts links on {quoted(open_ends[0].text)} without a certificate of the other end"
        yield found(process, f"{message}{more_like(open_ends)}.", *(end.line for end in open_ends))


@rule(
    "KA802",
    Severity.CRITICAL,
    facts.ROUTED_LINKS,
    outside('Use only tls endpoints, and set transport/link/protocols to ["tls"], so that no other one starts.'),
)
def plain_endpoint(process: Process) -> Iterator[Violation]:
    """A process has an endpoint without TLS: whoever reaches it has a link without an identity, and reads along.

    If no endpoint is set, the defaults count: plain, and on every interface. On the loopback interface alone: high.
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
    outside("Remove the multicast endpoint."),
)
def multicast_link(process: Process) -> Iterator[Violation]:
    """A process has a UDP multicast endpoint, and no access control applies to such links in either direction.

    Whoever hears the group reads everything, and whatever is sent there is accepted (measured).
    """
    ends = [end for end in _ends(process) if end.multicast]
    if ends:
        message = f"{process.name} has the multicast endpoint {quoted(ends[0].text)}, to which no rule applies."
        yield found(process, message, *(end.line for end in ends))


@rule(
    "KA810",
    Severity.HIGH,
    facts.ROUTED_LINKS,
    outside('Set transport/link/protocols to ["tls"], and scouting/multicast/enabled to false.'),
)
def plain_link_to_whom_announces(process: Process) -> Iterator[Violation]:
    """A peer with TLS connects without TLS to whoever announces a plain address to it (measured).

    Gossip tells peers of whoever has a link to the router, multicast of anybody on the network: critical. Over such a
    link nobody has an identity.
    """
    says = process.says
    if says.starts and says.seeks and says.plain and any(end.protocol in SECURED for end in _ends(process)):
        who = "anybody on the network" if says.multicast else "any enclave"
        message = f"{process.name} connects without TLS to {who} that announces a plain address."
        scouting = says.find("scouting")
        severity = Severity.CRITICAL if says.multicast else None
        yield found(process, message, scouting.line if scouting is not None else None, severity=severity)


@rule(
    "KA811",
    Severity.HIGH,
    facts.ROUTED_TLS,
    outside(
        "Give each listener a certificate with its address or DNS name as subject alternative name, and set "
        "transport/link/tls/verify_name_on_connect to true (its default)."
    ),
)
def router_not_verified(process: Process, context: Context) -> Iterator[Violation]:
    """A process does not check whom it reached: each enclave can play the router, or any other listener.

    So can the holder of any public authority's certificate, since those are always trusted, too. Low if the process
    denies by default and its rules go only by names: whoever answers has its own rights (measured), but can withhold
    data. Certificates from sros2 have no alternative name: with the check there is no link, medium.
    """
    secured = [end for end in _ends(process) if end in process.says.connects and end.protocol in SECURED]
    unchecked = [end for end in secured if process.says.tls(end, "verify_name_on_connect")[0] is False]
    if unchecked:
        message = f"Any enclave can pose as {quoted(unchecked[0].text)} to {process.name}"
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
        message = f"{process.name} checks names, but these certificates have none: {listed(nameless)}. It gets no link."
        yield found(process, message, checked[0].line, severity=Severity.MEDIUM, key="nameless")


@rule(
    "KA813",
    Severity.MEDIUM,
    facts.ROUTED_TLS,
    outside("Set transport/link/tls/close_link_on_expiration to true."),
)
def link_outlives_certificate(process: Process) -> Iterator[Violation]:
    """A link outlives the certificate of its other end: whoever is connected stays connected.

    There is no revocation, so dates are the only end of a lost key (measured on both ends of a link).
    """
    secured = [end for end in _ends(process) if end.protocol in SECURED]
    lasting = [end for end in secured if process.says.tls(end, "close_link_on_expiration")[0] is not True]
    if lasting:
        message = f"{process.name} keeps links when the certificate of the other end expires."
        yield found(process, message, lasting[0].line)


@rule(
    "KA814",
    Severity.HIGH,
    facts.ROUTED_TLS,
    outside("Issue all identities again under another CA, name that as root_ca_certificate, and delete the old list."),
)
def links_never_revoked(process: Process) -> Iterator[Violation]:
    """The enclave has a crl.pem, but no link is ever refused for it: the middleware knows no revocation.

    The generator finds the list and writes nothing of it; a field `crl` is refused (measured).
    """
    crl = process.owner.crl if process.owner is not None else None
    revoked = sum(len(each.revoked) for each in crl.revocation_lists) if crl is not None else 0
    if crl is not None and revoked:
        message = f"{crl.file.place} revokes {revoked} certificates, but {process.name} still accepts them."
        yield found(process, message, process.says.tls(None, CERTIFICATES[0])[1])


@rule(
    "KA815",
    Severity.HIGH,
    facts.ROUTED_TLS,
    outside("Name the keystore's identity_ca.cert.pem, which holds only the CA that issues identities."),
)
def other_roots_trusted(process: Process, context: Context) -> Iterator[Violation]:
    """A process trusts another CA than the enclave's identity CA, or several: whoever holds one of their keys is in.

    All certificates in the file are trusted, even one that has expired or is no CA (measured).
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
        yield found(process, f"{process.name} {what} to issue identities.", line)


@rule(
    "KA816",
    Severity.CRITICAL,
    facts.ROUTED_TLS,
    outside("Name the enclave's own key.pem beside its cert.pem, and remove the CA's key from the robot."),
)
def key_of_another(process: Process, context: Context) -> Iterator[Violation]:
    """A file names the private key of a CA, with which its process can issue any identity.

    High if it is the key of another enclave than the certificate's: the process then does not start (measured).
    """
    for name in KEYS:
        said, line = process.says.tls(None, name)
        there, owner = (False, None)
        if context.network is not None and isinstance(said, str):
            there, owner = context.network.named.key_of(said)
        if there and owner is None:
            yield found(process, f"{name} is the private key of a CA, {quoted(f'{said}')}.", line, key=name)
        elif there and owner is not process.owner:
            message = f"{name} is the key of {owner.path if owner is not None else ''}, but the certificate is not."
            yield found(process, message, line, severity=Severity.HIGH, key=name)


@rule(
    "KA817",
    Severity.HIGH,
    facts.ROUTED_TLS,
    outside("Name the enclave's cert.pem and identity_ca.cert.pem in the keystore, with a key that TLS 1.3 accepts."),
)
def certificate_of_no_use(process: Process, context: Context) -> Iterator[Violation]:
    """A file names a certificate that is not in the keystore, or that makes no link.

    Keys of P-256, P-384, Ed25519 and RSA with 2048 bits work; P-521 and RSA with 1024 do not. An extended key usage has
    to name both client and server (all measured).
    """
    network = context.network
    for name in CERTIFICATES if network is not None else ():
        said, line = process.says.tls(None, name)
        read = network.named.certificates_at(said) if network is not None and isinstance(said, str) else None
        if isinstance(said, str) and read is None:
            message = f"{name} is {quoted(said)}, but the keystore has no such file."
            yield found(process, message, line, undecided=True, key=name)
        elif read is not None and read.first is not None and name != CERTIFICATES[0]:
            usable, why = usability(read.first, context.at, CONNECTING, LISTENING)
            if usable is not Truth.YES:
                yield found(process, f"{name} makes no link: {why}.", line, undecided=usable.may, key=name)


@rule(
    "KA820",
    Severity.HIGH,
    facts.ROUTED_FILES,
    outside("Write the file as the robot's releases read it."),
)
def configuration_refused(process: Process, context: Context) -> Iterator[Violation]:
    """A process does not start with its file: a repeated or unknown name, a wrong value, or an invalid expression.

    A file that only some of the judged releases refuse starts elsewhere.
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
    outside("Keep keys and passwords in separate files that only the robot's user can read, and replace these."),
)
def secret_in_configuration(process: Process) -> Iterator[Violation]:
    """A configuration holds a private key or a password, which whoever reads the file has.

    No report shows it.
    """
    if process.says.secrets or process.holds_key:
        yield found(process, f"{process.path} holds a private key or a password.", *process.says.secrets)


@rule(
    "KA826",
    Severity.HIGH,
    facts.ROUTED_PAGE,
    outside("Write the files as JSON5, put those of all processes into the folder, and avoid what is not known here."),
)
def network_unclear(network: Network) -> Iterator[Violation]:
    """Something of the network is not known here, so nothing is denied for certain.

    Unknown are YAML files, plugins, bridges, namespaces, names and passwords, links that are no hosts and ports,
    several addresses of one endpoint. So are connections to where nobody in the folder listens.
    """
    for place, why in rights_in(network).doubts:
        yield Violation(f"Cannot be told: {why}.", (place,), undecided=True, key=why)


def _environment(_keystore: Network, context: Context) -> Environment | None:
    return context.environment


@rule(
    "KA827",
    Severity.HIGH,
    facts.ROUTED_FILES,
    outside(f"Write the values into the files, and remove {CONFIGURATION}."),
    of=_environment,
)
def configuration_overridden(environment: Environment) -> Iterator[Violation]:
    """A variable replaces values of every file after it was read: it can switch access control off.

    What it changes in the files is not worked out.
    """
    if environment.value(CONFIGURATION):
        place = environment.place(CONFIGURATION)
        yield Violation(f"{CONFIGURATION} replaces what the files say.", (place,), undecided=True)


def is_peer(process: Process) -> bool:
    """Whether it is linked with others beside its router."""
    says = process.says
    return says.mode is Mode.PEER and bool(says.listens or says.gossip or says.multicast)
