"""Belts as a directed network: pieces, junctions, and shortest ways to bays."""

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise, product
from typing import Literal

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import BeltLink

Extent = dict[int, tuple[float, float]]
"""Start and end by section; below 0 and beyond the section's length where it continues there."""

NONE = -1
"""Instead of the index of a piece or junction: there is none."""

APART = math.cos(math.radians(10.0))
"""Cosine of the angle above which ways that leave one place diverge there."""
CROSSING_M = 0.05
"""Lines that pass each other closer than this cross."""
SAMPLE_M = 1e-3
"""Distance between the points of a bridge at which crossings are looked for."""
SHARP = math.cos(math.radians(30.0))
"""Cosine of the turn above which packages that follow each other would come closer than along their way."""
MAX_WIDENING = 3.0
"""Largest factor by which junctions of ways at a narrow angle are extended."""
BENT = 1.05
"""Additional factor, since the angle may change along the way."""
PAST_M = 1e-3
SNAP_M = 1e-3
"""Places on a belt closer together than this are merged; shorter gaps are closed."""


@dataclass(slots=True, eq=False)
class Piece:
    """A directed part of a section of a belt, or of the bridge of a link. It lies in one junction or in none.

    Positions on it are offsets from the start of its section.
    """

    index: int
    section: int
    """Number of the section or bridge."""
    belt: str
    """Belt whose speed it has; for a bridge the belt it comes from."""
    line: Polyline
    start_m: float
    """Arc length on `line` where the section starts."""
    from_m: float
    """Offset at which the piece starts."""
    to_m: float
    """Offset at which the piece ends."""
    target: str = ""
    """Belt that a bridge leads to, or `""` for a section."""
    halves: tuple[float | None, float | None] = (None, None)
    """For a bridge: arc length on its belt if it starts at the belt's end, and on its target's start, else
    None."""
    bay: str = ""
    """Bay at its end."""
    junction: int = NONE
    before: int = NONE
    """The previous piece of the same belt."""
    successors: list[int] = field(default_factory=list[int])
    """Pieces that begin at its end; straight on along the belt comes first."""
    predecessors: list[int] = field(default_factory=list[int])
    """Pieces that end at its beginning."""

    @property
    def length_m(self) -> float:
        """Return its length."""
        return self.to_m - self.from_m

    def point(self, offset_m: float) -> Vec3:
        """Return the position in {W} at `offset_m` from the start of this piece of a belt."""
        return self.line.point_at(self.start_m + offset_m)

    def direction(self, offset_m: float) -> Array:
        """Return the unit direction of travel there."""
        inside_m = min(max(offset_m, self.from_m + 1e-6), self.to_m - 1e-6)
        return np.asarray(self.line.tangent_at(self.start_m + inside_m))

    def place(self, offset_m: float) -> tuple[str, float]:
        """Return the belt to which an object there belongs, and its arc length, maybe beyond an end."""
        if not self.target:
            return self.belt, self.start_m + offset_m
        from_m, to_m = self.halves
        bridge_m = self.line.length_m
        is_first_half = offset_m < bridge_m / 2.0
        if from_m is not None and (to_m is None or is_first_half):
            return self.belt, from_m + offset_m
        if to_m is not None:
            return self.target, to_m - (bridge_m - offset_m)
        return "", 0.0


class Junctions:
    """Finds the junctions of sections that are not cut yet."""

    def __init__(self, sections: Sequence[Piece]) -> None:
        self._sections = sections
        self._lines: list[Polyline] = []
        for section in sections:
            start_m = section.point(0.0)
            end_m = section.point(section.to_m)
            self._lines.append(Polyline([start_m, *map(tuple, _between(section)), end_m]))

    def extents(self, longest_m: float) -> list[Extent]:
        """Return disjoint extents such that waiting packages up to `longest_m` do not touch passing ones."""
        extents = self._common_starts()
        for centre in self._centres():
            extent = self._within(centre, longest_m)
            narrowness = self._narrowness(centre, extent)
            if narrowness > 1.0:
                widening = min(MAX_WIDENING, BENT * narrowness)
                extent = self._within(centre, widening * longest_m)
            extents.append(extent)
        return _merged(extents)

    def _common_starts(self) -> list[Extent]:
        """Return the common first parts of sections that begin at one place in one direction."""
        extents: list[Extent] = []
        for section in self._sections:
            ways = [self._sections[index] for index in section.successors]
            for number, way in enumerate(ways):
                for other in ways[:number]:
                    if float(way.direction(0.0) @ other.direction(0.0)) > APART:
                        extents.append(_common_start(way, other))
        return extents

    def _centres(self) -> list[Array]:
        """Return the places at which ways diverge, merge, turn sharply or cross."""
        # Ends of sections
        centres: list[Array] = []
        for section in self._sections:
            following = [self._sections[index] for index in section.successors]
            ahead = [way.direction(0.0) for way in following]
            along = section.direction(section.to_m)
            diverges = any(float(first @ second) < APART for first, second in product(ahead, repeat=2))
            turns = any(float(along @ direction) < SHARP for direction in ahead)
            is_merge = any(len(way.predecessors) > 1 for way in following)
            if diverges or turns or is_merge:
                centres.append(self._lines[section.index].vertices_m[-1])

        # Crossings of bridges with others
        for section in self._sections:
            if section.target:
                centres += self._crossings(section)
        distinct: list[Array] = []
        for centre in centres:
            if all(float(np.linalg.norm(centre - other)) > CROSSING_M for other in distinct):
                distinct.append(centre)
        return distinct

    def _crossings(self, bridge: Piece) -> list[Array]:
        """Return the places where other sections pass `bridge`, which do not touch it at its ends."""
        touching = {bridge.index, *bridge.successors, *bridge.predecessors}
        for index in bridge.predecessors:
            touching.update(self._sections[index].successors)
        for index in bridge.successors:
            touching.update(self._sections[index].predecessors)

        # The point of the bridge that is nearest to each other section
        line = self._lines[bridge.index]
        count = math.ceil(line.length_m / SAMPLE_M) + 1
        points = line.points_at(np.linspace(0.0, line.length_m, count))
        crossings: list[Array] = []
        for section in self._sections:
            if section.index not in touching:
                _, apart_m = self._lines[section.index].nearest_to(points)
                nearest = int(np.argmin(apart_m))
                if apart_m[nearest] < CROSSING_M:
                    crossings.append(points[nearest])
        return crossings

    def _within(self, centre: Array, radius_m: float) -> Extent:
        """Return the parts of sections within `radius_m` of `centre`, along connected sections."""
        waiting: list[int] = []
        for index, line in enumerate(self._lines):
            _, distances_m = line.nearest_to(centre[None, :])
            if distances_m[0] < CROSSING_M:
                waiting.append(index)

        # From these on to connected sections, as long as their ends are within the radius
        extent: Extent = {}
        while waiting:
            index = waiting.pop()
            if index in extent:
                continue
            span_m = _span_within(self._lines[index], centre, radius_m)
            if span_m is None:
                continue
            start_m, end_m = span_m
            section = self._sections[index]
            if start_m <= PAST_M:
                start_m = -1.0
                waiting += section.predecessors
            if end_m >= section.to_m - PAST_M:
                end_m = section.to_m + 1.0
                waiting += section.successors
            extent[index] = (start_m, end_m)
        return extent

    def _narrowness(self, centre: Array, extent: Extent) -> float:
        """Return 1 over the sine of the smallest angle between ways from `centre`; 1 from 90° on."""
        edges: list[Array] = []
        for index, span_m in extent.items():
            section = self._sections[index]
            for edge_m in span_m:
                if 0.0 <= edge_m <= section.to_m:
                    edge = np.asarray(section.point(edge_m)) - centre
                    if all(float(np.linalg.norm(edge - other)) > CROSSING_M for other in edges):
                        edges.append(edge)  # else it is the same way, of two links

        # The largest cosine is that of the smallest angle
        rays = [edge / max(float(np.linalg.norm(edge)), PAST_M) for edge in edges]
        cosines = [float(later @ earlier) for earlier, later in combinations(rays, 2)]
        cosine = max(cosines, default=0.0)
        if cosine <= 0.0:
            return 1.0
        return 1.0 / math.sqrt(max(1.0 - cosine**2, 1e-6))


def _common_start(first: Piece, second: Piece) -> Extent:
    """Return the extent of two sections up to the end of the shorter one, and beyond that end."""
    end_m = min(first.to_m, second.to_m)
    extent: Extent = {}
    for section in (first, second):
        is_whole = end_m == section.to_m
        extent[section.index] = (-1.0, end_m + is_whole)
    return extent


def _between(section: Piece) -> Array:
    """Return the vertices of a section's line between its ends."""
    starts_m = section.line.starts_m - section.start_m
    return section.line.vertices_m[(starts_m > 0.0) & (starts_m < section.to_m)]


def _span_within(line: Polyline, centre: Array, radius_m: float) -> tuple[float, float] | None:
    """Return the first and the last arc length of `line` within `radius_m` of `centre`, or None."""
    reach = centre - line.vertices_m[:-1]
    starts_m = line.starts_m[:-1]
    lengths_m = np.diff(line.starts_m)

    # Chord of each segment within the sphere, about the foot of its centre
    foot_m = np.einsum("ij,ij->i", reach, line.tangents)
    squared = radius_m**2 - np.einsum("ij,ij->i", reach, reach) + foot_m**2
    half_m = np.sqrt(np.maximum(squared, 0.0))
    begin_m = starts_m + np.clip(foot_m - half_m, 0.0, lengths_m)
    end_m = starts_m + np.clip(foot_m + half_m, 0.0, lengths_m)
    inside = np.flatnonzero((squared > 0.0) & (end_m > begin_m))
    if not len(inside):
        return None
    return float(begin_m[inside[0]]), float(end_m[inside[-1]])


def _merged(extents: list[Extent]) -> list[Extent]:
    """Return disjoint extents: those that overlap on a section are merged."""
    merged: list[Extent] = []
    for extent in extents:
        new = dict(extent)
        while True:
            touching = next((other for other in merged if _touch(other, new)), None)
            if touching is None:
                break
            merged.remove(touching)
            for section, (start_m, end_m) in touching.items():
                new_start_m, new_end_m = new.get(section, (start_m, end_m))
                new[section] = (min(start_m, new_start_m), max(end_m, new_end_m))
        merged.append(new)
    return merged


def _touch(a: Extent, b: Extent) -> bool:
    for section in a.keys() & b.keys():
        a_start_m, a_end_m = a[section]
        b_start_m, b_end_m = b[section]
        if a_start_m < b_end_m + PAST_M and b_start_m < a_end_m + PAST_M:
            return True
    return False


class Network:
    """Pieces by index, and their connections."""

    def __init__(
        self,
        lines: dict[str, Polyline],
        links: Sequence[BeltLink] = (),
        bays: dict[str, str] | None = None,
        *,
        longest_m: float,
        surface: Literal["strip", "belt"] = "belt",
    ) -> None:
        """Connect `lines` by `links`, with junctions for packages up to `longest_m`.

        `bays` by name are ends of belts. Links and bays of other lines, and links from a belt's very start,
        are left out.
        """
        self.surface: Literal["strip", "belt"] = surface
        self.lines = lines
        self.links = self._usable_links(links)
        self.bays: dict[str, str] = {}
        for bay, belt in (bays or {}).items():
            if belt in lines:
                self.bays[bay] = belt
        self.linked: set[str] = set()
        """Belts with links. They hold packages at the start when they run backwards."""
        entered: set[str] = set()
        for link, _, target_m in self.links:
            self.linked.update((link.source, link.target))
            if target_m < SNAP_M:
                entered.add(link.target)
        starting = [belt for belt in lines if belt not in entered]
        self.entries = starting or list(lines)
        """Belts at whose start no link ends."""

        # Sections between links, cut where junctions begin and end
        uncut = self._uncut()
        extents = Junctions(uncut).extents(longest_m) if self.links else []
        self.junctions = len(extents)
        """Number of junctions."""
        self.parts: list[list[Piece]] = []
        """Pieces of each section."""
        self.pieces: list[Piece] = []
        for section in uncut:
            self.parts.append(_parts(section, extents, len(self.pieces)))
            self.pieces += self.parts[-1]
        self.sections: dict[str, list[Piece]] = {}
        """Pieces of each belt, from its start to its end."""
        self._connect(uncut)
        self.front_first = self._front_first()
        """All pieces, each after the pieces ahead of it, except in rings."""

    def _usable_links(self, links: Sequence[BeltLink]) -> list[tuple[BeltLink, float, float]]:
        """Return the links that are used, with the arc lengths of their ends on source and target."""
        usable: list[tuple[BeltLink, float, float]] = []
        for link in links:
            if link.source not in self.lines or link.target not in self.lines:
                continue
            source_m = self._source_m(link)
            if source_m >= SNAP_M:
                usable.append((link, source_m, self._target_m(link)))
        return usable

    def at(self, belt: str, position_m: float) -> tuple[Piece, float]:
        """Return the piece of `belt` at arc length `position_m`, and the offset on it."""
        for piece in self.sections[belt]:
            if position_m < piece.start_m + piece.to_m:
                break
        return piece, position_m - piece.start_m  # never empty

    def _source_m(self, link: BeltLink) -> float:
        length_m = self.lines[link.source].length_m
        if link.source_position_m is None:
            return length_m
        return min(max(link.source_position_m, 0.0), length_m)

    def _target_m(self, link: BeltLink) -> float:
        length_m = self.lines[link.target].length_m
        return min(max(link.target_position_m, 0.0), length_m)

    def _uncut(self) -> list[Piece]:
        """Return the sections of all belts between links, and the bridges of the links."""
        sections: dict[str, list[Piece]] = {}
        pieces: list[Piece] = []
        for belt, line in self.lines.items():
            # Straight on along the belt comes first among the successors
            first = len(pieces)
            for start_m, end_m in pairwise(self._section_ends_m(belt)):
                index = len(pieces)
                pieces.append(Piece(index, index, belt, line, start_m, 0.0, end_m - start_m))
            sections[belt] = pieces[first:]
            for piece, following in pairwise(sections[belt]):
                piece.successors.append(following.index)

        # Then come links, in their own order
        for link, source_m, target_m in self.links:
            _bridge(link, source_m, target_m, sections, pieces)
        for bay, belt in self.bays.items():
            sections[belt][-1].bay = bay
        _fill_predecessors(pieces)
        return pieces

    def _section_ends_m(self, belt: str) -> list[float]:
        """Return the arc lengths of the ends of the sections of `belt`, from its start to its end."""
        length_m = self.lines[belt].length_m
        cuts_m: set[float] = set()
        for link, source_m, target_m in self.links:
            if link.source == belt:
                cuts_m.add(source_m)
            if link.target == belt:
                cuts_m.add(target_m)
        ends_m = [0.0]
        for cut_m in sorted(cuts_m):
            if cut_m - ends_m[-1] >= SNAP_M and length_m - cut_m >= SNAP_M:
                ends_m.append(cut_m)
        return [*ends_m, length_m]

    def _connect(self, uncut: Sequence[Piece]) -> None:
        for section, parts in zip(uncut, self.parts, strict=True):
            for piece, following in pairwise(parts):
                piece.successors = [following.index]
            last = parts[-1]
            last.successors = [self.parts[index][0].index for index in section.successors]
            last.bay = section.bay
        _fill_predecessors(self.pieces)

        # The pieces of each belt, without bridges
        self.sections = {belt: [] for belt in self.lines}
        for piece in self.pieces:
            if not piece.target:
                self.sections[piece.belt].append(piece)
        for belt in self.lines:
            for piece, following in pairwise(self.sections[belt]):
                following.before = piece.index

    def _front_first(self) -> list[int]:
        # Depth first: a piece is done after all pieces ahead of it
        order: list[int] = []
        seen: set[int] = set()
        for root in range(len(self.pieces)):
            waiting = [(root, False)]
            while waiting:
                index, is_done = waiting.pop()
                if is_done:
                    order.append(index)
                elif index not in seen:
                    seen.add(index)
                    waiting.append((index, True))
                    waiting += [(following, False) for following in self.pieces[index].successors]
        return order


def _bridge(
    link: BeltLink, source_m: float, target_m: float, sections: dict[str, list[Piece]], pieces: list[Piece]
) -> None:
    """Connect the ends of `link`, by a bridge among `pieces` unless they are at one place."""
    sources = sections[link.source]
    targets = sections[link.target]
    leaving = min(sources, key=lambda piece: abs(piece.start_m + piece.to_m - source_m))
    entered = min(targets, key=lambda piece: abs(piece.start_m - target_m))
    start = leaving.point(leaving.to_m)
    end = entered.point(0.0)
    gap_m = math.dist(start, end)
    if gap_m < SNAP_M:
        leaving.successors.append(entered.index)
        return

    # From or to the end of a belt, half of the bridge counts as that belt's
    index = len(pieces)
    line = Polyline([start, end])
    bridge = Piece(index, index, link.source, line, 0.0, 0.0, gap_m, target=link.target)
    leaving_end_m = leaving.start_m + leaving.to_m
    source_half_m = leaving_end_m if leaving is sources[-1] else None
    target_half_m = 0.0 if entered is targets[0] else None
    bridge.halves = (source_half_m, target_half_m)
    bridge.successors.append(entered.index)
    leaving.successors.append(index)
    pieces.append(bridge)


def _fill_predecessors(pieces: Sequence[Piece]) -> None:
    for piece in pieces:
        for following in piece.successors:
            pieces[following].predecessors.append(piece.index)


def _parts(section: Piece, extents: Sequence[Extent], first: int) -> list[Piece]:
    """Return `section` cut where junctions begin and end, with indices from `first`, without connections."""
    ends_m = {section.to_m}
    for extent in extents:
        for end_m in extent.get(section.index, ()):
            if 0.0 < end_m < section.to_m:
                ends_m.add(end_m)

    # Each part lies in the junction that contains its middle, or in none
    parts: list[Piece] = []
    for from_m, to_m in pairwise([0.0, *sorted(ends_m)]):
        middle_m = (from_m + to_m) / 2.0
        part = replace(section, index=first + len(parts), from_m=from_m, to_m=to_m, bay="")
        part.successors = []
        part.predecessors = []
        for junction, extent in enumerate(extents):
            start_m, end_m = extent.get(section.index, (0.0, 0.0))
            if start_m < middle_m < end_m:
                part.junction = junction
        parts.append(part)
    return parts


class BeltRoutes:
    """Ways by bay, precomputed (Dijkstra). Without a bay: straight on, at ends by the first link."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self._next: dict[str, list[int]] = {}
        self._length_m: dict[str, list[float]] = {}
        straight_on: list[int] = []
        for piece in network.pieces:
            straight_on.append(piece.successors[0] if piece.successors else NONE)
        self._next[""] = straight_on
        for bay in network.bays:
            following, lengths_m = self._towards(bay)
            self._next[bay] = following
            self._length_m[bay] = lengths_m

    def next_of(self, piece: int, bay: str) -> int:
        """Return the piece after `piece` on the way to `bay` (`""`: straight on), `NONE` at the way's end."""
        return self._next[bay][piece]

    def reaches(self, piece: int, bay: str) -> bool:
        """Return True if a way leads from `piece` to `bay`."""
        lengths_m = self._length_m.get(bay)
        return lengths_m is not None and lengths_m[piece] < math.inf

    def has(self, bay: str) -> bool:
        """Return True if the network has a bay of that name."""
        return bay in self._length_m

    def best(self, piece: int, wanted: str) -> str:
        """Return `wanted` if it can be reached from `piece`, else the nearest bay, or `""`."""
        if self.reaches(piece, wanted):
            return wanted
        bays = [bay for bay in self._length_m if self.reaches(piece, bay)]
        return min(bays, key=lambda bay: self._length_m[bay][piece], default="")

    def _towards(self, bay: str) -> tuple[list[int], list[float]]:
        """Return by piece the next piece on the shortest way to `bay`, and the length of that way, m."""
        pieces = self._network.pieces
        lengths_m = [math.inf] * len(pieces)
        following = [NONE] * len(pieces)
        last = self._network.sections[self._network.bays[bay]][-1].index
        lengths_m[last] = pieces[last].length_m
        heap = [(lengths_m[last], last)]
        while heap:
            way_m, index = heapq.heappop(heap)
            if way_m > lengths_m[index]:  # a shorter way has been found since
                continue
            for predecessor in pieces[index].predecessors:
                length_m = way_m + pieces[predecessor].length_m
                if length_m < lengths_m[predecessor]:
                    lengths_m[predecessor] = length_m
                    following[predecessor] = index
                    heapq.heappush(heap, (length_m, predecessor))
        return following, lengths_m
