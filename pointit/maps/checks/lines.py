"""Checks of belts, their links and strips, and of a map's unit, extent and clouds."""

import math
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from pointit.geometry.polyline import SAME_M, Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.checks.finding import MapFinding, error, warning
from pointit.maps.checks.things import line_places
from pointit.maps.environment import Lane, enters_at, lanes_of, leaves_at
from pointit.maps.light_files.strip_fit import shared_pixels
from pointit.maps.model import LinkEntry, MapFile, StripEntry
from pointit.runtime.config.validation_message import join_names
from pointit.schemas.environment import BESIDE_BELT_M
from pointit.schemas.text import round_beyond

Lanes = Mapping[str, Lane]

AT_END_M = 0.05
"""Distance within which a position is at a line's end, m."""
SAMPLES = 50
DENSITY_SPREAD = 0.2
LENGTH_SPREAD = 0.01
LENGTH_M = 0.01
SHARPEST_DEG = 120.0
FEW_PIXELS = 5
"""Number of pixels below which their density is meaningless."""
TRACED = 0.2
"""Number of vertices a pixel above which a line follows the pixels, and means its sharp turns."""
OFF_SHARE = 0.1
"""Share of a strip that may lie beyond its belt's end."""

MAX_HEIGHT_M = 20.0
"""Height in a room above which its unit is probably another, m."""
MAX_BELOW_FLOOR_M = 0.3
"""Depth of a point cloud below the floor above which its axes are probably others, m."""
MAX_WIDTH_M = 1000.0
"""Horizontal extent above which the unit is probably another, m."""
MIN_DENSITY = 1.5
"""Pixels per metre of strips below which the unit is probably another. Strips have 30 to 144, strings 5."""


def check_belts(file: MapFile, lanes: Lanes, links: Sequence[tuple[int, LinkEntry]]) -> Iterator[MapFinding]:
    """Yield problems of links and bays; `links` have the indices in the file of those whose lanes exist.

    file: map.
        file: the map.
        lanes: lanes of the map by name.
        links: links whose lanes exist, with their indices in the file.
    """
    for index, link in links:
        yield from _check_link(index, link, lanes)
    yield from _check_duplicate_links(links)
    plain_links = [link for _, link in links]
    bays = {bay: lane for bay, lane in file.bays.items() if lane in lanes}
    yield from _check_bays(bays, plain_links, lanes)
    if file.belts:
        yield from _check_missing_links(plain_links, lanes)
    if plain_links or bays:
        section = "belts" if file.belts else "strips"
        yield from _check_loose_lanes(section, plain_links, set(bays.values()), lanes)
    yield from _check_circles(plain_links, set(bays.values()), lanes)


def _check_link(index: int, link: LinkEntry, lanes: Lanes) -> Iterator[MapFinding]:
    where = f"links.{index}"
    source = lanes[link.source]
    target = lanes[link.target]
    leaves = leaves_at(link, source)
    enters = enters_at(link, target)
    width = max(source.width_m, target.width_m)
    a = source.line.point_at(leaves)
    b = target.line.point_at(enters)
    if math.dist(a, b) > width:
        others = [lane for lane in lanes.values() if lane.name not in (source.name, target.name)]
        bare = _uncovered_m(a, b, others)
        if bare > width:
            distance = round_beyond(bare, width, 2)
            yield error(
                where,
                f"{source.name} at {leaves:.3g} m and {target.name} at {enters:.3g} m are {distance} m "
                f"apart, more than a belt's width of {width:g} m; correct the positions, or the lines",
            )
    if enters > target.line.length_m - AT_END_M:
        yield warning(
            where,
            f"{target.name} is entered at its end, at {enters:.3g} m; reverse its line, or correct the link",
        )


def _uncovered_m(a: Vec3, b: Vec3, others: Sequence[Lane]) -> float:
    """Return the length of the straight from `a` to `b` outside of `others`, since links may cross belts."""
    places = np.linspace(a, b, SAMPLES)
    covered = np.zeros(SAMPLES, dtype=bool)
    for lane in others:
        _, distances_m = lane.line.nearest_to(places)
        covered |= distances_m <= lane.width_m / 2
    return math.dist(a, b) * (1.0 - float(covered.mean()))


def _check_duplicate_links(links: Sequence[tuple[int, LinkEntry]]) -> Iterator[MapFinding]:
    seen: dict[str, int] = {}
    for index, link in links:
        link_text = repr(link)
        if link_text in seen:
            yield warning(f"links.{index}", f"is the same as links.{seen[link_text]}; remove one of them")
        seen.setdefault(link_text, index)


def _next_lane(lane: Lane, links: Sequence[LinkEntry]) -> str | None:
    """Return the lane that follows the end of `lane` by a link, or None."""
    end_m = lane.line.length_m - AT_END_M
    for link in links:
        if link.source == lane.name and leaves_at(link, lane) >= end_m:
            return link.target
    return None


def _check_bays(bays: Mapping[str, str], links: Sequence[LinkEntry], lanes: Lanes) -> Iterator[MapFinding]:
    owners: dict[str, str] = {}
    for bay, name in bays.items():
        target = _next_lane(lanes[name], links)
        if target is not None:
            yield error(
                f"bays.{bay}",
                f"{name} does not end here, it leads on to {target}; remove the link, or give another belt",
            )
        if name in owners:
            yield error(f"bays.{bay}", f"{name} ends at bay {owners[name]} already; remove one of them")
        owners.setdefault(name, bay)


def _check_missing_links(links: Sequence[LinkEntry], lanes: Lanes) -> Iterator[MapFinding]:
    """Yield belts that begin or end beside another one without a link to it."""
    joined_pairs = {(link.source, link.target) for link in links}
    fed = {link.target for link in links}
    around = _Around(lanes)
    for lane in lanes.values():
        for at_start in (False, True):
            # The end of the lane, unless it is linked
            has_link = lane.name in fed if at_start else _next_lane(lane, links) is not None
            if has_link:
                continue
            place = lane.line.point_at(0.0 if at_start else lane.line.length_m)

            # A lane beside it. Two lanes that meet are found from both, and reported once.
            other, position = _nearest_lane(place, lane, around.near(place), at_start=at_start)
            if other is None:
                continue
            pair = (other.name, lane.name) if at_start else (lane.name, other.name)
            if pair in joined_pairs:
                continue
            joined_pairs.add(pair)
            text = _link_text(pair, other, position, at_start=at_start)
            verb = "begins" if at_start else "ends"
            yield warning(
                f"belts.{lane.name}",
                f"{verb} beside {other.name} and no link joins them; if objects pass there, add to links: "
                f"{text}",
            )


class _Around:
    """Bounding boxes of lanes, extended by a lane's width. All pairs of 1000 lanes would take minutes."""

    def __init__(self, lanes: Lanes) -> None:
        self._lanes = list(lanes.values())
        widest_m = max(lane.width_m for lane in self._lanes)
        vertices_m = [lane.line.vertices_m for lane in self._lanes]
        lows_m = [line_m.min(axis=0) for line_m in vertices_m]
        highs_m = [line_m.max(axis=0) for line_m in vertices_m]
        self._low = np.array(lows_m) - widest_m
        self._high = np.array(highs_m) + widest_m

    def near(self, place: Vec3) -> list[Lane]:
        """Return a superset of the lanes within a lane's width of `place`."""
        is_between = (self._low <= place) & (self._high >= place)
        inside = np.all(is_between, axis=1)
        return [self._lanes[index] for index in np.flatnonzero(inside)]


def _nearest_lane(
    place: Vec3, lane: Lane, lanes: Iterable[Lane], *, at_start: bool
) -> tuple[Lane | None, float]:
    """Return the nearest other lane within a belt's width of `place`, and the position on it, or None.

    Belts that begin or end side by side are neighbours without a handover.
    """
    best: tuple[float, Lane | None, float] = (math.inf, None, 0.0)
    for other in lanes:
        if other.name == lane.name:
            continue
        positions, distances = other.line.nearest_to(np.array([place]))
        distance = float(distances[0])
        position = float(positions[0])
        is_neighbour = position > other.line.length_m - AT_END_M
        if at_start:
            is_neighbour = position < AT_END_M
        if is_neighbour or distance > max(lane.width_m, other.width_m):
            continue
        if distance < best[0]:
            best = (distance, other, position)
    return best[1:]


def _link_text(pair: tuple[str, str], other: Lane, position: float, *, at_start: bool) -> str:
    """Return the entry of `links` for a pair of lanes that meet at `position` of `other`."""
    source, target = pair
    if at_start and position < other.line.length_m - AT_END_M:
        return f"- {{from: {source}, from_position: {position:.3f}, to: {target}}}"
    if not at_start and position > AT_END_M:
        return f"- {{from: {source}, to: {target}, to_position: {position:.3f}}}"
    return f"- {{from: {source}, to: {target}}}"


def _check_loose_lanes(
    section: str, links: Sequence[LinkEntry], bays: set[str], lanes: Lanes
) -> Iterator[MapFinding]:
    """Yield lanes without connection, in a map with links or bays."""
    touched = set(bays)
    entered_at_start: set[str] = set()
    for link in links:
        touched |= {link.source, link.target}
        if enters_at(link, lanes[link.target]) < AT_END_M:
            entered_at_start.add(link.target)
    for lane in lanes.values():
        where = f"{section}.{lane.name}"
        if lane.name not in touched:
            yield warning(where, "nothing leads to it or from it; add it to links, or give it a bay")
            continue
        needs_exit = bool(bays) and lane.name not in bays
        if needs_exit and _next_lane(lane, links) is None:
            yield warning(
                where, "ends without a bay and without a link; say in links where it leads, or give it a bay"
            )
    if entered_at_start.issuperset(lanes):
        yield warning(section, "none has a start that is free, so nothing can be fed; free one of its links")


def _check_circles(links: Sequence[LinkEntry], bays: set[str], lanes: Lanes) -> Iterator[MapFinding]:
    """Yield circles that objects never leave. Without bays, objects leave where a lane has no link."""
    if not links:
        return
    exits = bays
    if not exits:
        exits = {name for name, lane in lanes.items() if _next_lane(lane, links) is None}

    # Graph of links: one follows another if it leaves the lane behind where that enters it
    pairs = _following_links(links, lanes)
    first_indices = [first for first, _ in pairs]
    next_indices = [following for _, following in pairs]
    ones = np.ones(len(pairs))
    shape = (len(links), len(links))
    follows = csr_array((ones, (first_indices, next_indices)), shape=shape)

    # Links from which an exit can be reached, from the exits backwards
    reaches_exit = np.array([link.target in exits for link in links])
    while True:
        extended = reaches_exit | (follows @ reaches_exit > 0)
        if extended.sum() <= reaches_exit.sum():
            break
        reaches_exit = extended

    # Circles among the others. A component of one link is none, unless that follows itself.
    count, component = connected_components(follows, directed=True, connection="strong")
    for number in range(count):
        is_member = (component == number) & ~reaches_exit
        members = {int(index) for index in np.flatnonzero(is_member)}
        if not any(members.issuperset(pair) for pair in pairs):
            continue
        names = join_names(dict.fromkeys(links[index].target for index in sorted(members)))
        text = f"objects on {names} circulate forever; link one of these to a belt that"
        if bays:
            yield error("links", f"{text} has a bay")
        else:
            yield warning("links", f"{text} ends")


def _following_links(links: Sequence[LinkEntry], lanes: Lanes) -> list[tuple[int, int]]:
    """Return pairs of indices of a link and one that leaves the lane where objects still come by."""
    leaving: dict[str, list[int]] = {}
    for index, link in enumerate(links):
        leaving.setdefault(link.source, []).append(index)
    pairs: list[tuple[int, int]] = []
    for index, link in enumerate(links):
        lane = lanes[link.target]
        entered_m = enters_at(link, lane)
        for following in leaving.get(link.target, ()):
            if leaves_at(links[following], lane) >= entered_m:
                pairs.append((index, following))
    return pairs


def check_strips(file: MapFile) -> Iterator[MapFinding]:
    """Yield problems of strips: beside no belt, too many pixels or too few."""
    lines = {name: Polyline(strip.line) for name, strip in file.strips.items()}
    if file.belts:
        lanes = lanes_of(file)
        for name, line in lines.items():
            yield from _check_beside(name, line, lanes)
    for name, other in shared_pixels(file.strips):
        yield warning(
            f"strips.{name}",
            f"has pixels of the wire that {other} has, too; correct an offset, or give each its own output",
        )

    # Strips of one map are mostly of one kind. Their lines must have pixels in order to be compared.
    densities: dict[str, float] = {}
    for name, strip in file.strips.items():
        if is_even(strip):
            densities[name] = strip.pixels / lines[name].length_m
    if len(densities) < 2:
        return
    median = statistics.median(densities.values())
    for name, density in densities.items():
        if abs(density / median - 1.0) <= DENSITY_SPREAD:
            continue
        length = lines[name].length_m
        usual_pixels = max(1, round(median * length))
        yield warning(
            f"strips.{name}",
            f"{file.strips[name].pixels} pixels on {length:.2f} m are {density:.1f} a metre and the "
            f"strips' median is {median:.1f}; correct pixels (to about {usual_pixels}) "
            "or the line, unless it is another kind of strip",
        )


def is_even(strip: StripEntry) -> bool:
    """Return True if the pixels per metre mean something: the strip is long enough and makes no detours.

    A line through pixels of another program makes a detour where they are irregular, as the wire does.
    """
    return strip.pixels >= FEW_PIXELS and not has_detours(strip)


def has_detours(strip: StripEntry) -> bool:
    """Return True if its line turns back between pixels, as one through irregular pixels does."""
    return len(strip.line) > TRACED * strip.pixels and bool(_sharp_turns(strip.line))


def check_lines(file: MapFile) -> Iterator[MapFinding]:
    """Yield problems of lines: a wrong `length`, vertices twice or out of order."""
    for name, strip in file.strips.items():
        yield from _check_line(f"strips.{name}", strip.line, strip.length, is_winding=has_detours(strip))
    for name, belt in file.belts.items():
        yield from _check_line(f"belts.{name}", belt.centerline, belt.length)


def _check_beside(name: str, line: Polyline, lanes: Mapping[str, Lane]) -> Iterator[MapFinding]:
    """Yield a strip of which more than `OFF_SHARE` lies beside no belt."""
    # Distances of places of the strip from the edge of each belt
    places = line.points_at(np.linspace(0.0, line.length_m, SAMPLES))
    beyond_m: dict[str, NDArray[np.float64]] = {}
    for belt, lane in lanes.items():
        _, distances_m = lane.line.nearest_to(places)
        beyond_m[belt] = distances_m - lane.width_m / 2
    is_off = np.min(list(beyond_m.values()), axis=0) > BESIDE_BELT_M
    share = float(is_off.mean())
    if share <= OFF_SHARE:
        return

    # The belt that is probably meant
    nearest = min(beyond_m, key=lambda belt: float(beyond_m[belt].mean()))
    farthest_m = float(beyond_m[nearest].max())
    extent = "lies" if share == 1.0 else f"{share:.0%} of it lies"
    yield warning(
        f"strips.{name}",
        f"{extent} beside no belt, its pixels are up to {farthest_m:.2f} m from the edge of {nearest}; "
        f"correct its line (a strip shows what is on belts up to {BESIDE_BELT_M:g} m beside it)",
    )


def _check_line(
    where: str, vertices: Sequence[Vec3], given: float | None, *, is_winding: bool = False
) -> Iterator[MapFinding]:
    """Yield a wrong `given` length, equal vertices, and sharp turns unless the line `is_winding`."""
    length = Polyline(vertices).length_m
    tolerance = max(LENGTH_M, LENGTH_SPREAD * length)
    if given is not None and abs(given - length) > tolerance:
        yield warning(
            where, f"length is given as {given:g} m and the line is {length:.3f} m long; correct one of them"
        )
    edges = np.diff(np.array(vertices), axis=0)
    steps = np.linalg.norm(edges, axis=1)
    for index in np.flatnonzero(steps <= SAME_M).tolist():
        yield warning(
            where, f"vertex {index + 1} is where vertex {index} is, {list(vertices[index])}; remove it"
        )
    if is_winding:
        return
    for vertex, turn in _sharp_turns(vertices):
        yield warning(
            where, f"turns by {turn:.0f}° at vertex {vertex}, {list(vertices[vertex])}; put vertices in order"
        )


def _sharp_turns(vertices: Sequence[Vec3]) -> list[tuple[int, float]]:
    """Return index and angle (degrees) of the vertices where a line turns by more than `SHARPEST_DEG`."""
    steps = np.diff(np.array(vertices), axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    is_distinct = lengths > SAME_M
    starts = np.flatnonzero(is_distinct)
    tangents = steps[is_distinct] / lengths[is_distinct, None]
    cosines = np.einsum("ij,ij->i", tangents[:-1], tangents[1:])
    turns = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    sharp = np.flatnonzero(turns > SHARPEST_DEG)
    return [(int(starts[1 + index]), float(turns[index])) for index in sharp]


def check_extent(file: MapFile, clouds: Mapping[str, NDArray[np.float64]]) -> Iterator[MapFinding]:
    """Yield a map in another unit, clouds below the floor or too high; `clouds` are n x 3, in {W}."""
    # Everything that has a position
    centers = [box.center for box in file.boxes.values()]
    centers += [cylinder.center for cylinder in file.cylinders.values()]
    centers += [sphere.center for sphere in file.spheres.values()]
    for thing in file.things.values():
        if thing.center is not None:
            centers.append(thing.center)
    places = np.array([*line_places(file), *centers]).reshape(-1, 3)
    if len(places):
        width_m = float(np.ptp(places[:, :2], axis=0).max())
        height_m = float(places[:, 2].max())
        density = _density(file)
        sparse = f", its strips have {density:.2g} pixels a metre" if density < MIN_DENSITY else ""
        is_too_large = height_m > MAX_HEIGHT_M or width_m > MAX_WIDTH_M
        if is_too_large or sparse:
            text = f"{_extent(width_m, height_m)}{sparse}; give positions in metres"
            yield warning("map", text)

    # Clouds have a unit and axes of their own
    for name, points in clouds.items():
        low_m = float(points[:, 2].min())
        high_m = float(np.ptp(points[:, 2]))
        if low_m < -MAX_BELOW_FLOOR_M:
            yield warning(
                f"clouds.{name}",
                f"reaches {-low_m:.1f} m below the floor; set up to the axis of the file that points up, "
                "such as up: y, or position",
            )
        if high_m > MAX_HEIGHT_M:
            yield warning(f"clouds.{name}", f"is {high_m:.0f} m high; set unit, if it is not in metres")


def _extent(width_m: float, height_m: float) -> str:
    text = f"is {width_m:.0f} m wide"
    if height_m > MAX_HEIGHT_M:
        text += f" and {height_m:.0f} m high"
    return text


def _density(file: MapFile) -> float:
    """Return the median of the pixels per metre of strips, infinite if none has enough pixels."""
    densities: list[float] = []
    for strip in file.strips.values():
        if is_even(strip):
            densities.append(strip.pixels / Polyline(strip.line).length_m)
    return float(np.median(densities)) if densities else math.inf
