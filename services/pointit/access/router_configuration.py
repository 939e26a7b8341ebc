"""The configuration of a router for one or several sites, for `pointit router` and zenohd alike.

Zenoh knows an identity by the common name of its certificate (or by its user name), so every rule hangs on
one; a name without rules, as that of a certificate that was replaced or revoked, may do nothing at all.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pointit.access.rights import Role, rights_of
from pointit.access.rules import Rule, all_key_expressions, namespace, rules_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import LEASE_MS
from pointit.schemas.topics import ANY, HEALTH, REQUESTS, TOPICS, Delivery, Request, Topic

LARGEST_BYTES = 1024 * 1024
"""No message of a site is longer."""
LARGEST_TRAVELLING_BYTES = 16 * LARGEST_BYTES
"""What is longer is not even put together from its fragments, and nobody learns of it; what is shorter is
dropped where the router knows who sent it, and says so."""
ONE_STREAM = "?multistream=0"
"""Of QUIC: with a stream for each priority, as Zenoh would have it, a question may overtake the declaration
of the key it is about; the router drops it then without a word."""
MOST_SESSIONS = 1000
ACCEPT_MS = 3000
MOST_NEWCOMERS = 500
"""Where TLS lets in who has no certificate, so many may say nothing for so long before others have to wait;
as Zenoh would have it, 100 for 10 s. Half of the files that a process may have open, mostly; `pointit router`
takes what the system lets it, for `MOST_SESSIONS` beside them."""

HEADER = """\
// Made by `pointit site`; changes by hand are lost. For `pointit router --config` and for zenohd alike, which
// has to be started in this folder: the files are named as seen from here.
"""


@dataclass(frozen=True, kw_only=True)
class Member:
    """An identity that may connect."""

    name: str
    role: Role
    common_name: str
    """Of its certificate that is valid now; as user name where there are passwords."""


@dataclass(frozen=True, kw_only=True)
class RouterSite:
    """A site as its router sees it."""

    site: str
    port: int
    members: Sequence[Member]
    former: Sequence[str] = ()
    """Common names of certificates that were replaced or revoked."""
    folder: str = ""
    """Where the router's own files are: nothing (its own folder), or a path with `/` behind."""
    password: bool = False
    """Connections are known by user and password instead of by certificates."""
    dashboard_rate_hz: float = 0.0
    """What dashboards get at most of each *latest* key, by QUIC; 0: as it comes, by TLS."""
    uplinks: tuple[str, ...] = ()
    """Addresses of other routers of the site, that this one connects to."""


def configuration(sites: Sequence[RouterSite], addresses: Sequence[str] = ("0.0.0.0",)) -> dict[str, Any]:  # noqa: S104 - a router is there to be reached; who may what is decided below
    """Return the configuration of a router for `sites`, listening at `addresses` (without port).

    Raises:
        ConfigError: two sites cannot share one router; says why.
    """
    _check(sites)
    listen: list[str] = []
    connect: list[str] = []
    rules: list[Rule] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    thinned: list[dict[str, Any]] = []
    for routed in sites:
        listen += _listeners(routed, addresses)
        connect += [f"{address}#{_client(routed)}" for address in routed.uplinks]
        who = "usernames" if routed.password else "cert_common_names"
        for member in routed.members:
            own = rules_of(routed.site, member.name, rights_of(member.role, member.name))
            rules += own
            subject = f"{routed.site}/{member.name}"
            subjects.append({"id": subject, who: [member.common_name]})
            named = f"{subject}/{member.role}"
            policies.append({"id": named, "rules": [rule["id"] for rule in own], "subjects": [subject]})
        if routed.former:
            nothing, former = f"{routed.site}/nothing", f"{routed.site}/former ones"
            rules.append(_nothing(routed.site, nothing))
            subjects.append({"id": former, who: list(routed.former)})
            policies.append({"rules": [nothing], "subjects": [former]})
        if routed.dashboard_rate_hz:
            thinned += _thinned(routed)
    made: dict[str, Any] = {
        "mode": "router",
        "listen": {"endpoints": listen},
        "connect": {
            "endpoints": connect,
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5},
        },
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},
        "adminspace": {"enabled": False, "permissions": {"read": False, "write": False}},
        "transport": {
            "unicast": {"max_sessions": MOST_SESSIONS},
            "shared_memory": {"enabled": False},
            "link": {
                "protocols": ["tls", "quic"],
                "rx": {"max_message_size": LARGEST_TRAVELLING_BYTES},
                "tx": {"lease": LEASE_MS},
            },
        },
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": rules,
            "subjects": subjects,
            "policies": policies,
        },
        "low_pass_filter": [limit for routed in sites for limit in _limits(routed.site)],
        "qos": {"network": [_never_waits(routed.site) for routed in sites]},
    }
    if thinned:
        made["downsampling"] = [
            {
                "id": "dashboards",
                "link_protocols": ["quic"],
                "messages": ["put"],
                "flows": ["egress"],
                "rules": thinned,
            }
        ]
    if any(routed.password for routed in sites):
        (routed,) = sites
        made["transport"]["auth"] = {"usrpwd": {"dictionary_file": f"{routed.folder}users.txt"}}
        made["transport"]["unicast"] |= {"accept_timeout": ACCEPT_MS, "accept_pending": MOST_NEWCOMERS}
    else:
        # Of clients' certificates: of who has none Zenoh would warn at each connection.
        made["transport"]["link"]["tls"] = {"close_link_on_expiration": True}
    return made


def to_json5(sites: Sequence[RouterSite], addresses: Sequence[str] = ("0.0.0.0",)) -> str:  # noqa: S104 - as above
    """Return `configuration` as JSON5, with a word on what it is."""
    return HEADER + json.dumps(configuration(sites, addresses), indent=1) + "\n"


def _check(sites: Sequence[RouterSite]) -> None:
    ports: dict[int, str] = {}
    names: set[str] = set()
    for routed in sites:
        if routed.site in names:
            raise ConfigError(f"site {routed.site} is given twice; two sites of one router need two names")
        names.add(routed.site)
        other = ports.setdefault(routed.port, routed.site)
        if other != routed.site:
            raise ConfigError(
                f"sites {other} and {routed.site} both have port {routed.port}; on one router each "
                "has a certificate and so a port of its own: make one of them with --port"
            )
        if routed.password and routed.uplinks:
            raise ConfigError(
                f"site {routed.site} goes by passwords, with which its router joins no other; make it with "
                "certificates"
            )
        if routed.password and len(sites) > 1:
            raise ConfigError(
                f"site {routed.site} goes by passwords, of which a router knows one site's only; give it a "
                "router of its own, or make it with certificates"
            )


def _listeners(routed: RouterSite, addresses: Sequence[str]) -> list[str]:
    files = routed.folder
    server = f"listen_certificate_file={files}cert.pem;listen_private_key_file={files}key.pem"
    if not routed.password:
        server += f";root_ca_certificate_file={files}ca.pem;enable_mtls=true"
    links = (("tls", ""), ("quic", ONE_STREAM)) if routed.dashboard_rate_hz else (("tls", ""),)
    return [
        f"{protocol}/{_bracketed(address)}:{routed.port}{metadata}#{server}"
        for protocol, metadata in links
        for address in addresses
    ]


def _client(routed: RouterSite) -> str:
    files = routed.folder
    return (
        f"root_ca_certificate_file={files}ca.pem;connect_certificate_file={files}cert.pem"
        f";connect_private_key_file={files}key.pem;enable_mtls=true"
    )


def _bracketed(address: str) -> str:
    return f"[{address}]" if ":" in address and not address.startswith("[") else address


def _limits(site: str) -> list[dict[str, Any]]:
    """Return the longest each kind of message may be; where two fit a key, Zenoh takes the smaller."""
    root = namespace(site)
    by_size: dict[tuple[str, int], list[str]] = {}

    def add(row: Topic[Any] | Request[Any, Any], message: str, size: int) -> None:
        key = f"{root}/{row.at(ANY if row.placeholder else '')}"
        by_size.setdefault((message, size), []).append(key)

    for topic in TOPICS:
        for message in ("put", "reply", "query"):
            add(topic, message, topic.message.max_bytes)
    for request in REQUESTS:
        add(request, "query", request.query.max_bytes)
        add(request, "reply", request.reply.max_bytes)
    for message in ("put", "query", "reply"):
        by_size[message, LARGEST_BYTES] = list(all_key_expressions(site))
    return [
        {
            "id": f"{site}/{message}/{size}",
            "messages": [message],
            "flows": ["ingress"],
            "key_exprs": sorted(set(keys)),
            "size_limit": size,
        }
        for (message, size), keys in sorted(by_size.items())
    ]


def _never_waits(site: str) -> dict[str, Any]:
    """Return that the router drops what a reader does not take, however its writer wants it sent.

    A router that waits for a reader that stands still (5 s, Zenoh's default) holds up everybody: its threads
    are few. Our own writers never ask for that; what is lost of states and events is fetched again from them.
    """
    return {
        "id": f"{site}/never waits",
        "messages": ["put", "delete", "query"],
        "key_exprs": list(all_key_expressions(site)),
        "flows": ["ingress"],
        "overwrite": {"congestion_control": "drop"},
    }


def _nothing(site: str, name: str) -> Rule:
    """Return the only right of who has none: Zenoh logs no decision on whom no rule is for."""
    return {
        "id": name,
        "permission": "allow",
        "messages": ["put"],
        "flows": ["egress"],
        "key_exprs": [f"{namespace(site)}/nothing"],
    }


def _thinned(routed: RouterSite) -> list[dict[str, Any]]:
    """Return one rule for each key of each person: those whom one rule covers would share its rate.

    Trackers have names that nobody knows beforehand; their objects come as they are, and so does health.
    """
    root = namespace(routed.site)
    people = [member.name for member in routed.members if member.role == "user"]
    keys: list[str] = []
    for topic in TOPICS:
        if topic.delivery is not Delivery.LATEST or topic is HEALTH:
            continue
        if topic.placeholder == "user":
            keys += [topic.at(user) for user in people]
        elif not topic.placeholder:
            keys.append(topic.at())
    return [{"key_expr": f"{root}/{key}", "freq": routed.dashboard_rate_hz} for key in keys]


def common_name(site: str, name: str, generation: int) -> str:
    """Return by what the router knows a certificate: no name has a `/`, so no two are alike."""
    return f"{site}/{name}/{generation}"
