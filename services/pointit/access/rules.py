"""Rights as Zenoh's access-control rules, which a router applies to connections by their certificate.

`**` never covers a key below `@`. Publishers of states and events exchange data with late subscribers below
`@adv` of their key, and the test of an identity's own rights (`runtime.zenoh.permission_probe`) is below
`@may`. Both are granted with the key itself, for both flows, since denied traffic disappears silently.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from pointit.access.rights import ALL, Rights
from pointit.runtime.link.link import ROOM, VERBS

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

    mine = [f"{root}/{ALL}/{ROOM}/{name}/{ALL}"]
    tested = [f"{root}/{ROOM}/{name}/*"]
    for verb in VERBS:
        tested += tests(getattr(rights, verb), verb)
    written, read = [*at(rights.writes), *late(rights.writes)], [*at(rights.reads), *late(rights.reads)]
    site_wide = list(all_key_expressions(site)[:2])
    grants: Sequence[tuple[str, Sequence[str], str, list[str]]] = (
        ("write", ("put",), "ingress", [*written, *tested]),
        (
            "keep",
            ("declare_queryable",),
            "ingress",
            [*at(rights.serves), *at(rights.keeps), *late(rights.writes)],
        ),
        ("reply", ("reply",), "ingress", [*at(rights.serves), *at(rights.keeps), *written]),
        ("announce", ("liveliness_token",), "ingress", [*at(rights.announces), *late(rights.writes)]),
        ("read", ("declare_subscriber",), "ingress", [*read, *mine]),
        ("ask", ("query",), "ingress", [*at(rights.asks), *read]),
        (
            "watch",
            ("liveliness_query", "declare_liveliness_subscriber"),
            "ingress",
            [*at(rights.watches), *late(rights.reads)],
        ),
        ("hear", ("put",), "egress", [*read, *mine]),
        ("answered", ("reply",), "egress", [*at(rights.asks), *read]),
        ("see", ("liveliness_token",), "egress", [*at(rights.watches), *late(rights.reads)]),
        (
            "know",
            ("declare_subscriber", "declare_queryable", "query", "liveliness_query"),
            "egress",
            site_wide,
        ),
        ("know-watchers", ("declare_liveliness_subscriber",), "egress", site_wide),
    )
    return [
        {
            "id": f"{prefix}/{what}",
            "permission": "allow",
            "messages": list(messages),
            "flows": [flow],
            "key_exprs": sorted(set(keys)),
        }
        for what, messages, flow, keys in grants
        if keys
    ]
