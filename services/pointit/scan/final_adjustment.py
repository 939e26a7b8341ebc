"""The adjustment of all sightings, in which those that do not fit are left out step by step."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pointit.scan.adjustment import (
    ANY_PITCH_SIGMA,
    PITCH_SIGMA,
    Adjustment,
    Array,
    Indices,
    Layout,
    State,
    project,
)
from pointit.scan.first_poses import EXPECTED_FOCAL, Placed
from pointit.scan.lines import Mask
from pointit.scan.views import LampSpec, StripSpec, View

GATES_PX = (40.0, 15.0, 8.0)
"""Largest errors of sightings that are used, one step after another; then `GATE_SIGMAS`."""
GATE_SIGMAS = 5.0
LEAST_GATE_PX = 2.0
LEAST_NOISE_PX = 0.3
LEAST_SHARE = 0.4
"""Share of a strip's pixels in a view that have to agree, or all of them are left out of that view."""


@dataclass(frozen=True)
class Seen:
    """All sightings as arrays.

    Attributes:
        view, chain, pixel, uv: n, n, n, n x 2 from the images' centres. Chains are strips, then lamps.
        downs: directions of gravity, views x 3, NaN if unknown.
        strips: number of strips.
    """

    view: Indices
    chain: Indices
    pixel: Array
    uv: Array
    downs: Array
    strips: int

    @classmethod
    def of(
        cls, strips: Sequence[StripSpec], lamps: Sequence[LampSpec], views: Sequence[View], max_marks: int
    ) -> "Seen":
        """Return the sightings of `views`, of at most `max_marks` different pixels of a strip in a view."""
        specs: list[StripSpec | LampSpec] = [*strips, *lamps]
        numbers = {each.name: number for number, each in enumerate(specs)}
        rows = [
            (index, numbers[seen.name], seen.pixel, seen.u - view.width / 2.0, seen.v - view.height / 2.0)
            for index, view in enumerate(views)
            for seen in view.sightings
        ]
        table = np.array(rows, dtype=np.float64).reshape(-1, 5)
        keep = np.ones(len(table), dtype=bool)
        for view, chain in {(row[0], row[1]) for row in rows}:
            of = np.flatnonzero((table[:, 0] == view) & (table[:, 1] == chain))
            pixels = np.unique(table[of, 2])
            if len(pixels) > max_marks:
                chosen = pixels[np.linspace(0, len(pixels) - 1, max_marks).astype(int)]
                keep[of] = np.isin(table[of, 2], chosen)
        table = table[keep]
        downs = np.array([view.gravity or (np.nan,) * 3 for view in views], dtype=np.float64)
        downs /= np.linalg.norm(downs, axis=1, keepdims=True)
        return cls(
            table[:, 0].astype(np.intp),
            table[:, 1].astype(np.intp),
            table[:, 2],
            table[:, 3:],
            downs,
            len(strips),
        )

    def of_strip(self, strip: int) -> list[tuple[Array, Array]]:
        """Return the pixels and images of one strip in each view."""
        found: list[tuple[Array, Array]] = []
        for view in range(len(self.downs)):
            part = (self.view == view) & (self.chain == strip)
            found.append((self.pixel[part], self.uv[part]))
        return found


@dataclass(frozen=True)
class Adjusted:
    """The outcome.

    Attributes:
        adjustment, state: of the chains and views in `chains` and `views`, which are numbers of `seen`.
        used: True for the sightings of `seen` that were used.
        noise_px: standard deviation of one coordinate of an image.
        loss_px: scale of the loss.
    """

    seen: Seen
    adjustment: Adjustment
    state: State
    chains: list[int]
    views: list[int]
    used: Mask
    noise_px: float
    loss_px: float


class FinalAdjustment:
    """Adjusts chains and lamps from first places."""

    def __init__(
        self, seen: Seen, strips: Sequence[StripSpec], lamps: Sequence[LampSpec], side_px: float
    ) -> None:
        """Create for the sightings `seen`; `side_px` is the longer side of the images."""
        self._seen = seen
        self._strips = strips
        self._lamps = lamps
        self._log_focal = float(np.log(EXPECTED_FOCAL * side_px))

    def adjusted(self, placed: Placed, starts: Mapping[int, tuple[Array, Array]]) -> Adjusted:
        """Return the adjustment from the poses of `placed` and the strips of `starts` (vertices, knots)."""
        seen = self._seen
        places = dict(starts)
        for lamp in range(len(self._strips), len(self._strips) + len(self._lamps)):
            point = self._lamp(placed, lamp)
            if point is not None:
                places[lamp] = (point[None], np.zeros(1))
        chains = sorted(places)
        state = State(
            placed.state.log_focal,
            placed.state.distortion,
            placed.state.rotations,
            placed.state.translations,
            np.concatenate([places[chain][0] for chain in chains]),
            np.concatenate([places[chain][1] for chain in chains]),
            np.zeros(len(chains)),
        )
        sizes = [len(places[chain][1]) for chain in chains]
        view_numbers = np.full(len(seen.downs), -1)
        view_numbers[placed.views] = np.arange(len(placed.views))
        chain_numbers = np.full(len(self._strips) + len(self._lamps), -1)
        chain_numbers[chains] = np.arange(len(chains))
        candidates = np.flatnonzero((view_numbers[seen.view] >= 0) & (chain_numbers[seen.chain] >= 0))

        def layout(sightings: Indices) -> Layout:
            specs = [self._strips[chain] if chain < len(self._strips) else None for chain in chains]
            return Layout(
                view=view_numbers[seen.view[sightings]],
                chain=chain_numbers[seen.chain[sightings]],
                pixel=seen.pixel[sightings],
                uv=seen.uv[sightings],
                first=np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp),
                log_pitch=np.log([(spec.pitch_m if spec and spec.pitch_m else 1 / 60) for spec in specs]),
                pitch_sigma=np.array(
                    [PITCH_SIGMA if spec and spec.pitch_m else ANY_PITCH_SIGMA for spec in specs]
                ),
                down=seen.downs[placed.views],
                log_focal=self._log_focal,
            )

        everything = Adjustment(layout(candidates))
        noise_px, loss_px = 1.0, GATES_PX[0]
        used = candidates
        adjustment = everything
        for gate in (*GATES_PX, None, None):
            errors = np.linalg.norm(everything.errors(state), axis=1)
            limit = gate or max(LEAST_GATE_PX, GATE_SIGMAS * noise_px)
            good = self._agreeing(candidates, errors, limit)
            if not good.any():
                break
            used = candidates[good]
            adjustment = Adjustment(layout(used))
            loss_px = gate / 4.0 if gate else 3.0 * noise_px
            state = adjustment.solve(state, 12, loss_px, noise_px)
            within = adjustment.errors(state)
            noise_px = max(LEAST_NOISE_PX, 1.4826 * float(np.median(np.abs(within))))
        mask = np.zeros(len(seen.view), dtype=bool)
        mask[used] = True
        return Adjusted(seen, adjustment, state, chains, placed.views, mask, noise_px, loss_px)

    def _agreeing(self, candidates: Indices, errors: Array, limit_px: float) -> Mask:
        """Return which candidates to use: within the limit, the nearest of its pixel, with its strip."""
        seen = self._seen
        good = errors < limit_px
        keys = np.column_stack([seen.view, seen.chain, seen.pixel])[candidates]
        order = np.lexsort((errors, keys[:, 2], keys[:, 1], keys[:, 0]))
        repeated = np.all(keys[order][1:] == keys[order][:-1], axis=1)
        first = np.ones(len(candidates), dtype=bool)
        first[order[1:][repeated]] = False
        good &= first
        pair = keys[:, 0] * (self._seen.chain.max() + 1) + keys[:, 1]
        _, of_pair = np.unique(pair, return_inverse=True)
        share = np.bincount(of_pair, good) / np.maximum(np.bincount(of_pair, first), 1)
        return good & (share[of_pair] >= LEAST_SHARE)

    def _lamp(self, placed: Placed, lamp: int) -> Array | None:
        """Return the point nearest to the rays of a lamp in two or more views, or None.

        With wrong or double sightings: the pair of rays that most others agree with.
        """
        seen, state = self._seen, placed.state
        rows = [row for row in np.flatnonzero(seen.chain == lamp) if seen.view[row] in placed.views]
        views = np.array([placed.views.index(seen.view[row]) for row in rows], dtype=np.intp)
        if len(set(views)) < 2:
            return None
        uv = seen.uv[rows]
        rays = np.column_stack([uv / np.exp(state.log_focal), np.ones(len(rows))])
        rays = np.einsum("nji,nj->ni", state.rotations[views], rays / np.linalg.norm(rays, axis=1)[:, None])
        origins = -np.einsum("nji,nj->ni", state.rotations[views], state.translations[views])
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
        moments = np.einsum("nij,nj->ni", across, origins)
        best: Array | None = None
        best_score = -1.0
        for a in range(len(rows)):
            for b in range(a):
                matrix = across[a] + across[b]
                if views[a] == views[b] or np.linalg.det(matrix) < 1e-3:
                    continue
                point = np.asarray(np.linalg.solve(matrix, moments[a] + moments[b]), dtype=np.float64)
                images, depths = project(state, views, np.broadcast_to(point, (len(rows), 3)))
                errors = np.linalg.norm(images - uv, axis=1)
                score = float(np.clip(1.0 - errors / GATES_PX[0], 0.0, None)[depths > 0].sum())
                if depths[a] > 0 and depths[b] > 0 and score > best_score:
                    best, best_score = point, score
        return best
