"""First poses of views: sightings as arrays, candidates by shared strips, a pair, then the others.

The length of a straight piece in pixels and its pitch give its place in the frame of a camera that sees it.
Shared pieces give the motion from view to view.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, compress

import numpy as np

from pointit.geometry.array_types import Array, Indices
from pointit.scan.bundle import DOWN, BundleProblem, BundleState
from pointit.scan.lines import ImageLine
from pointit.scan.views import CameraView, LampSpec, StripSpec

Piece = tuple[int, int]
"""Number of a strip, and of its piece."""
Lines = Sequence[Mapping[Piece, ImageLine]]
"""Lines of each view."""

MAX_MARKS = 60
"""Maximum number of different pixels of one strip that are used."""
EXPECTED_FOCAL = 0.78
"""Focal length of a phone, as a share of the image's longer side."""

MAX_CANDIDATE_PAIRS = 300
COARSE = 0.05
"""Tolerance of a first pose, as a share of the image's width: depth from one photograph is coarse."""
UNKNOWN = (np.nan, np.nan, np.nan)
"""Gravity that is not known."""
DISTINCT_M = 0.15
"""Distance of poses that differ."""
MAX_POSES = 3
GRAVITY_ARM_M = 0.5
"""Gravity counts as a point at this distance."""
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
WIDE_PX = 20.0
NARROW_PX = 6.0
MIN_UPWARD = np.cos(np.radians(50.0))
"""Cosine of the largest angle between the rough direction of up and the right one."""
FLAT = 0.15
"""Ratio of the third and second extent of points up to which they lie in a plane."""


@dataclass(frozen=True)
class SightingArrays:
    """All sightings as arrays.

    Attributes:
        view, chain, pixel, uv: n, n, n, n x 2 from the images' centres. Chains are strips, then lamps.
        downs: directions of gravity, views x 3, NaN if unknown.
        strips: number of strips.
        side_px: longer side of the images.
    """

    view: Indices
    chain: Indices
    pixel: Array
    uv: Array
    downs: Array
    strips: int
    side_px: float

    @classmethod
    def of(
        cls, strips: Sequence[StripSpec], lamps: Sequence[LampSpec], views: Sequence[CameraView]
    ) -> "SightingArrays":
        """Return the sightings in `views`, of at most `MAX_MARKS` different pixels of each."""
        specs: list[StripSpec | LampSpec] = [*strips, *lamps]
        numbers = {spec.name: number for number, spec in enumerate(specs)}
        # Columns: view, chain, pixel, and the image about the picture's middle.
        rows: list[tuple[float, ...]] = []
        for index, view in enumerate(views):
            for sighting in view.sightings:
                u = sighting.u - view.width / 2.0
                v = sighting.v - view.height / 2.0
                rows.append((index, numbers[sighting.name], sighting.pixel, u, v))
        table = np.array(rows, dtype=np.float64).reshape(-1, 5)

        # Of a strip with many pixels, some at equal distances suffice.
        keep = np.ones(len(table), dtype=bool)
        for chain in range(len(strips)):
            is_own = table[:, 1] == chain
            pixels = np.unique(table[is_own, 2])
            if len(pixels) > MAX_MARKS:
                steps = np.linspace(0, len(pixels) - 1, MAX_MARKS).astype(int)
                is_chosen = np.isin(table[:, 2], pixels[steps])
                keep &= ~is_own | is_chosen
        table = table[keep]

        gravities = [view.gravity or UNKNOWN for view in views]
        downs = np.array(gravities, dtype=np.float64)
        downs /= np.linalg.norm(downs, axis=1, keepdims=True)
        view, chain = table[:, :2].T.astype(np.intp)
        side_px = float(max(views[0].width, views[0].height))
        return cls(
            view=view,
            chain=chain,
            pixel=table[:, 2],
            uv=table[:, 3:],
            downs=downs,
            strips=len(strips),
            side_px=side_px,
        )

    def of_chain(self, chain: int, view: int) -> tuple[Array, Array]:
        """Return the pixels and images of one strip or lamp in one view."""
        part = (self.view == view) & (self.chain == chain)
        return self.pixel[part], self.uv[part]

    @property
    def log_focal(self) -> float:
        """Return the expected logarithm of the focal length in image pixels."""
        return float(np.log(EXPECTED_FOCAL * self.side_px))


def candidate_poses(
    room: Array, camera: Array, images: Array, tolerance: float, down: Array | None
) -> list[tuple[Array, Array]]:
    """Return the rotation and translation of poses that explain the images of lines, the best first.

    More than one if the images fit several poses, for example of a short strip seen obliquely, from the left
    or from the right.

    Args:
        room: three points of each line in the room, m, n x 3 x 3.
        camera: the same points in the camera's frame, m, coarse along the line of sight.
        images: their normalized images (x/z, y/z), n x 3 x 2.
        tolerance: of an image.
        down: direction of gravity in the camera's frame, if that and the room's level are known.
    """
    # Hypotheses: each pair of lines, and with gravity each single line.
    count = len(room)
    pairs: list[tuple[int, int]] = list(combinations(range(count), 2))
    if down is not None:
        pairs += [(line, line) for line in range(count)]
    if not pairs:
        return []
    pairs = pairs[:: -(-len(pairs) // MAX_CANDIDATE_PAIRS)]
    members = np.zeros((len(pairs), count))
    for row, pair in enumerate(pairs):
        members[row, list(pair)] = 1.0
    rotations, translations = _rigid_motions(room, camera, members, down)

    # The errors of all lines in each hypothesis; a line behind the camera is wrong.
    points = np.einsum("hij,nkj->hnki", rotations, room)
    points += translations[:, None, None]
    depth = points[..., 2:]
    projected = points[..., :2] / np.maximum(depth, 0.05)
    distances = np.linalg.norm(projected - images, axis=3)
    is_in_front = np.min(depth[..., 0], axis=2) > 0.05
    error = np.where(is_in_front, distances.mean(axis=2), np.inf)
    costs = np.minimum(error / tolerance, 1.0).sum(axis=1)

    # The best ones, each at a place of its own.
    chosen: list[int] = []
    places = -np.einsum("hji,hj->hi", rotations, translations)
    for index in np.argsort(costs):
        is_new = all(np.linalg.norm(places[index] - places[other]) > DISTINCT_M for other in chosen)
        if costs[index] < count and is_new:
            chosen.append(int(index))
    return [(rotations[index], translations[index]) for index in chosen[:MAX_POSES]]


def _rigid_motions(room: Array, camera: Array, members: Array, down: Array | None) -> tuple[Array, Array]:
    """Return the rotations and translations from the lines that are `members` (h x n) of each hypothesis."""
    distances_m = np.linalg.norm(camera[:, 1], axis=1)
    near = 1.0 / distances_m**2  # depth errs by the square of the distance
    weights = members * near
    weights /= weights.sum(axis=1, keepdims=True)
    room_mean = np.einsum("hn,nki->hi", weights, room) / 3.0
    camera_mean = np.einsum("hn,nki->hi", weights, camera) / 3.0
    # sum of w (c - c0)(r - r0)' without the h x n x 3 x 3 x 3 array of differences
    products = np.einsum("nki,nkj->nij", camera, room)
    mean_products = np.einsum("hn,nij->hij", weights, products) / 3.0
    matrix = mean_products - camera_mean[:, :, None] * room_mean[:, None]
    if down is not None:
        matrix = matrix + GRAVITY_ARM_M**2 * np.outer(down, DOWN)

    # The nearest rotation, and no reflection
    left, _, right = np.linalg.svd(matrix)
    handedness = np.sign(np.linalg.det(left @ right))
    left[:, :, 2] *= handedness[:, None]
    rotations = left @ right
    turned_mean = np.einsum("hij,hj->hi", rotations, room_mean)
    return rotations, camera_mean - turned_mean


def levelled(directions: Array, lengths: Array, up: Array) -> Array:
    """Return the rotation into a level room in which most strips are level or upright.

    Args:
        directions: unit directions of straight pieces, n x 3.
        lengths: their lengths, m, n.
        up: rough direction of up, from the way in which the cameras were held, unit.
    """
    # Candidates for up: along a piece, or at right angles to two of them, not far from the rough direction.
    pairs = combinations(directions, 2)
    normals = [np.cross(first, second) for first, second in pairs]
    units: list[Array] = []
    for vector in (up, *directions, *normals):
        norm = np.linalg.norm(vector)
        if norm > 0.1:  # parallel pieces have no normal
            units.append(vector / norm)
    vectors = np.array(units)
    signs = np.where(vectors @ up < 0, -1.0, 1.0)
    vectors *= signs[:, None]
    vectors = vectors[vectors @ up > MIN_UPWARD]

    # The best one has the longest pieces that are level or upright, within 2° or so.
    cosines = np.einsum("ci,ni->cn", vectors, directions)
    rise = np.clip(np.abs(cosines), 0, 1)
    angle = np.minimum(np.arcsin(rise), np.arccos(rise))
    fits = lengths / (1.0 + (angle / np.radians(2.0)) ** 2)
    scores = fits.sum(axis=1) + 1e-3 * (vectors @ up)
    best = int(np.argmax(scores))
    return upright(vectors[best])


def upright(up: Array) -> Array:
    """Return the rotation with the least turn that moves the unit vector `up` to +z."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    cosine = float(up[2])
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = axis
    matrix = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    second_order = matrix @ matrix / (1.0 + cosine)
    return np.asarray(np.eye(3) + matrix + second_order)


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
        # Each of the pairs that share most, with each focal length, is a start.
        pairs = list(combinations(range(len(self._lines)), 2))
        pairs.sort(key=lambda pair: -self._shared_weight(*pair))
        starts: list[PlacedViews] = []
        for base, other in pairs[:PAIRS]:
            for focal in FOCALS:
                start = self._add(self._begin(base, focal * self._side_px), other)
                if start is not None:
                    starts.append(start)

        # The best starts grow, and the one with most views wins.
        starts.sort(key=_rank)
        grown = map(self._grown, starts[:STARTS])
        return min(grown, key=_completeness, default=None)

    def _shared_weight(self, base: int, other: int) -> float:
        """Return the number of pieces that two views share; one that is small in a picture counts less."""
        base_lines = self._lines[base]
        other_lines = self._lines[other]
        full_px = 0.15 * self._side_px
        weights: list[float] = []
        for piece in set(base_lines) & set(other_lines):
            extent_px = min(base_lines[piece].extent_px, other_lines[piece].extent_px)
            weights.append(min(1.0, extent_px / full_px))
        return sum(weights)

    def _begin(self, base: int, focal_px: float) -> PlacedViews:
        down = self._downs[base]
        rotation = np.eye(3)
        if np.isfinite(down[0]):
            rotation = upright(-down).T
        state = BundleState(
            log_focal=float(np.log(focal_px)),
            distortion=0.0,
            rotations=rotation[None],
            translations=np.zeros((1, 3)),
            ends=np.zeros((0, 2, 3)),
        )
        return self._with_pieces(PlacedViews([base], [], state))

    def _with_pieces(self, placed: PlacedViews) -> PlacedViews:
        """Return `placed` with all pieces that a placed view sees, each by the view that sees it largest."""
        state = placed.state
        pieces = list(placed.pieces)
        ends = list(placed.state.ends)
        views = [self._lines[view] for view in placed.views]
        visible = set[Piece]().union(*views)
        for piece in sorted(visible - set(pieces)):
            having = [index for index, lines in enumerate(views) if piece in lines]
            index = max(having, key=lambda index: views[index][piece].extent_px)
            line = views[index][piece]
            bounds = np.array(self._bounds[piece])
            in_camera = self._in_camera(state, line, piece, bounds)
            from_camera = in_camera - state.translations[index]
            ends.append(from_camera @ state.rotations[index])
            pieces.append(piece)
        all_ends = np.array(ends).reshape(-1, 2, 3)
        return PlacedViews(placed.views, pieces, replace(state, ends=all_ends))

    def _in_camera(self, state: BundleState, line: ImageLine, piece: Piece, pixels: Array) -> Array:
        strip, _ = piece
        focal_px = float(np.exp(state.log_focal))
        return line.in_camera(focal_px, self._pitches_m[strip], pixels)

    def _add(self, placed: PlacedViews, view: int) -> PlacedViews | None:
        """Return `placed` with `view` and its pieces, adjusted, or None if they do not agree."""
        state = placed.state
        room: list[Array] = []
        camera: list[Array] = []
        images: list[Array] = []
        # Three points of each piece that it sees: in the room, before the camera, and in the picture.
        for piece, (first, last) in zip(placed.pieces, state.ends, strict=True):
            line = self._lines[view].get(piece)
            if line is None:
                continue
            low, high = self._bounds[piece]
            first_pixel = float(line.pixels.min())
            last_pixel = float(line.pixels.max())
            pixels: Array = np.linspace(first_pixel, last_pixel, 3)
            shares = (pixels - low) / (high - low)
            from_first = shares[:, None] * (last - first)
            room.append(first + from_first)
            camera.append(self._in_camera(state, line, piece, pixels))
            images.append(line.at(pixels))
        if not room:
            return None

        # Gravity helps if this view and one of the placed views know it.
        has_gravity = np.isfinite(self._downs[:, 0])
        is_level = bool(has_gravity[view] and has_gravity[placed.views].any())
        focal = float(np.exp(state.log_focal))
        poses = candidate_poses(
            np.array(room),
            np.array(camera),
            images=np.array(images) / focal,
            tolerance=COARSE * self._side_px / focal,
            down=self._downs[view] if is_level else None,
        )

        # Each pose is adjusted with its pieces, and the best is taken if it hangs together.
        placements: list[PlacedViews] = []
        for rotation, translation in poses:
            rotations = np.concatenate([state.rotations, rotation[None]])
            translations = np.concatenate([state.translations, translation[None]])
            with_pose = replace(state, rotations=rotations, translations=translations)
            with_view = PlacedViews([*placed.views, view], placed.pieces, with_pose)
            placements.append(self._adjusted(self._with_pieces(with_view)))
        best = min(placements, key=_rank, default=None)
        if best is None or not self._is_tied(best):
            return None
        return best

    def _grown(self, placed: PlacedViews) -> PlacedViews:
        """Return `placed` with all further views that agree, those that share the most pieces first."""
        refused: set[int] = set()
        limit = WORSE * placed.cost + 0.2
        while True:
            waiting: list[tuple[int, int]] = []
            for view, lines in enumerate(self._lines):
                if view not in placed.views and view not in refused:
                    shared_count = len(set(placed.pieces) & set(lines))
                    waiting.append((shared_count, view))
            if not waiting:
                return placed
            _, view = max(waiting)
            grown = self._add(placed, view)
            if grown is None or grown.cost > limit:
                refused.add(view)
            else:
                placed = grown
                refused = set()

    def _adjusted(self, placed: PlacedViews) -> PlacedViews:
        """Return `placed` adjusted to its sightings, with its ties and its cost."""
        bundle = self._bundle(placed)
        coarse = bundle.solve(placed.state, 10, WIDE_PX)
        state = bundle.solve(coarse, 5, NARROW_PX)
        errors = np.linalg.norm(bundle.errors(state), axis=1)
        stretches = np.abs(bundle.stretch(state))
        is_good = (errors < GOOD_PX) & (stretches[bundle.piece] < MAX_STRETCH)

        # A piece ties a view, views x pieces, if most of its sightings there are good, and so in another one.
        counts = np.zeros((len(placed.views), len(placed.pieces)))
        good_counts = counts.copy()
        np.add.at(counts, (bundle.view, bundle.piece), 1.0)
        np.add.at(good_counts, (bundle.view, bundle.piece), is_good)
        is_shared = (counts > 0).sum(axis=0) > 1
        is_tie = (good_counts > MAX_PAIRS * counts) & is_shared
        is_tie &= is_tie.sum(axis=0) > 1
        tie_rows: list[list[bool]] = is_tie.tolist()
        ties = [tuple(compress(placed.pieces, row)) for row in tie_rows]

        is_of_tie = is_tie[bundle.view, bundle.piece]
        tie_errors: Array = errors[is_of_tie & is_good]
        cost = np.inf
        if len(tie_errors):
            cost = float(np.mean(tie_errors**2))
        return PlacedViews(placed.views, placed.pieces, state, tuple(ties), cost)

    def _is_tied(self, placed: PlacedViews) -> bool:
        """Return True if the last view hangs together with the others by more than chance."""
        ties = placed.ties[-1]
        own = self._lines[placed.views[-1]]
        others = [self._lines[view] for view in placed.views[:-1]]
        shown = set(own) & set[Piece]().union(*others)
        if len(ties) < MAX_LINES * len(shown):
            return False

        # Two ties with many pixels, here and in another view.
        firm_count = 0
        for piece in ties:
            most_pixels = max(len(lines[piece].pixels) for lines in others if piece in lines)
            if min(len(own[piece].pixels), most_pixels) >= MIN_TIES:
                firm_count += 1
        return firm_count > 1 and not _is_from_behind(placed)

    def _bundle(self, placed: PlacedViews) -> BundleProblem:
        """Return the adjustment of all sightings of placed pieces in placed views."""
        indices: list[int] = []
        numbers: list[int] = []
        lines: list[ImageLine] = []
        for index, view in enumerate(placed.views):
            for number, piece in enumerate(placed.pieces):
                line = self._lines[view].get(piece)
                if line is not None:
                    indices.append(index)
                    numbers.append(number)
                    lines.append(line)

        sizes = [len(line.pixels) for line in lines]
        bounds = np.array([self._bounds[piece] for piece in placed.pieces])
        spans = bounds[:, 1] - bounds[:, 0]
        pieces = np.repeat(numbers, sizes)
        pixels = np.concatenate([line.pixels for line in lines])
        images = np.concatenate([line.uv for line in lines])
        from_first = pixels - bounds[pieces, 0]
        pitches_m = [self._pitches_m[strip] for strip, _ in placed.pieces]
        return BundleProblem(
            view=np.repeat(indices, sizes),
            piece=pieces,
            share=from_first / spans[pieces],
            uv=images,
            log_length=np.log(spans * pitches_m),
            length_sigma=np.full(len(spans), PITCH_SIGMA),
            down=self._downs[placed.views],
            log_focal=self._log_focal,
        )


def _rank(placed: PlacedViews) -> tuple[int, float]:
    """Return the order of placements by their last view, the best first."""
    return -len(placed.ties[-1]), placed.cost


def _completeness(placed: PlacedViews) -> tuple[int, float]:
    """Return the order of placements by all their views, the best first."""
    return -len(placed.views), placed.cost


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
    last_ties = set(placed.ties[-1])
    for index, ties in enumerate(placed.ties[:-1]):
        if last_ties.intersection(ties) and sides[index] * sides[-1] < 0:
            return True
    return False
