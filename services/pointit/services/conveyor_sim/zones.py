"""Where ways meet, part, cross or turn sharply: places that packages of different ways pass one at a time."""

import math
from dataclasses import dataclass

import numpy as np

from pointit.services.conveyor_sim.network import Array, Network, Piece

SAMPLE_M = 0.01
"""Lines are looked at so finely."""
CROSSING_M = 0.05
"""Lines that pass each other closer than this cross."""
SHARP = math.cos(math.radians(30.0))
"""Cosine of the turn above which packages that follow each other would come closer than along their way."""
APART = math.cos(math.radians(10.0))
"""Ways that leave one place more apart than this part there."""
MOST_WIDENED = 3.0
"""Ways that meet at a narrow angle are kept clear for longer, at most by this factor."""
PAST_M = 1e-3


@dataclass(frozen=True, slots=True)
class Gate:
    """Where a zone lies on a piece: from `start_m` to `end_m`; below 0 or beyond the length it goes on."""

    zone: int
    start_m: float
    end_m: float


class Zones:
    """The zones of a network, by piece."""

    def __init__(self, network: Network, longest_m: float) -> None:
        """Lay out zones so that packages up to `longest_m` that wait outside touch none that passes."""
        self._network = network
        self._points = [_sampled(piece) for piece in network.pieces]
        found: list[dict[int, tuple[float, float]]] = []
        for centre in self._centres():
            spans = self._spans(centre, longest_m)
            widened = min(MOST_WIDENED, self._narrowness(centre, spans))
            found.append(self._spans(centre, widened * longest_m) if widened > 1.0 else spans)
        self.gates: list[tuple[Gate, ...]] = [() for _ in network.pieces]
        """By piece, in order."""
        merged = _merged(found)
        self.count = len(merged)
        for zone, spans in enumerate(merged):
            for piece, (start_m, end_m) in spans.items():
                self.gates[piece] = (*self.gates[piece], Gate(zone, start_m, end_m))
        self.gates = [tuple(sorted(gates, key=lambda gate: gate.start_m)) for gates in self.gates]

    def at(self, piece: int, offset_m: float) -> Gate | None:
        """Return the zone in which `offset_m` of `piece` lies; its edges are outside."""
        for gate in self.gates[piece]:
            if gate.start_m < offset_m < gate.end_m:
                return gate
        return None

    def _centres(self) -> list[Array]:
        pieces = self._network.pieces
        centres: list[Array] = []
        for piece in pieces:
            here = self._points[piece.index][-1]
            ahead = [pieces[index].direction(0.0) for index in piece.nexts]
            along = piece.direction(piece.length_m)
            parts = any(float(a @ b) < APART for a in ahead for b in ahead)
            turns = any(float(along @ a) < SHARP for a in ahead)
            meets = any(len(pieces[index].befores) > 1 for index in piece.nexts)
            if parts or turns or meets:
                centres.append(here)
        for bridge in pieces:
            if bridge.is_bridge:
                centres += self._crossings(bridge)
        distinct: list[Array] = []
        for centre in centres:
            if all(float(np.linalg.norm(centre - other)) > CROSSING_M for other in distinct):
                distinct.append(centre)
        return distinct

    def _crossings(self, bridge: Piece) -> list[Array]:
        pieces = self._network.pieces
        near = {bridge.index, *bridge.nexts, *bridge.befores}
        near |= {index for before in bridge.befores for index in pieces[before].nexts}
        near |= {index for following in bridge.nexts for index in pieces[following].befores}
        own = self._points[bridge.index]
        crossings: list[Array] = []
        for piece in pieces:
            if piece.index in near:
                continue
            low = own.min(axis=0) - CROSSING_M
            high = own.max(axis=0) + CROSSING_M
            other = self._points[piece.index]
            other = other[np.all((other >= low) & (other <= high), axis=1)]
            if not len(other):
                continue
            apart_m = np.linalg.norm(own[:, None, :] - other[None, :, :], axis=2)
            nearest = int(np.argmin(apart_m.min(axis=1)))
            if apart_m[nearest].min() < CROSSING_M:
                crossings.append(own[nearest])
        return crossings

    def _spans(self, centre: Array, radius_m: float) -> dict[int, tuple[float, float]]:
        """Return by piece what of it lies within `radius_m` of `centre`, going on along what is connected."""
        spans: dict[int, tuple[float, float]] = {}
        waiting = [
            piece.index
            for piece in self._network.pieces
            if np.linalg.norm(self._points[piece.index] - centre, axis=1).min() < CROSSING_M
        ]
        while waiting:
            index = waiting.pop()
            if index in spans:
                continue
            piece = self._network.pieces[index]
            inside = np.flatnonzero(np.linalg.norm(self._points[index] - centre, axis=1) < radius_m)
            if not len(inside):
                continue
            step_m = piece.length_m / (len(self._points[index]) - 1)
            start_m, end_m = (inside[0] - 1) * step_m, (inside[-1] + 1) * step_m
            if inside[0] == 0:
                start_m = -1.0
                waiting += piece.befores
            if inside[-1] == len(self._points[index]) - 1:
                end_m = piece.length_m + 1.0
                waiting += piece.nexts
            spans[index] = (float(start_m), float(end_m))
        return spans

    def _narrowness(self, centre: Array, spans: dict[int, tuple[float, float]]) -> float:
        """Return 1 over the sine of the smallest angle between ways from `centre`; 1 from 90° on."""
        rays: list[Array] = []
        for index, (start_m, end_m) in spans.items():
            piece = self._network.pieces[index]
            for edge_m in (start_m, end_m):
                if 0.0 <= edge_m <= piece.length_m:
                    ray = np.asarray(piece.point(edge_m)) - centre
                    rays.append(ray / max(float(np.linalg.norm(ray)), PAST_M))
        cosines = [float(a @ b) for i, a in enumerate(rays) for b in rays[:i]]
        nearest = max(cosines, default=0.0)
        return 1.0 if nearest <= 0.0 else 1.0 / math.sqrt(max(1.0 - nearest**2, 1e-6))


def _sampled(piece: Piece) -> Array:
    steps = max(2, math.ceil(piece.length_m / SAMPLE_M) + 1)
    offsets_m = np.linspace(0.0, piece.length_m, steps)
    return piece.line.points_at(piece.start_m + offsets_m)


def _merged(found: list[dict[int, tuple[float, float]]]) -> list[dict[int, tuple[float, float]]]:
    """Return zones of which none touch: those that overlap on a piece become one."""
    zones: list[dict[int, tuple[float, float]]] = []
    for spans in found:
        new = dict(spans)
        while True:
            touching = next((zone for zone in zones if _touch(zone, new)), None)
            if touching is None:
                break
            zones.remove(touching)
            for piece, (start_m, end_m) in touching.items():
                before = new.get(piece, (start_m, end_m))
                new[piece] = (min(start_m, before[0]), max(end_m, before[1]))
        zones.append(new)
    return zones


def _touch(a: dict[int, tuple[float, float]], b: dict[int, tuple[float, float]]) -> bool:
    return any(
        a[piece][0] < b[piece][1] + PAST_M and b[piece][0] < a[piece][1] + PAST_M
        for piece in a.keys() & b.keys()
    )
