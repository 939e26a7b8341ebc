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
class GraphFinding:
    """A problem in the graph, or a note."""

    about: str
    """Key of the problem, stable while the text changes: `type of /user1/button`."""
    sentence: str
    is_note: bool = False
    """Not a problem: explains why nothing happens."""


def findings(
    graph: Graph, *, domain: int, distro: str, needs: str = "", matching: Matching = "definition"
) -> tuple[GraphFinding, ...]:
    """Return the problems between our endpoints and the others, each with its remedy.

    Args:
        graph: with our own endpoints in it.
        domain: ours.
        distro: the configured ROS distribution.
        needs: conditions for other nodes to be seen, as text.
        matching: what two endpoints must share for messages to pass.
    """
    ours: list[Endpoint] = []
    others: list[Endpoint] = []
    other_domains: list[Endpoint] = []
    for endpoint in graph.endpoints:
        if endpoint.is_ours:
            ours.append(endpoint)
        elif endpoint.domain == domain:
            others.append(endpoint)
        elif not endpoint.is_bridge:  # bridges of other domains are for another PointIt
            other_domains.append(endpoint)
    ours.sort(key=_order)
    problems = [*_bridges(others, domain), *_generations(others, distro)]

    # Endpoints at the other end of ours
    needed = {_counterpart(mine) for mine in ours}
    offered: dict[End, list[Endpoint]] = defaultdict(list)
    for endpoint in others:
        end = _end(endpoint)
        if end in needed:
            offered[end].append(endpoint)

    # Types first: only where these match, QoS matters
    counterparts: dict[Endpoint, list[Endpoint]] = {}
    for mine in ours:
        remote = sorted(offered.get(_counterpart(mine), ()), key=_order)
        counterparts[mine] = remote
        problems += _types(mine, remote, matching)
        matched = [endpoint for endpoint in remote if _can_match(mine, endpoint, matching)]
        problems += _qualities(mine, matched)
    problems += _domains(counterparts, other_domains, domain, is_alone=not others)

    if not others:
        suffix = f": {needs}" if needs else ""
        sentence = f"no other ROS node is seen in domain {domain}{suffix}"
        problems.append(GraphFinding(about="nobody", is_note=True, sentence=sentence))
    by_subject: dict[str, GraphFinding] = {}
    for finding in reversed(problems):  # of several about the same subject the first counts
        by_subject[finding.about] = finding
    return tuple(reversed(by_subject.values()))


def _bridges(others: Iterable[Endpoint], domain: int) -> list[GraphFinding]:
    bridges = (endpoint for endpoint in others if endpoint.is_bridge)
    names = sorted({one_line(bridge.node, MAX_NAME) for bridge in bridges})
    if not names:
        return []
    sentence = (
        f"another PointIt bridge is node {first_of(names, MAX_SHOWN)} in this domain "
        f"({domain}): we do not listen to it, but ROS nodes take the people and objects of both for the "
        "same; give one of the two another backend.domain_id and backend.node"
    )
    return [GraphFinding(about="bridge", sentence=sentence)]


def _generations(others: Iterable[Endpoint], distro: str) -> list[GraphFinding]:
    """Return a finding about nodes of Humble, or of anything else if `distro` is Humble."""
    is_humble = distro == "humble"
    mismatched: list[Endpoint] = []
    for endpoint in others:
        type_hash = endpoint.type.hash
        if type_hash and (type_hash == NO_HASH) != is_humble:
            mismatched.append(endpoint)
    if not mismatched:
        return []
    listing = nodes(mismatched, "is", "are")
    if is_humble:
        sentence = (
            f"ROS {listing} not of Humble, whose messages and those of later "
            "distributions never reach each other; set distro to theirs (jazzy, kilted, …)"
        )
    else:
        sentence = (
            f"ROS {listing} of Humble, whose messages have no type hash and never reach "
            f"those of {distro}; set distro to humble, or let them run {distro}"
        )
    return [GraphFinding(about="distro", sentence=sentence)]


def _types(mine: Endpoint, counterparts: Iterable[Endpoint], matching: Matching) -> list[GraphFinding]:
    """Return findings about other types under our name, and other definitions under our type."""
    mismatched: list[Endpoint] = []
    rebuilt: list[Endpoint] = []
    for endpoint in counterparts:
        if endpoint.type.name != mine.type.name:
            mismatched.append(endpoint)
        elif not _is_same(mine, endpoint) and NO_HASH not in (endpoint.type.hash, mine.type.hash):
            rebuilt.append(endpoint)

    problems: list[GraphFinding] = []
    if mismatched:
        other_name = one_line(mismatched[0].type.name, MAX_NAME)
        sentence = (
            f"ROS {nodes(mismatched, 'uses', 'use')} {mine.name} as "
            f"{other_name}, we as {mine.type.name}: nothing arrives; "
            "rename one of the two"
        )
        problems.append(GraphFinding(about=f"type of {mine.name}", sentence=sentence))
    if rebuilt:
        package = mine.type.name.partition("/")[0]
        effect = "nothing arrives" if matching == "definition" else "what arrives is dropped or misread"
        expected = one_line(mine.type.hash, MAX_HASH)
        seen = one_line(rebuilt[0].type.hash, MAX_HASH)
        sentence = (
            f"ROS {nodes(rebuilt, 'uses', 'use')} a different definition of {mine.type.name}: "
            f"on {mine.name} expected {expected}, saw "
            f"{seen}, and {effect}; rebuild {package} there from "
            "PointIt's folder interfaces, or from a distribution whose definition is the same"
        )
        problems.append(GraphFinding(about=f"definition of {mine.name}", sentence=sentence))
    return problems


def _qualities(mine: Endpoint, counterparts: Iterable[Endpoint]) -> list[GraphFinding]:
    """Return findings about QoS that does not match ours under the rules of DDS, even where it does here."""
    if mine.kind not in ("publisher", "subscriber"):
        return []
    for problem, has in (
        ("wants it reliable from a best-effort writer", attrgetter("reliable")),
        (
            "wants earlier messages (transient local) from a writer that stores none (volatile)",
            attrgetter("latched"),
        ),
    ):
        # The reader must not want more than the writer offers
        conflicting: list[Endpoint] = []
        for other in counterparts:
            writer = other
            reader = mine
            if mine.kind == "publisher":
                writer = mine
                reader = other
            if writer.qos is None or reader.qos is None:
                continue
            if has(reader.qos) and not has(writer.qos):
                conflicting.append(other)

        if conflicting:
            side = "the subscriber, which is ours," if mine.kind == "subscriber" else "the subscriber"
            sentence = (
                f"QoS of ROS {nodes(conflicting)} on {mine.name} does not match ours: {side} "
                f"{problem}; by the rules of DDS nothing would arrive, change one of the two"
            )
            return [GraphFinding(about=f"QoS of {mine.name}", sentence=sentence)]
    return []


def _domains(
    counterparts: Counterparts, other_domains: Iterable[Endpoint], domain: int, *, is_alone: bool
) -> list[GraphFinding]:
    """Return a finding about nodes in other domains, which never meet ours."""
    outside = list(other_domains)
    if not is_alone:  # another robot's domain is normal, unless it has endpoints for us
        missing = {_counterpart(mine) for mine, remote in counterparts.items() if not remote}
        outside = [endpoint for endpoint in outside if _end(endpoint) in missing]
    if not outside:
        return []
    domains = sorted({endpoint.domain for endpoint in outside})
    listing = first_of(map(str, domains), MAX_SHOWN)
    sentence = (
        f"ROS {nodes(outside, 'is', 'are')} in domain {listing}, "
        f"we are in {domain}: nothing arrives; set domain_id to {domains[0]}, or start them with "
        f"ROS_DOMAIN_ID={domain}"
    )
    return [GraphFinding(about="domain", sentence=sentence)]


def _end(endpoint: Endpoint) -> End:
    return endpoint.name, endpoint.kind


def _counterpart(mine: Endpoint) -> End:
    """Return name and kind of the counterpart."""
    return mine.name, COUNTERPART[mine.kind]


def _can_match(mine: Endpoint, other: Endpoint, matching: Matching) -> bool:
    """Return True if messages pass between the two endpoints."""
    if matching == "type":
        return mine.type.name == other.type.name
    return _is_same(mine, other)


def _is_same(mine: Endpoint, other: Endpoint) -> bool:
    """Return True if both have the same definition, or it is unknown."""
    if mine.type.name != other.type.name:
        return False
    hashes = {mine.type.hash, other.type.hash} - {""}
    return len(hashes) <= 1


def _order(endpoint: Endpoint) -> tuple[str, str, str]:
    return (endpoint.name, endpoint.kind, endpoint.node)
