"""Problems in the ROS graph, in messages that name nodes, cause and remedy."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Literal

from pointit.bridges.ros2.graph.backend import Endpoint, EndpointKind, Graph
from pointit.bridges.ros2.message_format import MAX_NAME, MAX_SHOWN, nodes
from pointit.bridges.ros2.types.types import NO_HASH
from pointit.schemas.text import first_of, one_line

Matching = Literal["definition", "type"]
"""Condition for messages to pass between endpoints of the same name: equal type and definition, or equal type
name."""

End = tuple[str, EndpointKind]
"""Name and kind. An index, since comparing all pairs of endpoints would block the loop."""
Counterparts = Mapping[Endpoint, Sequence[Endpoint]]
"""By own endpoint: the endpoints of others in our domain at the other end."""

COUNTERPART: Mapping[EndpointKind, EndpointKind] = {
    "publisher": "subscriber",
    "subscriber": "publisher",
    "server": "client",
    "client": "server",
}

MAX_HASH = 21
"""Maximum characters of a type's hash in a message."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A problem in the graph, or a note."""

    about: str
    """Key of the problem, stable while the text changes: `type of /user1/button`."""
    sentence: str
    is_note: bool = False
    """Not a problem: explains why nothing happens."""


def findings(
    graph: Graph, *, domain: int, distro: str, needs: str = "", matching: Matching = "definition"
) -> tuple[Finding, ...]:
    """Return the problems between our endpoints and the others, each with its remedy.

    Args:
        graph: with our own endpoints in it.
        domain: ours.
        distro: the configured ROS distribution.
        needs: conditions for other nodes to be seen, as text.
        matching: what two endpoints must share for messages to pass.
    """
    ours = sorted((each for each in graph.endpoints if each.is_ours), key=_order)
    others = [each for each in graph.endpoints if not each.is_ours and each.domain == domain]
    other_domains = [
        each
        for each in graph.endpoints
        if not each.is_ours and not each.is_bridge and each.domain != domain  # for another PointIt
    ]
    found = [*_bridges(others, domain), *_generations(others, distro)]
    wanted = {_counterpart(mine) for mine in ours}
    offered: dict[End, list[Endpoint]] = defaultdict(list)
    for each in others:
        if _end(each) in wanted:
            offered[_end(each)].append(each)
    counterparts = {mine: sorted(offered.get(_counterpart(mine), ()), key=_order) for mine in ours}
    for mine, remote in counterparts.items():
        found += _types(mine, remote, matching)
        found += _qualities(mine, [each for each in remote if _can_match(mine, each, matching)])
    found += _domains(counterparts, other_domains, domain, is_alone=not others)
    where = f"in domain {domain}{needs and f': {needs}'}"
    if not others:
        found.append(Finding(about="nobody", is_note=True, sentence=f"no other ROS node is seen {where}"))
    return tuple({each.about: each for each in reversed(found)}.values())[::-1]


def _bridges(others: Iterable[Endpoint], domain: int) -> list[Finding]:
    names = sorted({one_line(each.node, MAX_NAME) for each in others if each.is_bridge})
    if not names:
        return []
    return [
        Finding(
            about="bridge",
            sentence=f"another PointIt bridge is node {first_of(names, MAX_SHOWN)} in this domain "
            f"({domain}): we do not listen to it, but ROS nodes take the people and objects of both for the "
            "same; give one of the two another backend.domain_id and backend.node",
        )
    ]


def _generations(others: Iterable[Endpoint], distro: str) -> list[Finding]:
    is_humble = distro == "humble"
    other = [each for each in others if each.type.hash and (each.type.hash == NO_HASH) != is_humble]
    if not other:
        return []
    if is_humble:
        sentence = (
            f"ROS {nodes(other, 'is', 'are')} not of Humble, whose messages and those of later "
            "distributions never reach each other; set distro to theirs (jazzy, kilted, …)"
        )
    else:
        sentence = (
            f"ROS {nodes(other, 'is', 'are')} of Humble, whose messages have no type hash and never reach "
            f"those of {distro}; set distro to humble, or let them run {distro}"
        )
    return [Finding(about="distro", sentence=sentence)]


def _types(mine: Endpoint, counterparts: Iterable[Endpoint], matching: Matching) -> list[Finding]:
    found: list[Finding] = []
    mismatched = [each for each in counterparts if each.type.name != mine.type.name]
    if mismatched:
        found.append(
            Finding(
                about=f"type of {mine.name}",
                sentence=f"ROS {nodes(mismatched, 'uses', 'use')} {mine.name} as "
                f"{one_line(mismatched[0].type.name, MAX_NAME)}, we as {mine.type.name}: nothing arrives; "
                "rename one of the two",
            )
        )
    rebuilt = [
        each
        for each in counterparts
        if each.type.name == mine.type.name
        and not _is_same(mine, each)
        and NO_HASH not in (each.type.hash, mine.type.hash)
    ]
    if rebuilt:
        package = mine.type.name.partition("/")[0]
        what = "nothing arrives" if matching == "definition" else "what arrives is dropped or misread"
        found.append(
            Finding(
                about=f"definition of {mine.name}",
                sentence=f"ROS {nodes(rebuilt, 'uses', 'use')} a different definition of {mine.type.name}: "
                f"on {mine.name} expected {one_line(mine.type.hash, MAX_HASH)}, saw "
                f"{one_line(rebuilt[0].type.hash, MAX_HASH)}, and {what}; rebuild {package} there from "
                "PointIt's folder interfaces, or from a distribution whose definition is the same",
            )
        )
    return found


def _qualities(mine: Endpoint, counterparts: Iterable[Endpoint]) -> list[Finding]:
    """Return findings about QoS that does not match ours under the rules of DDS, even where it does here."""
    for why, has in (
        ("wants it reliable from a best-effort writer", attrgetter("reliable")),
        (
            "wants earlier messages (transient local) from a writer that stores none (volatile)",
            attrgetter("latched"),
        ),
    ):
        conflicting: list[Endpoint] = []
        for other in counterparts:
            writer, reader = (mine, other) if mine.kind == "publisher" else (other, mine)
            if writer.qos and reader.qos and mine.kind in ("publisher", "subscriber"):
                conflicting += [other] if has(reader.qos) and not has(writer.qos) else []
        if conflicting:
            side = "the subscriber, which is ours," if mine.kind == "subscriber" else "the subscriber"
            return [
                Finding(
                    about=f"QoS of {mine.name}",
                    sentence=f"QoS of ROS {nodes(conflicting)} on {mine.name} does not match ours: {side} "
                    f"{why}; by the rules of DDS nothing would arrive, change one of the two",
                )
            ]
    return []


def _domains(
    counterparts: Counterparts, other_domains: Iterable[Endpoint], domain: int, *, is_alone: bool
) -> list[Finding]:
    found = list(other_domains)
    if not is_alone:  # another robot's domain is normal, unless it has endpoints for us
        missing = {_counterpart(mine) for mine, remote in counterparts.items() if not remote}
        found = [each for each in found if _end(each) in missing]
    if not found:
        return []
    remote = sorted({each.domain for each in found})
    return [
        Finding(
            about="domain",
            sentence=f"ROS {nodes(found, 'is', 'are')} in domain {first_of(map(str, remote), MAX_SHOWN)}, "
            f"we are in {domain}: nothing arrives; set domain_id to {remote[0]}, or start them with "
            f"ROS_DOMAIN_ID={domain}",
        )
    ]


def _end(endpoint: Endpoint) -> End:
    return endpoint.name, endpoint.kind


def _counterpart(mine: Endpoint) -> End:
    """Return name and kind of the counterpart."""
    return mine.name, COUNTERPART[mine.kind]


def _can_match(mine: Endpoint, other: Endpoint, matching: Matching) -> bool:
    """Return True if messages pass between the two endpoints."""
    return mine.type.name == other.type.name if matching == "type" else _is_same(mine, other)


def _is_same(mine: Endpoint, other: Endpoint) -> bool:
    """Return True if both have the same definition, or it is unknown."""
    hashes = {mine.type.hash, other.type.hash} - {""}
    return mine.type.name == other.type.name and len(hashes) <= 1


def _order(endpoint: Endpoint) -> tuple[str, str, str]:
    return (endpoint.name, endpoint.kind, endpoint.node)
