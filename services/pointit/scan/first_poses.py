"""First poses of views, which the adjustment refines: a pair of views, then one after another.

Each straight piece of a strip is a line of its own here. Its length in pixels and its pitch give its place
in the frame of each camera that sees it; shared lines give the motion from view to view.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, compress

import numpy as np

from pointit.scan.adjustment import Adjustment, Array, Layout, State
from pointit.scan.alignment import Shared, candidate_poses, upright
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
MOST = 0.7
"""Share of a line's sightings in a view that are good if it is in its place."""
MOST_LINES = 0.75
"""Share of a view's shared lines that are in their places if the view is; others are reflections."""
WORSE = 1.5
"""Ratio of costs up to which a further view fits the others."""
MAX_STRETCH = 0.04
"""Relative error of a pitch with which a line does not count."""
DISTINCT_RAD = np.radians(12.0)
"""Angle of two poses that are not the same one, differently far refined."""
RIVAL = 2.0
"""Ratio of costs up to which two poses are not distinguished."""
WIDE_PX, NARROW_PX = 20.0, 6.0
FLAT = 0.15
"""Ratio of the third and second extent of points up to which they lie in a plane."""


@dataclass(frozen=True)
class Placed:
    """Views with poses, and lines with places.

    Attributes:
        views: numbers of the placed views, in the order of `state`.
        pieces: pieces, in the order of `state`, two vertices each.
        good, of: number of sightings with an error of less than `GOOD_PX`, and their number in all, of the
            pieces that two or more of the views see.
        ties: pieces that tie each view to the others: most of its sightings of them are good.
        cost: mean square of the errors of good sightings of the ties, image pixels².
    """

    views: list[int]
    pieces: list[Piece]
    state: State
    good: int = 0
    of: int = 0
    ties: tuple[tuple[Piece, ...], ...] = ()
    cost: float = np.inf

    @property
    def last_turn(self) -> Array:
        """Return the rotation from the frame of the first view to that of the last."""
        return np.asarray(self.state.rotations[-1] @ self.state.rotations[0].T)


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
                    placed = self._add(start, other)
                    if placed and self._is_tied(placed) and len(placed.ties[-1]) > 1:
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
        state = State(float(np.log(focal_px)), 0.0, rotation[None], np.zeros((1, 3)), *_NOTHING)
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
        room: list[Array] = []
        camera: list[Array] = []
        images: list[Array] = []
        focal = float(np.exp(state.log_focal))
        for index in common:
            piece = placed.pieces[index]
            line = self._lines[view][piece]
            numbers: Array = np.linspace(float(line.pixels.min()), float(line.pixels.max()), 3)
            start, step = line.in_camera(focal, self._pitches_m[piece[0]])
            low, high = state.knots[2 * index], state.knots[2 * index + 1]
            first, last = state.vertices[2 * index], state.vertices[2 * index + 1]
            room.append(first + ((numbers - low) / (high - low))[:, None] * (last - first))
            camera.append(start + numbers[:, None] * step)
            images.append(line.at(numbers))
        down = self._downs[view]
        is_level = np.isfinite(down[0]) and bool(np.isfinite(self._downs[placed.views][:, 0]).any())
        poses = candidate_poses(
            Shared(
                np.array(room),
                np.array(camera),
                np.array(images),
                focal,
                self._side_px,
                down if is_level else None,
            )
        )
        found = [
            self._adjusted(
                self._with_lines(
                    Placed(
                        [*placed.views, view],
                        placed.pieces,
                        replace(
                            state,
                            rotations=np.concatenate([state.rotations, rotation[None]]),
                            translations=np.concatenate([state.translations, translation[None]]),
                        ),
                    )
                )
            )
            for rotation, translation in poses
        ]
        found.sort(key=lambda each: (-len(each.ties[-1]), each.cost))
        if not found or any(_is_rival(found[0], other) for other in found[1:]):
            return None
        return found[0]

    def _grown(self, placed: Placed) -> Placed:
        """Return `placed` with all further views that agree, those that share the most lines first."""
        refused: set[int] = set()
        start = placed
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
            if grown is None or not self._is_tied(grown) or grown.cost > WORSE * start.cost + 0.2:
                refused.add(view)
            else:
                placed, refused = grown, set()

    def _adjusted(self, placed: Placed) -> Placed:
        adjustment = Adjustment(self._layout(placed))
        state = adjustment.solve(placed.state, 10, WIDE_PX)
        state = adjustment.solve(state, 5, NARROW_PX)
        layout = adjustment.layout
        errors = np.linalg.norm(adjustment.errors(state), axis=1)
        is_good = (errors < GOOD_PX) & (np.abs(state.stretch[layout.chain]) < MAX_STRETCH)
        table = np.zeros((len(placed.views), len(placed.pieces)))
        goods = table.copy()
        np.add.at(table, (layout.view, layout.chain), 1.0)
        np.add.at(goods, (layout.view, layout.chain), is_good)
        shared = (table > 0).sum(axis=0) > 1
        holds = (goods > MOST * table) & shared
        holds &= holds.sum(axis=0) > 1
        held: Array = errors[holds[layout.view, layout.chain] & is_good]
        rows: list[list[bool]] = holds.tolist()
        return Placed(
            placed.views,
            placed.pieces,
            state,
            int(goods[:, shared].sum()),
            int(table[:, shared].sum()),
            tuple(tuple(compress(placed.pieces, row)) for row in rows),
            float(np.mean(held**2)) if len(held) else np.inf,
        )

    def _is_tied(self, placed: Placed) -> bool:
        """Return True if the last view hangs together with the others by more than chance."""
        view, ties = placed.views[-1], placed.ties[-1]
        shown = [piece for piece in self._lines[view] if self._is_shared(placed, piece)]
        if len(ties) < MOST_LINES * len(shown):
            return False
        return len(ties) > 1 and not _is_from_behind(placed)

    def _is_shared(self, placed: Placed, piece: Piece) -> bool:
        return sum(piece in self._lines[view] for view in placed.views) > 1

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


def _is_from_behind(placed: Placed) -> bool:
    """Return True if the last view sees its ties, all in one plane, from the other side than other views.

    The mirror image of strips in one plane, such as on a wall, is congruent with them seen from behind.
    """
    numbers = [placed.pieces.index(piece) for piece in placed.ties[-1]]
    state = placed.state
    points = state.vertices[[row for number in numbers for row in (2 * number, 2 * number + 1)]]
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle)
    if sizes[2] > FLAT * sizes[1]:
        return False
    cameras = -np.einsum("vji,vj->vi", state.rotations, state.translations)
    sides = (cameras - middle) @ axes[2]
    others = [sides[index] for index, ties in enumerate(placed.ties[:-1]) if set(ties) & set(placed.ties[-1])]
    return any(side * sides[-1] < 0 for side in others)


def _is_rival(best: Placed, other: Placed) -> bool:
    """Return True if another pose of the last view explains the images nearly as well."""
    turn = best.last_turn @ other.last_turn.T
    is_turned = float(np.trace(turn)) < 1.0 + 2.0 * np.cos(DISTINCT_RAD)
    is_as_good = other.cost < RIVAL * best.cost and len(other.ties[-1]) >= len(best.ties[-1])
    return is_turned and is_as_good


_NOTHING = (np.zeros((0, 3)), np.zeros(0), np.zeros(0))
