"""Configuration of a router for one or several sites, for `pointit router` and zenohd.

Zenoh knows an identity by the common name of its certificate (or by its user name), so every rule refers to
one. A name without rules, such as that of a replaced or revoked certificate, has no rights at all.

Rights as Zenoh's access-control rules, which a router applies to connections by their certificate.

`**` never covers a key below `@`. Publishers of states and events exchange data with late subscribers below
`@adv` of their key, and the test of an identity's own rights (`runtime.zenoh.permission_probe`) is below
`@may`. Both are granted with the key itself, for both flows, since denied traffic disappears silently.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from pointit.access.rights import ALL, UNSLOWED, Rights, Role, max_rate_hz, rights_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import LEASE_MS, ROOM, VERBS
from pointit.schemas.table_types import Delivery, Request, Topic
from pointit.schemas.topics import ANY, HEALTH, READ_HISTORY, REQUESTS, TOPICS, topic_of

Rule = dict[str, Any]
"""An entry of Zenoh's `access_control.rules`."""

LATE = f"{ALL}/@adv/{ALL}"
"""Keys of caches and heartbeats of publishers, for late subscribers and recovery of losses."""

MESSAGES = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)

MAX_BYTES = 1024 * 1024
"""Upper limit of the messages of a site."""
MAX_TRAVELLING_BYTES = 2 * MAX_BYTES
"""Limit above which fragments are not even reassembled, without any report. Shorter messages are dropped
where the router knows the sender, and reports it. Each connection may leave one of each of 7 priorities
unfinished, which nothing but its bytes shows."""
MAX_WAIT_US = 2_000_000
"""Time for which the router waits for a client that does not read, before it closes its connection, us. Less
than a lease. `pointit router` closes it sooner."""
ONE_STREAM = "?multistream=0"
"""Setting of QUIC. With a stream for each priority, Zenoh's default, a query may overtake the declaration of
its key, and the router drops it silently."""
MAX_HISTORY_HZ = 10.0
"""Maximum rate of questions for past events, of each connection: half of what a selector answers."""
MAX_SESSIONS = 1000
ACCEPT_MS = 3000
MAX_UNKNOWN_CONNECTIONS = 500
"""Limit of clients without certificate that may be silent during TLS for `ACCEPT_MS` before others have to
wait. Zenoh's default is 100 for 10 s. This is about half of the usual limit of open files of a process.
`pointit router` raises that limit for `MAX_SESSIONS` in addition."""

HEADER = """\
// Made by `pointit site`; changes by hand are lost. For `pointit router --config` and for zenohd alike, which
// has to be started in this folder: the files are named as seen from here.
"""


def namespace(site: str) -> str:
    """Return the first part of every key of `site`."""
    return f"pointit/{site}"


def all_key_expressions(site: str) -> tuple[str, ...]:
    """Return patterns that cover every key of `site`, including those below `@`."""
    root = namespace(site)
    return (f"{root}/{ALL}", f"{root}/{LATE}", f"{root}/{ALL}/{ROOM}/{ALL}")


def rules_of(site: str, name: str, rights: Rights) -> list[Rule]:
    """Return the rules that grant exactly `rights` to the identity `name` of `site`.

    Declarations and queries are sent to all clients of the site. A client without a matching declaration gets
    none of the queries, and without declarations no client would write (`matching`) or answer.
    """
    root = namespace(site)
    prefix = f"{site}/{name}"
    if rights.writes == (ALL,):
        return [
            {
                "id": f"{prefix}/all",
                "permission": "allow",
                "messages": list(MESSAGES),
                "flows": ["ingress", "egress"],
                "key_exprs": list(all_key_expressions(site)),
            }
        ]

    def at(keys: Iterable[str]) -> list[str]:
        return [f"{root}/{key}" for key in keys]

    def late(keys: Iterable[str]) -> list[str]:
        return [f"{root}/{key}/@adv/{ALL}" for key in keys]

    def tests(keys: Iterable[str], verb: str) -> list[str]:
        return [f"{root}/{key}/{ROOM}/{name}/{verb}" for key in keys]

    # A test of a right is a message to itself below a key of that right
    mine = [f"{root}/{ALL}/{ROOM}/{name}/{ALL}"]
    tested = [f"{root}/{ROOM}/{name}/*"]
    for verb in VERBS:
        tested += tests(getattr(rights, verb), verb)

    # Each right takes several kinds of messages, also in the other direction: a reader must get what it reads
    written = [*at(rights.writes), *late(rights.writes)]
    read = [*at(rights.reads), *late(rights.reads)]
    served = [*at(rights.serves), *at(rights.keeps)]
    announced = [*at(rights.announces), *late(rights.writes)]
    asked = [*at(rights.asks), *read]
    watched = [*at(rights.watches), *late(rights.reads)]
    site_wide = list(all_key_expressions(site)[:2])
    rules: list[Rule] = []

    def grant(right: str, flow: str, messages: Sequence[str], keys: Sequence[str]) -> None:
        if keys:
            rule = {
                "id": f"{prefix}/{right}",
                "permission": "allow",
                "messages": list(messages),
                "flows": [flow],
                "key_exprs": sorted(set(keys)),
            }
            rules.append(rule)

    # What comes from the identity
    grant("write", "ingress", ("put",), [*written, *tested])
    grant("keep", "ingress", ("declare_queryable",), [*served, *late(rights.writes)])
    grant("reply", "ingress", ("reply",), [*served, *written])
    grant("announce", "ingress", ("liveliness_token",), announced)
    grant("read", "ingress", ("declare_subscriber",), [*read, *mine])
    grant("ask", "ingress", ("query",), asked)
    grant("watch", "ingress", ("liveliness_query", "declare_liveliness_subscriber"), watched)

    # What goes to it. Declarations and queries of others go to all
    grant("hear", "egress", ("put",), [*read, *mine])
    grant("answered", "egress", ("reply",), asked)
    grant("see", "egress", ("liveliness_token",), watched)
    declarations = ("declare_subscriber", "declare_queryable", "query", "liveliness_query")
    grant("know", "egress", declarations, site_wide)
    grant("know-watchers", "egress", ("declare_liveliness_subscriber",), site_wide)
    return rules


@dataclass(frozen=True, kw_only=True)
class Member:
    """An identity that may connect."""

    name: str
    role: Role
    common_name: str
    """Common name of its current certificate, or its user name if there are passwords."""


@dataclass(frozen=True, kw_only=True)
class RouterSite:
    """Configuration of a site for its router."""

    site: str
    port: int
    members: Sequence[Member]
    former: Sequence[str] = ()
    """Common names of replaced or revoked certificates."""
    folder: str = ""
    """Folder of the router's own files: `""` (its own folder), or a path with trailing `/`."""
    password: bool = False
    """True if connections are identified by user and password instead of by certificates."""
    dashboard_rate_hz: float = 0.0
    """Maximum rate of each *latest* key for dashboards, by QUIC. 0: no limit, by TLS."""
    uplinks: tuple[str, ...] = ()
    """Addresses of other routers of the site to which this one connects."""


def configuration(sites: Sequence[RouterSite], addresses: Sequence[str] = ("0.0.0.0",)) -> dict[str, Any]:  # noqa: S104 - a router is there to be reached; who may what is decided below
    """Return the configuration of a router for `sites`, listening at `addresses` (without port).

    Raises:
        ConfigError: If two sites cannot share one router. The message gives the reason.
    """
    _check(sites)
    listen: list[str] = []
    connect: list[str] = []
    rules: list[Rule] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    slowed: list[dict[str, Any]] = []
    thinned: list[dict[str, Any]] = []
    for router_site in sites:
        site = router_site.site
        slowed += _slowed(router_site)
        listen += _listeners(router_site, addresses)
        client = _client(router_site)
        connect += [f"{address}#{client}" for address in router_site.uplinks]

        # Each identity is a subject with a policy, which grants it its own rules
        subject_key = "usernames" if router_site.password else "cert_common_names"
        for member in router_site.members:
            rights = rights_of(member.role, member.name)
            own = rules_of(site, member.name, rights)
            rules += own
            subject = f"{site}/{member.name}"
            subjects.append({"id": subject, subject_key: [member.common_name]})
            policy = f"{subject}/{member.role}"
            rule_ids = [rule["id"] for rule in own]
            policies.append({"id": policy, "rules": rule_ids, "subjects": [subject]})

        # Former certificates are named only so that their denials are logged
        if router_site.former:
            nothing = f"{site}/nothing"
            former = f"{site}/former ones"
            rules.append(_nothing(site, nothing))
            subjects.append({"id": former, subject_key: list(router_site.former)})
            policies.append({"rules": [nothing], "subjects": [former]})
        if router_site.dashboard_rate_hz:
            thinned += _thinned(router_site)

    size_limits: list[dict[str, Any]] = []
    histories: list[dict[str, Any]] = []
    for router_site in sites:
        size_limits += _limits(router_site.site)
        history = f"{namespace(router_site.site)}/{READ_HISTORY.at()}"
        histories.append({"key_expr": history, "freq": MAX_HISTORY_HZ})
    retry = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5}
    uplinks = {"endpoints": connect, "timeout_ms": -1, "exit_on_failure": False, "retry": retry}
    access_control = {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }
    router: dict[str, Any] = {
        "mode": "router",
        "listen": {"endpoints": listen},
        "connect": uplinks,
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},
        "adminspace": {"enabled": False, "permissions": {"read": False, "write": False}},
        "transport": _transport(sites),
        "access_control": access_control,
        "low_pass_filter": size_limits,
        "qos": {"network": [_never_waits(router_site.site) for router_site in sites]},
        "downsampling": [],
    }

    # A limit without rules is left out
    rate_limits: list[dict[str, Any]] = [
        {"id": "people", "flows": ["ingress"], "rules": slowed},
        {"id": "history", "flows": ["ingress"], "rules": histories, "messages": ["query"]},
        {"id": "dashboards", "flows": ["egress"], "rules": thinned, "link_protocols": ["quic"]},
    ]
    for limit in rate_limits:
        if limit["rules"]:
            router["downsampling"].append({"messages": ["put"], **limit})
    return router


def _transport(sites: Sequence[RouterSite]) -> dict[str, Any]:
    unicast: dict[str, Any] = {"max_sessions": MAX_SESSIONS}
    link: dict[str, Any] = {
        "protocols": ["tls", "quic"],
        "rx": {"max_message_size": MAX_TRAVELLING_BYTES},
        "tx": {
            "lease": LEASE_MS,
            "queue": {"congestion_control": {"block": {"wait_before_close": MAX_WAIT_US}}},
        },
    }
    transport: dict[str, Any] = {"unicast": unicast, "shared_memory": {"enabled": False}, "link": link}
    if any(router_site.password for router_site in sites):
        # TLS accepts clients without a certificate, so those that stay silent must not keep others waiting
        (router_site,) = sites
        transport["auth"] = {"usrpwd": {"dictionary_file": f"{router_site.folder}users.txt"}}
        unicast |= {"accept_timeout": ACCEPT_MS, "accept_pending": MAX_UNKNOWN_CONNECTIONS}
    else:
        # Of clients' certificates. Zenoh would warn at each connection of a client without one.
        link["tls"] = {"close_link_on_expiration": True}
    return transport


def to_json5(sites: Sequence[RouterSite], addresses: Sequence[str] = ("0.0.0.0",)) -> str:  # noqa: S104 - as above
    """Return `configuration` as JSON5, with an explanatory comment."""
    text = json.dumps(configuration(sites, addresses), indent=1)
    return f"{HEADER}{text}\n"


def _check(sites: Sequence[RouterSite]) -> None:
    ports: dict[int, str] = {}
    names: set[str] = set()
    for router_site in sites:
        if router_site.site in names:
            raise ConfigError(
                f"site {router_site.site} is given twice; sites of one router need different names"
            )
        names.add(router_site.site)
        other = ports.setdefault(router_site.port, router_site.site)
        if other != router_site.site:
            raise ConfigError(
                f"sites {other} and {router_site.site} both have port {router_site.port}; on one router each "
                "has a certificate and so a port of its own: make one of them with --port"
            )
        if router_site.password and router_site.uplinks:
            raise ConfigError(
                f"site {router_site.site} goes by passwords, with which its router joins no other; make it "
                "with certificates"
            )
        if router_site.password and len(sites) > 1:
            raise ConfigError(
                f"site {router_site.site} goes by passwords, of which a router knows one site's only; give "
                "it a router of its own, or make it with certificates"
            )


def _listeners(router_site: RouterSite, addresses: Sequence[str]) -> list[str]:
    files = router_site.folder
    server = f"listen_certificate_file={files}cert.pem;listen_private_key_file={files}key.pem"
    if not router_site.password:
        server += f";root_ca_certificate_file={files}ca.pem;enable_mtls=true"
    protocols = [("tls", "")]
    if router_site.dashboard_rate_hz:
        protocols.append(("quic", ONE_STREAM))
    listeners: list[str] = []
    for protocol, metadata in protocols:
        for address in addresses:
            is_plain_ipv6 = ":" in address and not address.startswith("[")
            host = f"[{address}]" if is_plain_ipv6 else address
            endpoint = f"{protocol}/{host}:{router_site.port}"
            listeners.append(f"{endpoint}{metadata}#{server}")
    return listeners


def _client(router_site: RouterSite) -> str:
    files = router_site.folder
    return (
        f"root_ca_certificate_file={files}ca.pem;connect_certificate_file={files}cert.pem"
        f";connect_private_key_file={files}key.pem;enable_mtls=true"
    )


def _limits(site: str) -> list[dict[str, Any]]:
    """Return the maximum size of each kind of message. If two limits match a key, Zenoh uses the smaller."""
    root = namespace(site)
    by_size: dict[tuple[str, int], list[str]] = {}

    def add(row: Topic[Any] | Request[Any, Any], message: str, size: int) -> None:
        key = row.at(ANY if row.placeholder else "")
        by_size.setdefault((message, size), []).append(f"{root}/{key}")

    # A topic's messages also travel in replies, to late subscribers
    for topic in TOPICS:
        for message in ("put", "reply", "query"):
            add(topic, message, topic.message.max_bytes)
    for request in REQUESTS:
        add(request, "query", request.query.max_bytes)
        add(request, "reply", request.reply.max_bytes)

    # All other keys of the site
    for message in ("put", "query", "reply"):
        by_size[message, MAX_BYTES] = list(all_key_expressions(site))

    limits: list[dict[str, Any]] = []
    for (message, size), keys in sorted(by_size.items()):
        limit = {
            "id": f"{site}/{message}/{size}",
            "messages": [message],
            "flows": ["ingress"],
            "key_exprs": sorted(set(keys)),
            "size_limit": size,
        }
        limits.append(limit)
    return limits


def _never_waits(site: str) -> dict[str, Any]:
    """Return the rule that drops messages for slow readers, regardless of their publisher's settings.

    A router that waits for a stalled reader (5 s, Zenoh's default) delays all clients, as its threads are
    few. Our own publishers never request that. Lost states and events are fetched again from them.
    """
    return {
        "id": f"{site}/never waits",
        "messages": ["put", "delete", "query"],
        "key_exprs": list(all_key_expressions(site)),
        "flows": ["ingress"],
        "overwrite": {"congestion_control": "drop"},
    }


def _nothing(site: str, name: str) -> Rule:
    """Return the only right of former identities, as Zenoh logs no decision on a name without a rule."""
    return {
        "id": name,
        "permission": "allow",
        "messages": ["put"],
        "flows": ["egress"],
        "key_exprs": [f"{namespace(site)}/nothing"],
    }


def _slowed(router_site: RouterSite) -> list[dict[str, Any]]:
    """Return the maximum rate of each key but `UNSLOWED` that a person may write, of each connection.

    Zenoh knows no bursts: the rate is a minimum time between two messages. Readers fetch what it drops of
    states and events again from their publisher. Of a burst of others, such as cursors behind a link that
    stalled, they get the first, and then the next that comes.
    """
    root = namespace(router_site.site)
    rules: list[dict[str, Any]] = []
    for user in _people(router_site):
        for key in rights_of("user", user).writes:
            if topic_of(key) not in UNSLOWED:
                rules.append({"key_expr": f"{root}/{key}", "freq": max_rate_hz(key)})
    return rules


def _thinned(router_site: RouterSite) -> list[dict[str, Any]]:
    """Return one rule for each key of each person, since keys of one rule would share its rate.

    Names of trackers are unknown beforehand, so their objects are not limited, nor is health.
    """
    root = namespace(router_site.site)
    people = _people(router_site)
    keys: list[str] = []
    for topic in TOPICS:
        if topic.delivery is not Delivery.LATEST or topic is HEALTH:
            continue
        if topic.placeholder == "user":
            keys += [topic.at(user) for user in people]
        elif not topic.placeholder:
            keys.append(topic.at())
    rate_hz = router_site.dashboard_rate_hz
    return [{"key_expr": f"{root}/{key}", "freq": rate_hz} for key in keys]


def _people(router_site: RouterSite) -> list[str]:
    return [member.name for member in router_site.members if member.role == "user"]


def common_name(site: str, name: str, generation: int) -> str:
    """Return the name of a certificate for the router. It is unique, as no name has a `/`."""
    return f"{site}/{name}/{generation}"
