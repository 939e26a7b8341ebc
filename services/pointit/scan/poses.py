"""First poses of views, which the adjustment refines: a pair of views, then one after another.

The length of a straight piece in pixels and its pitch give its place in the frame of a camera that sees it.
Shared pieces give the motion from view to view.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, compress

import numpy as np

from pointit.scan.bundle import Array, BundleProblem, BundleState
from pointit.scan.candidate_poses import COARSE, candidate_poses, upright
from pointit.scan.lines import ImageLine
from pointit.scan.sightings import SightingArrays

Piece = tuple[int, int]
"""Number of a strip, and of its piece."""
Lines = Sequence[Mapping[Piece, ImageLine]]
"""Lines of each view."""

FOCALS = (0.65, 0.8, 1.0)
"""Focal lengths to begin with, as shares of the image's longer side."""
STARTS = 3
"""Number of begun pairs that are grown."""
PAIRS = 4
"""Number of pairs of views to begin with."""
PITCH_SIGMA = 0.01
"""Relative standard deviation of a strip's pitch from the one it is sold with."""
GOOD_PX = 6.0
MAX_PAIRS = 0.85
"""Share of a line's sightings in a view that are good if it is in its place."""
MIN_TIES = 5
"""Minimum number of sightings, on both sides, of the two pieces that tie a view: fewer fit several poses."""
MAX_LINES = 0.75
"""Share of a view's shared lines that are in their places if the view is; others are reflections."""
WORSE = 1.5
"""Ratio of costs up to which a further view fits the others."""
MAX_STRETCH = 0.04
"""Relative error of a pitch with which a line does not count."""
WIDE_PX, NARROW_PX = 20.0, 6.0
FLAT = 0.15
"""Ratio of the third and second extent of points up to which they lie in a plane."""


@dataclass(frozen=True)
class PlacedViews:
    """Views with poses, and pieces with places.

    Attributes:
        views: numbers of the placed views, in the order of `state`.
        pieces: pieces, in the order of `state`.
        ties: pieces that tie each view to the others: most of its sightings of them are good.
        cost: mean square of the errors of good sightings of the ties, image pixels².
    """

    views: list[int]
    pieces: list[Piece]
    state: BundleState
    ties: tuple[tuple[Piece, ...], ...] = ()
    cost: float = np.inf


class FirstPoses:
    """Places views of the same camera, beginning with the pairs that share the most pieces."""

    def __init__(
        self,
        seen: SightingArrays,
        lines: Lines,
        bounds: Mapping[Piece, tuple[float, float]],
        pitches_m: Mapping[int, float],
    ) -> None:
        """Create for `lines` of strips of known pitch. `bounds`: pixel numbers of the pieces' ends."""
        self._lines = lines
        self._bounds = bounds
        self._pitches_m = pitches_m
        self._downs = seen.downs
        self._side_px = seen.side_px
        self._log_focal = seen.log_focal

    def best(self) -> PlacedViews | None:
        """Return the placement of as many views as possible, or None if no two views share enough."""
        shared = {
            pair: set(self._lines[pair[0]]) & set(self._lines[pair[1]])
            for pair in combinations(range(len(self._lines)), 2)
        }
        pairs = sorted(shared, key=lambda pair: -sum(self._weight(pair, piece) for piece in shared[pair]))
        begun = [
            self._add(self._begin(base, focal * self._side_px), other)
            for base, other in pairs[:PAIRS]
            for focal in FOCALS
        ]
        grown = map(self._grown, sorted(filter(None, begun), key=_rank)[:STARTS])
        return min(grown, key=lambda each: (-len(each.views), each.cost), default=None)

    def _weight(self, pair: tuple[int, int], piece: Piece) -> float:
        return min(1.0, min(self._lines[view][piece].extent_px for view in pair) / (0.15 * self._side_px))

    def _begin(self, base: int, focal_px: float) -> PlacedViews:
        down = self._downs[base]
        rotation = upright(-down).T if np.isfinite(down[0]) else np.eye(3)
        state = BundleState(
            float(np.log(focal_px)), 0.0, rotation[None], np.zeros((1, 3)), np.zeros((0, 2, 3))
        )
        return self._with_pieces(PlacedViews([base], [], state))

    def _with_pieces(self, placed: PlacedViews) -> PlacedViews:
        """Return `placed` with all pieces that a placed view sees, each by the view that sees it largest."""
        state, pieces, ends = placed.state, list(placed.pieces), list(placed.state.ends)
        views = [self._lines[view] for view in placed.views]
        for piece in sorted(set[Piece]().union(*views) - set(pieces)):
            having = [index for index, lines in enumerate(views) if piece in lines]
            index = max(having, key=lambda index: views[index][piece].extent_px)
            there = self._in_camera(state, views[index][piece], piece, np.array(self._bounds[piece]))
            ends.append((there - state.translations[index]) @ state.rotations[index])
            pieces.append(piece)
        return PlacedViews(placed.views, pieces, replace(state, ends=np.array(ends).reshape(-1, 2, 3)))

    def _in_camera(self, state: BundleState, line: ImageLine, piece: Piece, pixels: Array) -> Array:
        return line.in_camera(float(np.exp(state.log_focal)), self._pitches_m[piece[0]], pixels)

    def _add(self, placed: PlacedViews, view: int) -> PlacedViews | None:
        """Return `placed` with `view` and its pieces, adjusted, or None if they do not agree."""
        state = placed.state
        room: list[Array] = []
        camera: list[Array] = []
        images: list[Array] = []
        for piece, (first, last) in zip(placed.pieces, state.ends, strict=True):
            line = self._lines[view].get(piece)
            if line is not None:
                low, high = self._bounds[piece]
                pixels: Array = np.linspace(float(line.pixels.min()), float(line.pixels.max()), 3)
                room.append(first + ((pixels - low) / (high - low))[:, None] * (last - first))
                camera.append(self._in_camera(state, line, piece, pixels))
                images.append(line.at(pixels))
        if not room:
            return None
        down = self._downs[view]
        is_level = np.isfinite(down[0]) and bool(np.isfinite(self._downs[placed.views][:, 0]).any())
        placements: list[PlacedViews] = []
        focal = float(np.exp(state.log_focal))
        poses = candidate_poses(
            np.array(room),
            np.array(camera),
            np.array(images) / focal,
            COARSE * self._side_px / focal,
            down if is_level else None,
        )
        for rotation, translation in poses:
            start = replace(
                state,
                rotations=np.concatenate([state.rotations, rotation[None]]),
                translations=np.concatenate([state.translations, translation[None]]),
            )
            placement = self._with_pieces(PlacedViews([*placed.views, view], placed.pieces, start))
            placements.append(self._adjusted(placement))
        best = min(placements, key=_rank, default=None)
        return best if best and self._is_tied(best) else None

    def _grown(self, placed: PlacedViews) -> PlacedViews:
        """Return `placed` with all further views that agree, those that share the most pieces first."""
        refused: set[int] = set()
        limit = WORSE * placed.cost + 0.2
        while True:
            waiting = [
                (len(set(placed.pieces) & set(lines)), view)
                for view, lines in enumerate(self._lines)
                if view not in placed.views and view not in refused
            ]
            if not waiting:
                return placed
            view = max(waiting)[1]
            grown = self._add(placed, view)
            if grown is None or grown.cost > limit:
                refused.add(view)
            else:
                placed, refused = grown, set()

    def _adjusted(self, placed: PlacedViews) -> PlacedViews:
        bundle = self._bundle(placed)
        state = bundle.solve(bundle.solve(placed.state, 10, WIDE_PX), 5, NARROW_PX)
        errors = np.linalg.norm(bundle.errors(state), axis=1)
        is_good = (errors < GOOD_PX) & (np.abs(bundle.stretch(state)[bundle.piece]) < MAX_STRETCH)
        table = np.zeros((len(placed.views), len(placed.pieces)))
        goods = table.copy()
        np.add.at(table, (bundle.view, bundle.piece), 1.0)
        np.add.at(goods, (bundle.view, bundle.piece), is_good)
        shared = (table > 0).sum(axis=0) > 1
        holds = (goods > MAX_PAIRS * table) & shared
        holds &= holds.sum(axis=0) > 1
        held: Array = errors[holds[bundle.view, bundle.piece] & is_good]
        rows: list[list[bool]] = holds.tolist()
        return PlacedViews(
            placed.views,
            placed.pieces,
            state,
            tuple(tuple(compress(placed.pieces, row)) for row in rows),
            float(np.mean(held**2)) if len(held) else np.inf,
        )

    def _is_tied(self, placed: PlacedViews) -> bool:
        """Return True if the last view hangs together with the others by more than chance."""
        ties, own = placed.ties[-1], self._lines[placed.views[-1]]
        others = [self._lines[view] for view in placed.views[:-1]]
        shown = [piece for piece in own if any(piece in lines for lines in others)]
        firm = [
            piece
            for piece in ties
            if min(len(own[piece].pixels), max(len(x[piece].pixels) for x in others if piece in x))
            >= MIN_TIES
        ]
        return len(firm) > 1 and len(ties) >= MAX_LINES * len(shown) and not _is_from_behind(placed)

    def _bundle(self, placed: PlacedViews) -> BundleProblem:
        parts = [
            (index, number, self._lines[view][piece])
            for index, view in enumerate(placed.views)
            for number, piece in enumerate(placed.pieces)
            if piece in self._lines[view]
        ]
        sizes = [len(line.pixels) for _, _, line in parts]
        bounds = np.array([self._bounds[piece] for piece in placed.pieces])
        spans = bounds[:, 1] - bounds[:, 0]
        piece = np.repeat([number for _, number, _ in parts], sizes)
        pixel = np.concatenate([line.pixels for _, _, line in parts])
        return BundleProblem(
            view=np.repeat([index for index, _, _ in parts], sizes),
            piece=piece,
            share=(pixel - bounds[piece, 0]) / spans[piece],
            uv=np.concatenate([line.uv for _, _, line in parts]),
            log_length=np.log(spans * [self._pitches_m[strip] for strip, _ in placed.pieces]),
            length_sigma=np.full(len(spans), PITCH_SIGMA),
            down=self._downs[placed.views],
            log_focal=self._log_focal,
        )


def _rank(placed: PlacedViews) -> tuple[int, float]:
    """Return the order of placements by their last view, the best first."""
    return -len(placed.ties[-1]), placed.cost


def _is_from_behind(placed: PlacedViews) -> bool:
    """Return True if the last view sees its ties, all in one plane, from the other side than other views.

    The mirror image of strips in one plane, such as on a wall, is congruent with them seen from behind.
    """
    numbers = [placed.pieces.index(piece) for piece in placed.ties[-1]]
    state = placed.state
    points = state.ends[numbers].reshape(-1, 3)
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle)
    if sizes[2] > FLAT * sizes[1]:
        return False
    cameras = -np.einsum("vji,vj->vi", state.rotations, state.translations)
    sides = (cameras - middle) @ axes[2]
    others = [sides[index] for index, ties in enumerate(placed.ties[:-1]) if set(ties) & set(placed.ties[-1])]
    return any(side * sides[-1] < 0 for side in others)
