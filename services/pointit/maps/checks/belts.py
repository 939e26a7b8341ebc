"""Checks of belts and their links."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from pointit.geometry.vector import Vec3
from pointit.maps.checks.finding import MapFinding, error, warning
from pointit.maps.lanes import Lane, enters_at, leaves_at
from pointit.maps.model import LinkEntry, MapFile
from pointit.runtime.config.validation_message import join_names
from pointit.schemas.text import round_beyond

AT_END_M = 0.05
"""Distance within which a position is at a line's end, m."""
SAMPLES = 50

Lanes = Mapping[str, Lane]


def check_belts(file: MapFile, lanes: Lanes, links: Sequence[tuple[int, LinkEntry]]) -> Iterator[MapFinding]:
    """Yield problems of links and bays; `links` have the indices in the file of those whose lanes exist.

    file: map.
        file: the map.
        lanes: lanes of the map by name.
        links: links whose lanes exist, with their indices in the file.
    """
    for index, link in links:
        yield from _check_link(index, link, lanes)
    yield from _twice(links)
    plain = [link for _, link in links]
    bays = {bay: lane for bay, lane in file.bays.items() if lane in lanes}
    yield from _check_bays(bays, plain, lanes)
    if file.belts:
        yield from _missing_links(plain, lanes)
    if plain or bays:
        yield from _loose_lanes("belts" if file.belts else "strips", plain, set(bays.values()), lanes)
    yield from _endless(plain, set(bays.values()), lanes)


def _check_link(index: int, link: LinkEntry, lanes: Lanes) -> Iterator[MapFinding]:
    where = f"links.{index}"
    source, target = lanes[link.source], lanes[link.target]
    leaves, enters = leaves_at(link, source), enters_at(link, target)
    width = max(source.width_m, target.width_m)
    a, b = source.line.point_at(leaves), target.line.point_at(enters)
    if math.dist(a, b) > width:
        others = [lane for lane in lanes.values() if lane.name not in (source.name, target.name)]
        bare = _bare_m(a, b, others)
        if bare > width:
            yield error(
                where,
                f"{source.name} at {leaves:.3g} m and {target.name} at {enters:.3g} m are "
                f"{round_beyond(bare, width, 2)} m "
                f"apart, more than a belt's width of {width:g} m; correct the positions, or the lines",
            )
    if enters > target.line.length_m - AT_END_M:
        yield warning(
            where,
            f"{target.name} is entered at its end, at {enters:.3g} m; reverse its line, or correct the link",
        )


def _bare_m(a: Vec3, b: Vec3, others: Sequence[Lane]) -> float:
    """Return the length of the straight from `a` to `b` outside of `others`, since links may cross belts."""
    places = np.linspace(a, b, SAMPLES)
    covered = np.zeros(SAMPLES, dtype=bool)
    for lane in others:
        covered |= lane.line.nearest_to(places)[1] <= lane.width_m / 2
    return math.dist(a, b) * (1.0 - float(covered.mean()))


def _twice(links: Sequence[tuple[int, LinkEntry]]) -> Iterator[MapFinding]:
    seen: dict[str, int] = {}
    for index, link in links:
        link_text = repr(link)
        if link_text in seen:
            yield warning(f"links.{index}", f"is the same as links.{seen[link_text]}; remove one of them")
        seen.setdefault(link_text, index)


def _goes_on(lane: Lane, links: Sequence[LinkEntry]) -> str | None:
    """Return the lane that follows the end of `lane` by a link, or None."""
    for link in links:
        if link.source == lane.name and leaves_at(link, lane) >= lane.line.length_m - AT_END_M:
            return link.target
    return None


def _check_bays(bays: Mapping[str, str], links: Sequence[LinkEntry], lanes: Lanes) -> Iterator[MapFinding]:
    owners: dict[str, str] = {}
    for bay, name in bays.items():
        target = _goes_on(lanes[name], links)
        if target is not None:
            yield error(
                f"bays.{bay}",
                f"{name} does not end here, it leads on to {target}; remove the link, or give another belt",
            )
        if name in owners:
            yield error(f"bays.{bay}", f"{name} ends at bay {owners[name]} already; remove one of them")
        owners.setdefault(name, bay)


def _missing_links(links: Sequence[LinkEntry], lanes: Lanes) -> Iterator[MapFinding]:
    """Yield belts that begin or end beside another one without a link to it."""
    known = {(link.source, link.target) for link in links}
    fed = {link.target for link in links}
    around = _Around(lanes)
    for lane in lanes.values():
        for at_start in (False, True):
            if lane.name in fed if at_start else _goes_on(lane, links) is not None:
                continue
            place = lane.line.point_at(0.0 if at_start else lane.line.length_m)
            other, position = _beside(place, lane, around.near(place), at_start=at_start)
            if other is None:
                continue
            pair = (other.name, lane.name) if at_start else (lane.name, other.name)
            if pair in known:
                continue
            known.add(pair)
            text = _link_text(pair, other, position, at_start=at_start)
            yield warning(
                f"belts.{lane.name}",
                f"{'begins' if at_start else 'ends'} beside {other.name} and no link joins them; "
                f"if objects pass there, add to links: {text}",
            )


class _Around:
    """Bounding boxes of lanes, extended by a lane's width. All pairs of 1000 lanes would take minutes."""

    def __init__(self, lanes: Lanes) -> None:
        self._lanes = list(lanes.values())
        widest_m = max(lane.width_m for lane in self._lanes)
        self._low = np.array([lane.line.vertices_m.min(axis=0) for lane in self._lanes]) - widest_m
        self._high = np.array([lane.line.vertices_m.max(axis=0) for lane in self._lanes]) + widest_m

    def near(self, place: Vec3) -> list[Lane]:
        """Return a superset of the lanes within a lane's width of `place`."""
        inside = np.all((self._low <= place) & (self._high >= place), axis=1)
        return [self._lanes[index] for index in np.flatnonzero(inside)]


def _beside(place: Vec3, lane: Lane, lanes: Iterable[Lane], *, at_start: bool) -> tuple[Lane | None, float]:
    """Return the nearest other lane within a belt's width of `place`, and the position on it, or None.

    Belts that begin or end side by side are neighbours without a handover.
    """
    best: tuple[float, Lane | None, float] = (math.inf, None, 0.0)
    for other in lanes:
        if other.name == lane.name:
            continue
        positions, distances = other.line.nearest_to(np.array([place]))
        distance, position = float(distances[0]), float(positions[0])
        neighbour = position < AT_END_M if at_start else position > other.line.length_m - AT_END_M
        if not neighbour and distance <= max(lane.width_m, other.width_m) and distance < best[0]:
            best = (distance, other, position)
    return best[1:]


def _link_text(pair: tuple[str, str], other: Lane, position: float, *, at_start: bool) -> str:
    source, target = pair
    if at_start and position < other.line.length_m - AT_END_M:
        return f"- {{from: {source}, from_position: {position:.3f}, to: {target}}}"
    if not at_start and position > AT_END_M:
        return f"- {{from: {source}, to: {target}, to_position: {position:.3f}}}"
    return f"- {{from: {source}, to: {target}}}"


def _loose_lanes(
    section: str, links: Sequence[LinkEntry], bays: set[str], lanes: Lanes
) -> Iterator[MapFinding]:
    """Yield lanes without connection, in a map with links or bays."""
    touched = {link.source for link in links} | {link.target for link in links} | bays
    entered_at_start = {link.target for link in links if enters_at(link, lanes[link.target]) < AT_END_M}
    for lane in lanes.values():
        if lane.name not in touched:
            yield warning(
                f"{section}.{lane.name}", "nothing leads to it or from it; add it to links, or give it a bay"
            )
        elif bays and lane.name not in bays and _goes_on(lane, links) is None:
            yield warning(
                f"{section}.{lane.name}",
                "ends without a bay and without a link; say in links where it leads, or give it a bay",
            )
    if entered_at_start.issuperset(lanes):
        yield warning(section, "none has a start that is free, so nothing can be fed; free one of its links")


def _endless(links: Sequence[LinkEntry], bays: set[str], lanes: Lanes) -> Iterator[MapFinding]:
    """Yield circles that objects never leave. Without bays, objects leave where a lane has no link."""
    if not links:
        return
    exits = bays or {name for name, lane in lanes.items() if _goes_on(lane, links) is None}
    leaving: dict[str, list[int]] = {}
    for index, link in enumerate(links):
        leaving.setdefault(link.source, []).append(index)
    pairs = [
        (index, then)
        for index, link in enumerate(links)
        for then in leaving.get(link.target, ())
        if leaves_at(links[then], lanes[link.target]) >= enters_at(link, lanes[link.target])
    ]
    at = ([first for first, _ in pairs], [then for _, then in pairs])
    follows = csr_array((np.ones(len(pairs)), at), shape=(len(links), len(links)))
    saved = np.array([link.target in exits for link in links])
    while (more := saved | (follows @ saved > 0)).sum() > saved.sum():
        saved = more
    count, circle = connected_components(follows, directed=True, connection="strong")
    for number in range(count):
        members = {int(index) for index in np.flatnonzero((circle == number) & ~saved)}
        if not any(first in members and then in members for first, then in pairs):
            continue
        names = join_names(dict.fromkeys(links[index].target for index in sorted(members)))
        text = f"objects on {names} circulate forever; link one of these to a belt that"
        yield error("links", f"{text} has a bay") if bays else warning("links", f"{text} ends")
