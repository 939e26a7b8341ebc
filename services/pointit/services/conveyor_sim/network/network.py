"""Belts as a directed network: cut where links join them and where junctions begin and end."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

from pointit.geometry.polyline import Polyline
from pointit.schemas import BeltLink
from pointit.services.conveyor_sim.network.junctions import Extent, Junctions
from pointit.services.conveyor_sim.network.piece import Piece

SNAP_M = 1e-3
"""Places on a belt closer together than this are merged; shorter gaps are closed."""


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
        used = [link for link in links if link.source in lines and link.target in lines]
        places = [(self._source_m(link), self._target_m(link)) for link in used]
        self.links = [(link, *place) for link, place in zip(used, places, strict=True) if place[0] >= SNAP_M]
        self.bays = {bay: belt for bay, belt in (bays or {}).items() if belt in lines}
        self.linked = {name for link, _, _ in self.links for name in (link.source, link.target)}
        """Belts with links. They hold packages at the start when they run backwards."""
        self.entries = [
            belt
            for belt in lines
            if not any(link.target == belt and target_m < SNAP_M for link, _, target_m in self.links)
        ] or list(lines)
        """Belts at whose start no link ends."""
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

    def at(self, belt: str, position_m: float) -> tuple[Piece, float]:
        """Return the piece of `belt` at arc length `position_m`, and the offset on it."""
        for piece in self.sections[belt]:
            if position_m < piece.start_m + piece.to_m:
                break
        return piece, position_m - piece.start_m  # pyright: ignore[reportPossiblyUnboundVariable] - never empty

    def _source_m(self, link: BeltLink) -> float:
        length_m = self.lines[link.source].length_m
        at_m = length_m if link.source_position_m is None else link.source_position_m
        return min(max(at_m, 0.0), length_m)

    def _target_m(self, link: BeltLink) -> float:
        return min(max(link.target_position_m, 0.0), self.lines[link.target].length_m)

    def _uncut(self) -> list[Piece]:
        """Return the sections of all belts between links, and the bridges of the links."""
        sections: dict[str, list[Piece]] = {}
        pieces: list[Piece] = []
        for belt, line in self.lines.items():
            cuts = {source_m for link, source_m, _ in self.links if link.source == belt}
            cuts |= {target_m for link, _, target_m in self.links if link.target == belt}
            ends = [0.0]
            for cut_m in sorted(cuts):
                if cut_m - ends[-1] >= SNAP_M and line.length_m - cut_m >= SNAP_M:
                    ends.append(cut_m)
            first = len(pieces)
            for start_m, end_m in pairwise([*ends, line.length_m]):
                index = len(pieces)
                pieces.append(Piece(index, index, belt, line, start_m, 0.0, end_m - start_m))
            sections[belt] = pieces[first:]
            for piece, following in pairwise(sections[belt]):
                piece.successors.append(following.index)
        for link, source_m, target_m in self.links:
            _bridge(link, source_m, target_m, sections, pieces)
        for bay, belt in self.bays.items():
            sections[belt][-1].bay = bay
        _fill_predecessors(pieces)
        return pieces

    def _connect(self, uncut: Sequence[Piece]) -> None:
        for section, parts in zip(uncut, self.parts, strict=True):
            for piece, following in pairwise(parts):
                piece.successors = [following.index]
            parts[-1].successors = [self.parts[index][0].index for index in section.successors]
            parts[-1].bay = section.bay
        _fill_predecessors(self.pieces)
        for belt in self.lines:
            self.sections[belt] = [piece for piece in self.pieces if piece.belt == belt and not piece.target]
            for piece, following in pairwise(self.sections[belt]):
                following.before = piece.index

    def _front_first(self) -> list[int]:
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
    sources, targets = sections[link.source], sections[link.target]
    leaving = min(sources, key=lambda piece: abs(piece.start_m + piece.to_m - source_m))
    entered = min(targets, key=lambda piece: abs(piece.start_m - target_m))
    start, end = leaving.point(leaving.to_m), entered.point(0.0)
    gap_m = math.dist(start, end)
    if gap_m < SNAP_M:
        leaving.successors.append(entered.index)
        return
    index, line = len(pieces), Polyline([start, end])
    bridge = Piece(index, index, link.source, line, 0.0, 0.0, gap_m, target=link.target)
    bridge.halves = (
        leaving.start_m + leaving.to_m if leaving is sources[-1] else None,
        0.0 if entered is targets[0] else None,
    )
    bridge.successors.append(entered.index)
    leaving.successors.append(index)
    pieces.append(bridge)


def _fill_predecessors(pieces: Sequence[Piece]) -> None:
    for piece in pieces:
        for following in piece.successors:
            pieces[following].predecessors.append(piece.index)


def _parts(section: Piece, extents: Sequence[Extent], first: int) -> list[Piece]:
    """Return `section` cut where junctions begin and end, with indices from `first`, without connections."""
    ends = {section.to_m}
    for extent in extents:
        ends.update(end_m for end_m in extent.get(section.index, ()) if 0.0 < end_m < section.to_m)
    parts: list[Piece] = []
    for from_m, to_m in pairwise([0.0, *sorted(ends)]):
        middle_m = (from_m + to_m) / 2.0
        part = replace(section, index=first + len(parts), from_m=from_m, to_m=to_m, bay="")
        part.successors, part.predecessors = [], []
        for junction, extent in enumerate(extents):
            start_m, end_m = extent.get(section.index, (0.0, 0.0))
            if start_m < middle_m < end_m:
                part.junction = junction
        parts.append(part)
    return parts
