"""First poses of views, which the adjustment refines: a pair of views, then one after another.

Each straight piece of a strip is a line of its own here. Its length in pixels and its pitch give its place
in the frame of each camera that sees it; shared lines give the motion from view to view.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from pointit.scan.adjustment import Adjustment, Array, Layout, State
from pointit.scan.alignment import best_pose, upright
from pointit.scan.lines import ImageLine

Piece = tuple[int, int]
"""Number of a strip, and of its piece."""
Lines = Sequence[Mapping[Piece, ImageLine]]
"""Lines of each view."""

FOCALS = (0.65, 0.8, 1.0)
"""Focal lengths to begin with, as shares of the image's longer side."""
EXPECTED_FOCAL = 0.78
PAIRS = 4
GOOD_PX = 6.0
WIDE_PX, NARROW_PX = 20.0, 6.0


@dataclass(frozen=True)
class Placed:
    """Views with poses, and lines with places.

    Attributes:
        views: numbers of the placed views, in the order of `state`.
        pieces: pieces, in the order of `state`, two vertices each.
        good: number of sightings with an error of less than `GOOD_PX`, and their number in all.
    """

    views: list[int]
    pieces: list[Piece]
    state: State
    good: int = 0
    of: int = 0


class FirstPoses:
    """Places views of the same camera, beginning with the pairs that share the most lines."""

    def __init__(self, lines: Lines, pitches_m: Mapping[int, float], downs: Array, side_px: float) -> None:
        """Create for `lines` of strips of known pitch; `downs` views x 3, NaN if unknown."""
        self._lines = lines
        self._pitches_m = pitches_m
        self._downs = downs
        self._side_px = side_px

    def best(self) -> Placed | None:
        """Return the placement of as many views as possible, or None if no two views share enough."""
        found: list[tuple[Placed, float]] = []
        shared = {
            pair: set(self._lines[pair[0]]) & set(self._lines[pair[1]])
            for pair in combinations(range(len(self._lines)), 2)
        }
        pairs = sorted(shared, key=lambda pair: -sum(self._weight(pair, piece) for piece in shared[pair]))
        for base, other in pairs[:PAIRS]:
            if shared[base, other]:
                for focal in FOCALS:
                    start = self._begin(base, focal * self._side_px)
                    if placed := self._add(start, other):
                        found.append((placed, placed.good - 0.5 * (placed.of - placed.good)))
        best: Placed | None = None
        for placed, _ in sorted(found, key=lambda each: -each[1])[:3]:
            grown = self._grown(placed)
            if best is None or (len(grown.views), grown.good) > (len(best.views), best.good):
                best = grown
            if best.good > 0.8 * best.of and len(best.views) == len(self._lines):
                break
        return best

    def _weight(self, pair: tuple[int, int], piece: Piece) -> float:
        return min(1.0, min(self._lines[view][piece].extent_px for view in pair) / (0.15 * self._side_px))

    def _begin(self, base: int, focal_px: float) -> Placed:
        down = self._downs[base]
        rotation = upright(-down).T if np.isfinite(down[0]) else np.eye(3)
        state = State(
            float(np.log(focal_px)), 0.0, rotation[None], np.zeros((1, 3)), *_NOTHING
        )
        return self._with_lines(Placed([base], [], state))

    def _with_lines(self, placed: Placed) -> Placed:
        """Return `placed` with all lines that a placed view sees, each by the view that sees it largest."""
        focal = float(np.exp(placed.state.log_focal))
        pieces, vertices, knots = list(placed.pieces), list(placed.state.vertices), list(placed.state.knots)
        seen: dict[Piece, tuple[float, int]] = {}
        for index, view in enumerate(placed.views):
            for piece, line in self._lines[view].items():
                if piece not in pieces:
                    seen[piece] = max(seen.get(piece, (0.0, 0)), (line.extent_px, index))
        for piece, (_, index) in seen.items():
            line = self._lines[placed.views[index]][piece]
            start, step = line.in_camera(focal, self._pitches_m[piece[0]])
            ends = np.array([line.pixels.min(), line.pixels.max()])
            points = start + ends[:, None] * step - placed.state.translations[index]
            vertices += list(points @ placed.state.rotations[index])
            knots += list(ends)
            pieces.append(piece)
        old = placed.state
        state = State(
            old.log_focal,
            old.distortion,
            old.rotations,
            old.translations,
            np.array(vertices).reshape(-1, 3),
            np.array(knots),
            np.r_[old.stretch, np.zeros(len(pieces) - len(old.stretch))],
        )
        return Placed(placed.views, pieces, state)

    def _add(self, placed: Placed, view: int) -> Placed | None:
        """Return `placed` with `view` and its lines, adjusted, or None if the lines do not agree."""
        state = placed.state
        common = [index for index, piece in enumerate(placed.pieces) if piece in self._lines[view]]
        if not common:
            return None
        room, camera, images = [], [], []
        focal = float(np.exp(state.log_focal))
        for index in common:
            piece = placed.pieces[index]
            line = self._lines[view][piece]
            numbers = np.linspace(line.pixels.min(), line.pixels.max(), 3)
            start, step = line.in_camera(focal, self._pitches_m[piece[0]])
            low, high = state.knots[2 * index], state.knots[2 * index + 1]
            first, last = state.vertices[2 * index], state.vertices[2 * index + 1]
            room.append(first + ((numbers - low) / (high - low))[:, None] * (last - first))
            camera.append(start + numbers[:, None] * step)
            images.append(line.at(numbers))
        down = self._downs[view]
        is_level = np.isfinite(down[0]) and bool(np.isfinite(self._downs[placed.views][:, 0]).any())
        pose = best_pose(
            np.array(room),
            np.array(camera),
            np.array(images),
            focal,
            self._side_px,
            down if is_level else None,
        )
        if pose is None or pose[2].sum() < (1 if is_level else 2):
            return None
        state = State(
            state.log_focal,
            state.distortion,
            np.concatenate([state.rotations, pose[0][None]]),
            np.concatenate([state.translations, pose[1][None]]),
            state.vertices,
            state.knots,
            state.stretch,
        )
        return self._adjusted(self._with_lines(Placed([*placed.views, view], placed.pieces, state)))

    def _grown(self, placed: Placed) -> Placed:
        """Return `placed` with all further views that agree, those that share the most lines first."""
        refused: set[int] = set()
        while True:
            known = set(placed.pieces)
            waiting = [
                (sum(piece in known for piece in lines), view)
                for view, lines in enumerate(self._lines)
                if view not in placed.views and view not in refused and known & set(lines)
            ]
            if not waiting:
                return placed
            view = max(waiting)[1]
            grown = self._add(placed, view)
            if grown is None or grown.good - placed.good < 0.4 * (grown.of - placed.of):
                refused.add(view)
            else:
                placed, refused = grown, set()

    def _adjusted(self, placed: Placed) -> Placed:
        adjustment = Adjustment(self._layout(placed))
        state = adjustment.solve(placed.state, 10, WIDE_PX)
        state = adjustment.solve(state, 5, NARROW_PX)
        errors = np.linalg.norm(adjustment.errors(state), axis=1)
        return Placed(placed.views, placed.pieces, state, int((errors < GOOD_PX).sum()), len(errors))

    def _layout(self, placed: Placed) -> Layout:
        parts = [
            (index, number, self._lines[view][piece])
            for index, view in enumerate(placed.views)
            for number, piece in enumerate(placed.pieces)
            if piece in self._lines[view]
        ]
        sizes = [len(line.pixels) for _, _, line in parts]
        count = len(placed.pieces)
        return Layout(
            view=np.repeat([index for index, _, _ in parts], sizes),
            chain=np.repeat([number for _, number, _ in parts], sizes),
            pixel=np.concatenate([line.pixels for _, _, line in parts]),
            uv=np.concatenate([line.uv for _, _, line in parts]),
            first=2 * np.arange(count + 1),
            log_pitch=np.log([self._pitches_m[strip] for strip, _ in placed.pieces]),
            pitch_sigma=np.full(count, 0.01),
            down=self._downs[placed.views],
            log_focal=float(np.log(EXPECTED_FOCAL * self._side_px)),
        )


_NOTHING = (np.zeros((0, 3)), np.zeros(0), np.zeros(0))
