"""Zones where ways join, part, cross or turn sharply, which packages of different ways pass one at a time."""

import math
from dataclasses import dataclass

import numpy as np

from pointit.services.conveyor_sim.network.network import APART, Array, Network, NetworkEdge
from pointit.services.conveyor_sim.network.piece_distance import Path

CROSSING_M = 0.05
"""Lines that pass each other closer than this cross."""
SHARP = math.cos(math.radians(30.0))
"""Cosine of the turn above which packages that follow each other would come closer than along their way."""
MAX_WIDENING = 3.0
"""Largest factor by which zones of ways at a narrow angle are extended."""
BENT = 1.05
"""Additional factor, since the angle may change along the way."""
PAST_M = 1e-3

_Spans = dict[int, tuple[float, float]]
"""Start and end by piece."""


@dataclass(frozen=True, slots=True)
class Gate:
    """Extent of a zone on a piece; it continues before the piece below 0, and after it beyond its length."""

    zone: int
    start_m: float
    end_m: float


class Zones:
    """The zones of a network, by piece."""

    def __init__(self, network: Network, longest_m: float) -> None:
        """Lay out zones such that waiting packages up to `longest_m` do not touch passing ones."""
        self._network = network
        self._paths = [Path(piece) for piece in network.pieces] if network.links else []
        found: list[_Spans] = []
        for centre in self._centres() if network.links else ():
            spans = self._spans(centre, longest_m)
            narrowness = self._narrowness(centre, spans)
            if narrowness > 1.0:
                spans = self._spans(centre, min(MAX_WIDENING, BENT * narrowness) * longest_m)
            found.append(spans)
        merged = _merged(found)
        self.count = len(merged)
        gates: list[list[Gate]] = [[] for _ in network.pieces]
        for zone, spans in enumerate(merged):
            for piece, (start_m, end_m) in spans.items():
                gates[piece].append(Gate(zone, start_m, end_m))
        self.gates = [tuple(sorted(those, key=lambda gate: gate.start_m)) for those in gates]
        """By piece, in order."""

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
            ahead = [pieces[index].direction(0.0) for index in piece.successors]
            along = piece.direction(piece.length_m)
            parts = any(float(a @ b) < APART for a in ahead for b in ahead)
            turns = any(float(along @ a) < SHARP for a in ahead)
            meets = any(len(pieces[index].predecessors) > 1 for index in piece.successors)
            if parts or turns or meets:
                centres.append(self._paths[piece.index].points[-1])
        for bridge in pieces:
            if bridge.is_bridge:
                centres += self._crossings(bridge)
        distinct: list[Array] = []
        for centre in centres:
            if all(float(np.linalg.norm(centre - other)) > CROSSING_M for other in distinct):
                distinct.append(centre)
        return distinct

    def _crossings(self, bridge: NetworkEdge) -> list[Array]:
        pieces = self._network.pieces
        near = {bridge.index, *bridge.successors, *bridge.predecessors}
        near |= {index for before in bridge.predecessors for index in pieces[before].successors}
        near |= {index for following in bridge.successors for index in pieces[following].predecessors}
        found = [
            self._paths[bridge.index].crossing(self._paths[piece.index])
            for piece in pieces
            if piece.index not in near
        ]
        return [place for apart_m, place in found if apart_m < CROSSING_M]

    def _spans(self, centre: Array, radius_m: float) -> _Spans:
        """Return the parts of pieces within `radius_m` of `centre`, along connected pieces."""
        spans: _Spans = {}
        pieces = self._network.pieces
        waiting = [
            piece.index for piece in pieces if self._paths[piece.index].distance_m(centre) < CROSSING_M
        ]
        while waiting:
            index = waiting.pop()
            inside = None if index in spans else self._paths[index].within(centre, radius_m)
            if inside is None:
                continue
            start_m, end_m = inside
            if start_m <= PAST_M:
                start_m = -1.0
                waiting += pieces[index].predecessors
            if end_m >= pieces[index].length_m - PAST_M:
                end_m = pieces[index].length_m + 1.0
                waiting += pieces[index].successors
            spans[index] = (start_m, end_m)
        return spans

    def _narrowness(self, centre: Array, spans: _Spans) -> float:
        """Return 1 over the sine of the smallest angle between ways from `centre`; 1 from 90° on."""
        edges: list[Array] = []
        for index, span_m in spans.items():
            piece = self._network.pieces[index]
            for edge_m in span_m:
                if 0.0 <= edge_m <= piece.length_m:
                    edge = np.asarray(piece.point(edge_m)) - centre
                    if all(float(np.linalg.norm(edge - other)) > CROSSING_M for other in edges):
                        edges.append(edge)  # else it is the same way, of two links
        rays = [edge / max(float(np.linalg.norm(edge)), PAST_M) for edge in edges]
        nearest = max((float(a @ b) for i, a in enumerate(rays) for b in rays[:i]), default=0.0)
        return 1.0 if nearest <= 0.0 else 1.0 / math.sqrt(max(1.0 - nearest**2, 1e-6))


def _merged(found: list[_Spans]) -> list[_Spans]:
    """Return disjoint zones: those that overlap on a piece are merged."""
    zones: list[_Spans] = []
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


def _touch(a: _Spans, b: _Spans) -> bool:
    return any(
        a[piece][0] < b[piece][1] + PAST_M and b[piece][0] < a[piece][1] + PAST_M
        for piece in a.keys() & b.keys()
    )
