"""The adjustment of all sightings, in which those that do not fit are left out step by step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from pointit.geometry.array_types import Array, Indices, Mask
from pointit.scan.bundle import BundleProblem, BundleState
from pointit.scan.lines import ImageLine
from pointit.scan.poses import PITCH_SIGMA, Piece, PlacedViews, SightingArrays
from pointit.scan.views import LampSpec, StripSpec

GATES_PX = (40.0, 15.0, 8.0)
"""Largest errors of sightings that are used, one step after another; then `GATE_SIGMAS`."""
GATE_SIGMAS = 5.0
MIN_GATE_PX = 2.0
MIN_NOISE_PX = 0.3
MIN_SHARE = 0.4
"""Share of a strip's pixels in a view that have to agree, or all of them are left out of that view."""
ANY_LENGTH_SIGMA = 1.0
"""Standard deviation of the logarithm of a piece's length if its pitch is unknown."""
LAMP_PIECE = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Ends of the piece that stands at a lamp, beside its position, m."""
ANY_PITCH_M = 1.0 / 60.0
"""Expected distance from pixel to pixel if the pitch is unknown, m."""
MIN_BEND = 0.05
"""Difference of two directions, rad, below which a strip goes on straight."""


@dataclass(frozen=True)
class Model:
    """Pieces of chains, in order.

    Attributes:
        chain: chain of each piece, p.
        bounds: pixel numbers of the ends of each piece, p x 2. Those of a lamp are 0 and 1.
    """

    chain: Indices
    bounds: Array

    def pieces(self, chains: Indices, pixels: Array) -> Indices:
        """Return the piece of each pixel of a chain, n. -1: the chain has none."""
        pieces = np.full(len(chains), -1, dtype=np.intp)
        for chain in np.unique(self.chain):
            own = np.flatnonzero(self.chain == chain)
            corners = self.bounds[own[:-1], 1]
            part = chains == chain
            order = np.searchsorted(corners, pixels[part])
            pieces[part] = own[order]
        return pieces

    def shares(self, pieces: Indices, pixels: Array) -> Array:
        """Return the positions of pixels between the ends of their pieces, n."""
        low, high = self.bounds[pieces].T
        return np.asarray((pixels - low) / (high - low))

    def corners(self) -> Indices:
        """Return the pieces that are followed by another one of the same chain."""
        goes_on = self.chain[:-1] == self.chain[1:]
        return np.flatnonzero(goes_on)


@dataclass(frozen=True)
class Refined:
    """The outcome.

    Attributes:
        seen, bundle, state, model: sightings, equations, unknowns and pieces.
        views: number in `seen` of each view of `state`.
        used: True for the sightings of `seen` that were used.
        noise_px: standard deviation of one coordinate of an image.
        loss_px: scale of the loss.
    """

    seen: SightingArrays
    bundle: BundleProblem
    state: BundleState
    model: Model
    views: list[int]
    used: Mask
    noise_px: float
    loss_px: float

    @property
    def cameras(self) -> Array:
        """Return the positions of the cameras of `state`, views x 3, m."""
        state = self.state
        return np.asarray(-np.einsum("vji,vj->vi", state.rotations, state.translations))

    def places(self, chain: int, pixels: Array) -> Array:
        """Return the points of the room of pixels of a chain, n x 3."""
        pieces = self.model.pieces(np.full(len(pixels), chain), pixels)
        shares = self.model.shares(pieces, pixels)
        first, last = self.state.ends[pieces].transpose(1, 0, 2)
        from_first = shares[:, None] * (last - first)
        return np.asarray(first + from_first)

    def vertices(self, counts: Sequence[int]) -> tuple[Array, Array, Indices]:
        """Return ends and corners of all chains, v x 3, their covariance, m², and the chain of each.

        `counts` are the numbers of pixels of the strips. An end that no view shows is in line with the rest.
        """
        model = self.model
        eye = np.eye(3)
        corners = set(model.corners().tolist())
        chains: list[int] = []
        blocks: list[Array] = []  # derivatives of a vertex by all ends, 3 x 2 p x 3
        for piece, chain in enumerate(model.chain.tolist()):
            is_strip = chain < len(counts)
            edges = np.zeros(2)
            if is_strip:
                edges = np.array([-0.5, counts[chain] - 0.5])
            begin, end = model.shares(np.array([piece, piece]), edges)

            # Derivatives of its vertices by this piece's first end and those that follow.
            derivatives: list[list[Array]] = []
            if piece - 1 not in corners:
                derivatives.append([(1.0 - begin) * eye, begin * eye])
            if piece in corners:
                _, steps, bend = corner(self.state, model, piece)
                if bend.any():
                    half = eye / 2.0
                    slip = np.outer(steps.mean(axis=0), bend)
                    derivatives.append([0.0 * eye, half - slip, half + slip])
            elif is_strip:
                derivatives.append([(1.0 - end) * eye, end * eye])

            for parts in derivatives:
                block = np.zeros((3, 2 * len(model.chain), 3))
                for position, part in enumerate(parts, 2 * piece):
                    block[:, position] = part
                blocks.append(block.reshape(3, -1))
                chains.append(chain)
        matrix = np.concatenate(blocks)
        vertices = (matrix @ self.state.ends.ravel()).reshape(-1, 3)
        end_covariance = self.bundle.covariance(self.state, self.loss_px, self.noise_px)
        covariance = matrix @ end_covariance @ matrix.T
        return vertices, np.asarray(covariance), np.array(chains)


def refined(
    seen: SightingArrays,
    specs: Sequence[StripSpec | LampSpec],
    placed: PlacedViews,
    bounds: Mapping[Piece, tuple[float, float]],
    lines: Sequence[Mapping[Piece, ImageLine]],
) -> Refined:
    """Return the adjustment of all sightings from the poses of `placed`."""
    # Sightings of what has a first position, in views that have one
    state, model = _started(seen, specs, placed, bounds, lines)
    number = np.full(len(seen.downs), -1)
    number[placed.views] = np.arange(len(placed.views))
    is_placed = number[seen.view] >= 0
    has_position = np.isin(seen.chain, model.chain)
    candidates = np.flatnonzero(is_placed & has_position)

    # Stated lengths of pixels, m. Without one, any length will do, and a lamp has none.
    pixels_m: list[float] = []
    sigmas: list[float] = []
    for spec in specs:
        pitch_m = spec.pitch_m if isinstance(spec, StripSpec) else None
        pixels_m.append(pitch_m or ANY_PITCH_M)
        if isinstance(spec, LampSpec):
            sigmas.append(np.inf)
        else:
            sigmas.append(PITCH_SIGMA if pitch_m else ANY_LENGTH_SIGMA)
    length_sigmas = np.array(sigmas)[model.chain]
    piece_pixels_m = np.array(pixels_m)[model.chain]

    def bundle_of(rows: Indices) -> BundleProblem:
        pixels = seen.pixel[rows]
        pieces = model.pieces(seen.chain[rows], pixels)
        low, high = model.bounds.T
        return BundleProblem(
            view=number[seen.view[rows]],
            piece=pieces,
            share=model.shares(pieces, pixels),
            uv=seen.uv[rows],
            log_length=np.log(piece_pixels_m * (high - low)),
            length_sigma=length_sigmas,
            down=seen.downs[placed.views],
            log_focal=seen.log_focal,
            corners=model.corners().tolist(),
        )

    # Gates that become narrower, at last by the noise that is measured. 1.4826: from the median of the
    # absolute errors to their standard deviation.
    noise_px = 1.0
    loss_px = GATES_PX[0]
    bundle = bundle_of(candidates)
    used = candidates
    for gate in (*GATES_PX, None, None):
        state, model = _with_corners(state, model)
        errors = np.linalg.norm(bundle_of(candidates).errors(state), axis=1)
        limit_px = gate or max(MIN_GATE_PX, GATE_SIGMAS * noise_px)
        is_good = _agreeing(seen, candidates, errors, limit_px)
        if not is_good.any():
            break
        used = candidates[is_good]
        bundle = bundle_of(used)
        loss_px = gate / 4.0 if gate else 3.0 * noise_px
        state = bundle.solve(state, 12, loss_px, noise_px)
        median_px = float(np.median(np.abs(bundle.errors(state))))
        noise_px = max(MIN_NOISE_PX, 1.4826 * median_px)
    mask = np.zeros(len(seen.view), dtype=bool)
    mask[used] = True
    return Refined(seen, bundle, state, model, placed.views, mask, noise_px, loss_px)


def _started(
    seen: SightingArrays,
    specs: Sequence[StripSpec | LampSpec],
    placed: PlacedViews,
    bounds: Mapping[Piece, tuple[float, float]],
    lines: Sequence[Mapping[Piece, ImageLine]],
) -> tuple[BundleState, Model]:
    """Return initial positions of all strips and lamps, from placed pieces and from triangulation."""
    ends = dict(zip(placed.pieces, placed.state.ends, strict=True))

    # Pieces of unknown pitch, from their lines in two views or more.
    for piece, (low, high) in bounds.items():
        indices = [index for index, view in enumerate(placed.views) if piece in lines[view]]
        if piece in ends or len(indices) < 2:
            continue
        own_lines = [lines[placed.views[index]][piece] for index in indices]
        own_ends = _triangulated_ends(placed.state, indices, own_lines, low, high)
        if own_ends is not None:
            ends[piece] = own_ends

    # Lamps: a piece of any length stands at each.
    for chain, spec in enumerate(specs):
        if isinstance(spec, LampSpec):
            rows = np.flatnonzero(seen.chain == chain)
            rows = rows[np.isin(seen.view[rows], placed.views)]
            views: list[int] = seen.view[rows].tolist()
            indices = [placed.views.index(view) for view in views]
            point = triangulated(placed.state, indices, seen.uv[rows])
            if point is not None:
                ends[chain, 0] = point + LAMP_PIECE

    # Of a strip whose middle was never seen, the part before it.
    pieces: list[Piece] = []
    for chain, index in sorted(ends):
        if pieces:
            last_chain, last_index = pieces[-1]
            if last_chain == chain and last_index != index - 1:
                continue
        pieces.append((chain, index))
    chains = np.array([chain for chain, _ in pieces], dtype=np.intp)
    grid = np.array([bounds.get(piece, (0.0, 1.0)) for piece in pieces])
    piece_ends = np.array([ends[piece] for piece in pieces])
    return replace(placed.state, ends=piece_ends), Model(chains, grid)


def _triangulated_ends(
    state: BundleState, views: Sequence[int], lines: Sequence[ImageLine], low: float, high: float
) -> Array | None:
    """Return the ends of a piece, 2 x 3, from its lines in `views`, or None if these do not determine them.

    `low` and `high` are the pixel numbers of its ends.
    """
    # The first and last pixel that all lines have.
    first_pixel = max(line.pixels.min() for line in lines)
    last_pixel = min(line.pixels.max() for line in lines)
    pixels = np.array([first_pixel, last_pixel])
    images = np.array([line.at(pixels) for line in lines])
    first = triangulated(state, views, images[:, 0])
    last = triangulated(state, views, images[:, 1])
    if last_pixel <= first_pixel or first is None or last is None:
        return None
    shares = (np.array([low, high]) - first_pixel) / (last_pixel - first_pixel)
    from_first = shares[:, None] * (last - first)
    return np.asarray(first + from_first)


def corner(state: BundleState, model: Model, piece: int) -> tuple[float, Array, Array]:
    """Return the meeting of a piece and the next one.

    Returns:
        How many pixels later than their common bound, the directions of both, m a pixel, 2 x 3, and the
        derivative of the former by the gap, 3.
    """
    both = slice(piece, piece + 2)
    low, high = model.bounds[both].T
    first, last = state.ends[both].transpose(1, 0, 2)
    steps = (last - first) / (high - low)[:, None]
    bend = steps[0] - steps[1]
    min_bend = MIN_BEND * np.linalg.norm(steps[0])
    if np.linalg.norm(bend) < min_bend:
        return 0.0, steps, np.zeros(3)
    bend /= bend @ bend
    gap = last[0] - first[1]
    return -float(bend @ gap), steps, bend


def _with_corners(state: BundleState, model: Model) -> tuple[BundleState, Model]:
    """Return the same with all corners where two pieces meet, or nearly."""
    ends = state.ends.copy()
    bounds = model.bounds.copy()
    for piece in model.corners():
        later, steps, _ = corner(state, model, piece)
        # Each piece keeps a length of one pixel.
        old_bound = bounds[piece, 1]
        low = bounds[piece, 0] + 1.0
        high = bounds[piece + 1, 1] - 1.0
        new_bound = float(np.clip(old_bound + later, low, high))

        # A corner moves along both pieces, each of which keeps its direction.
        shift = new_bound - old_bound
        ends[piece, 1] += shift * steps[0]
        ends[piece + 1, 0] += shift * steps[1]
        bounds[piece, 1] = new_bound
        bounds[piece + 1, 0] = new_bound
    return replace(state, ends=ends), Model(model.chain, bounds)


def _agreeing(seen: SightingArrays, candidates: Indices, errors: Array, limit_px: float) -> Mask:
    """Return which candidates to use: within the limit, the nearest of its pixel, with its strip."""
    # Of several sightings of one pixel in a view, such as of reflections, the one with the least error.
    keys = np.column_stack([seen.view, seen.chain, seen.pixel])[candidates]
    views, chains, pixels = keys.T
    order = np.lexsort((errors, pixels, chains, views))
    sorted_keys = keys[order]
    is_repeated = np.all(sorted_keys[1:] == sorted_keys[:-1], axis=1)
    is_nearest = np.ones(len(candidates), dtype=bool)
    is_nearest[order[1:][is_repeated]] = False
    is_good = is_nearest & (errors < limit_px)

    # Of a strip in a view, none unless most are good.
    view_and_chain = keys[:, :2]
    _, pairs = np.unique(view_and_chain, axis=0, return_inverse=True)
    pairs = pairs.ravel()
    counts = np.maximum(np.bincount(pairs, is_nearest), 1)
    shares = np.bincount(pairs, is_good) / counts
    return np.asarray(is_good & (shares[pairs] >= MIN_SHARE))


def triangulated(state: BundleState, views: Sequence[int], uv: Array) -> Array | None:
    """Return the point in the room that is seen at `uv` (n x 2) in `views` (n), or None if there is none.

    With wrong or double sightings: the point of two rays that most others agree with.
    """
    # Rays in the room, and the projections onto the plane across each.
    index = np.array(views, dtype=np.intp)
    rotations = state.rotations[index]
    flat = uv.reshape(-1, 2) / np.exp(state.log_focal)
    directions = np.column_stack([flat, np.ones(len(index))])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays = np.einsum("nji,nj->ni", rotations, directions)
    outer_products = rays[:, :, None] * rays[:, None, :]
    across = np.eye(3) - outer_products
    origins = -np.einsum("nji,nj->ni", rotations, state.translations[index])
    moments = np.einsum("nij,nj->ni", across, origins)

    # The point nearest to each two rays of different views; the others vote by their errors.
    best: Array | None = None
    best_score = 0.0
    for a, b in combinations(range(len(index)), 2):
        matrix = across[a] + across[b]
        is_parallel = np.linalg.det(matrix) <= 1e-3
        if index[a] == index[b] or is_parallel:
            continue
        moment = moments[a] + moments[b]
        point = np.asarray(np.linalg.solve(matrix, moment), dtype=np.float64)
        copies = np.broadcast_to(point, (len(index), 3))
        images, depths = state.image(index, copies)
        errors = np.linalg.norm(images - uv, axis=1)
        votes = np.clip(1.0 - errors / GATES_PX[0], 0.0, None)
        score = float(votes[depths > 0].sum())
        if min(depths[a], depths[b]) > 0 and score > best_score:
            best = point
            best_score = score
    return best
