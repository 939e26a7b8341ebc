"""Belts as a directed network: sections between places where links lead off or in, and bridges."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.schemas import BeltLink

Array = NDArray[np.float64]

APART = math.cos(math.radians(10.0))
"""Ways that leave one place more apart than this part there."""
SNAP_M = 1e-3
"""Places on a belt closer together than this are one; a gap shorter than this is none."""


@dataclass(slots=True)
class NetworkEdge:
    """A stretch that is passed from its start to its end: a section of a belt, or the bridge of a link."""

    index: int
    belt: str
    """Whose speed it has; a bridge has that of the belt it comes from."""
    line: Polyline
    start_m: float
    """Arc length on `line` where the piece starts."""
    length_m: float
    target: str = ""
    """The belt that a bridge leads to; empty: it is a section."""
    successors: list[int] = field(default_factory=list[int])
    """Pieces that begin where it ends; straight on along the belt comes first."""
    predecessors: list[int] = field(default_factory=list[int])
    """Pieces that end where it begins."""
    bay: str = ""
    """The bay at its end."""
    twins: list[int] = field(default_factory=list[int])
    """Other pieces that begin where it begins, in its direction: as far as both go they are one way."""
    halves: tuple[float | None, float | None] = (None, None)
    """Of a bridge: arc length on its belt at its start where that is the belt's end, and on its target."""

    @property
    def is_bridge(self) -> bool:
        """Return True if it is the bridge of a link."""
        return bool(self.target)

    def point(self, offset_m: float) -> Vec3:
        """Return the place in {W} at `offset_m` from its start."""
        return self.line.point_at(self.start_m + offset_m)

    def direction(self, offset_m: float) -> Array:
        """Return the unit direction of travel there."""
        return np.asarray(self.line.tangent_at(self.start_m + min(max(offset_m, 1e-6), self.length_m - 1e-6)))

    def place(self, offset_m: float) -> tuple[str, float]:
        """Return the belt on which an object there counts, and its arc length, maybe beyond an end."""
        if not self.target:
            return self.belt, self.start_m + offset_m
        from_m, to_m = self.halves
        if from_m is not None and (to_m is None or offset_m < self.length_m / 2.0):
            return self.belt, from_m + offset_m
        if to_m is not None:
            return self.target, to_m - (self.length_m - offset_m)
        return "", 0.0


class Network:
    """Pieces by index, and the way from each of them to every bay."""

    def __init__(
        self,
        lines: dict[str, Polyline],
        links: Sequence[BeltLink] = (),
        bays: dict[str, str] | None = None,
        *,
        surface: Literal["strip", "belt"] = "belt",
    ) -> None:
        """Cut `lines` where `links` join them; `bays` by name are ends of belts.

        Links and bays of other lines, and links from a belt's very start, are left out.
        """
        self.surface: Literal["strip", "belt"] = surface
        self.lines = lines
        used = [link for link in links if link.source in lines and link.target in lines]
        places = [(self._source_m(link), self._target_m(link)) for link in used]
        self.links = [(link, *place) for link, place in zip(used, places, strict=True) if place[0] >= SNAP_M]
        self.bays = {bay: belt for bay, belt in (bays or {}).items() if belt in lines}
        self.linked = {name for link, _, _ in self.links for name in (link.source, link.target)}
        """Belts that pass objects on, or get some; backwards they do not run empty."""
        self.pieces: list[NetworkEdge] = []
        self.sections: dict[str, list[NetworkEdge]] = {}
        """Of each belt, from its start to its end."""
        for belt in lines:
            self._cut(belt)
        for link, source_m, target_m in self.links:
            self._bridge(link, source_m, target_m)
        for bay, belt in self.bays.items():
            self.sections[belt][-1].bay = bay
        for piece in self.pieces:
            for following in piece.successors:
                self.pieces[following].predecessors.append(piece.index)
        for piece in self.pieces:
            for a in piece.successors:
                self.pieces[a].twins = [b for b in piece.successors if b != a and self._are_twins(a, b)]
        self.entries = [
            belt
            for belt in lines
            if not any(link.target == belt and target_m < SNAP_M for link, _, target_m in self.links)
        ] or list(lines)
        """Belts at whose start nothing else comes in."""
        self.front_first = self._front_first()
        """All pieces, what lies ahead before what leads there, but for rings."""

    def at(self, belt: str, position_m: float) -> tuple[NetworkEdge, float]:
        """Return the section of `belt` at arc length `position_m`, and the offset on it."""
        for piece in self.sections[belt]:
            if position_m < piece.start_m + piece.length_m:
                break
        return piece, position_m - piece.start_m  # pyright: ignore[reportPossiblyUnboundVariable] - never empty

    def _source_m(self, link: BeltLink) -> float:
        length_m = self.lines[link.source].length_m
        at_m = length_m if link.source_position_m is None else link.source_position_m
        return min(max(at_m, 0.0), length_m)

    def _target_m(self, link: BeltLink) -> float:
        return min(max(link.target_position_m, 0.0), self.lines[link.target].length_m)

    def _cut(self, belt: str) -> None:
        line = self.lines[belt]
        cuts = {source_m for link, source_m, _ in self.links if link.source == belt}
        cuts |= {target_m for link, _, target_m in self.links if link.target == belt}
        ends = [0.0]
        for cut_m in sorted(cuts):
            if cut_m - ends[-1] >= SNAP_M and line.length_m - cut_m >= SNAP_M:
                ends.append(cut_m)
        ends.append(line.length_m)
        sections: list[NetworkEdge] = []
        for start_m, end_m in pairwise(ends):
            piece = NetworkEdge(len(self.pieces), belt, line, start_m, end_m - start_m)
            if sections:
                sections[-1].successors.append(piece.index)
            sections.append(piece)
            self.pieces.append(piece)
        self.sections[belt] = sections

    def _bridge(self, link: BeltLink, source_m: float, target_m: float) -> None:
        sources, targets = self.sections[link.source], self.sections[link.target]
        leaving = min(sources, key=lambda piece: abs(piece.start_m + piece.length_m - source_m))
        entered = min(targets, key=lambda piece: abs(piece.start_m - target_m))
        start, end = leaving.point(leaving.length_m), entered.point(0.0)
        gap_m = math.dist(start, end)
        if gap_m < SNAP_M:
            leaving.successors.append(entered.index)
            return
        bridge = NetworkEdge(
            index=len(self.pieces),
            belt=link.source,
            line=Polyline([start, end]),
            start_m=0.0,
            length_m=gap_m,
            target=link.target,
            successors=[entered.index],
            halves=(
                leaving.start_m + leaving.length_m if leaving is sources[-1] else None,
                0.0 if entered is targets[0] else None,
            ),
        )
        leaving.successors.append(bridge.index)
        self.pieces.append(bridge)

    def _are_twins(self, a: int, b: int) -> bool:
        return float(self.pieces[a].direction(0.0) @ self.pieces[b].direction(0.0)) > APART

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
