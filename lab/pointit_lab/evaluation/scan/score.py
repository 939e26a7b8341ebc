"""Errors of scans of simulated rooms, and whether what they state of themselves holds."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from pointit.scan.result import Scan, ScanError, ScannedStrip
from pointit.scan.solver import next_view, solve
from pointit_lab.evaluation.scan.rooms import (
    Array,
    CameraPose,
    ScanRoom,
    SimulatedPhone,
    next_pose,
    photograph,
    random_room,
    standing,
)

WRONG_M, SURE_M = 0.03, 0.01
"""An end is wrong if it is further off than the former while the stated sigma is below the latter."""


@dataclass(frozen=True)
class ScanTrial:
    """One scan of one room.

    Attributes:
        strips, identified: number of strips, and of those said to be identified.
        errors_m, sigmas_m: of both ends of identified strips: error beside the other strips, stated sigma.
        lamps: number of lamps.
        lamp_errors_m, lamp_sigmas_m: of identified lamps, beside the strips.
        complete: True if it asks for no further view. False: "one more view".
        refused: the sentence, if there is no scan.
        tilt_rad, level_sigma_rad: error of the level, and stated sigma per axis. NaN without a scan.
        scale_error: relative, and NaN without a scan.
        cpu_s: time of the solver.
    """

    seed: int
    strips: int
    identified: int
    errors_m: tuple[float, ...]
    sigmas_m: tuple[float, ...]
    complete: bool
    refused: str
    tilt_rad: float
    level_sigma_rad: float
    scale_error: float
    cpu_s: float
    lamps: int
    lamp_errors_m: tuple[float, ...]
    lamp_sigmas_m: tuple[float, ...]

    @property
    def wrong(self) -> int:
        """Return the number of ends and lamps that are wrong, see `WRONG_M`."""
        errors, sigmas = self.errors_m + self.lamp_errors_m, self.sigmas_m + self.lamp_sigmas_m
        return sum(e > WRONG_M and s < SURE_M for e, s in zip(errors, sigmas, strict=True))


def trials(seed: int, counts: Sequence[int], *, advised: bool = False) -> list[ScanTrial]:
    """Return the scans of one random room after so many views; later views add to the earlier ones.

    If `advised`, the person follows the advice of where to stand, from the third view on, until the scan is
    complete.
    """
    rng = np.random.default_rng(seed)
    room, phone = random_room(rng), SimulatedPhone.random(rng)
    poses = standing(rng, room, phone, 2 if advised else max(counts))
    views = [photograph(rng, room, phone, pose) for pose in poses]
    results: list[ScanTrial] = []
    for count in range(2, max(counts) + 1) if advised else counts:
        began = time.process_time()
        scan: Scan | None = None
        refused = ""
        try:
            scan = solve(
                [strip.spec for strip in room.strips], [lamp for lamp, _ in room.lamps], views[:count]
            )
        except ScanError as error:
            refused = str(error)
        if count in counts:
            results.append(_trial(seed, room, scan, refused, time.process_time() - began))
        if advised and scan is not None and scan.complete():
            return results + results[-1:] * (len(counts) - len(results))
        if advised:
            poses.append(_advised_pose(rng, room, phone, poses, scan))
            views.append(photograph(rng, room, phone, poses[-1]))
    return results


def _advised_pose(
    rng: np.random.Generator,
    room: ScanRoom,
    phone: SimulatedPhone,
    poses: Sequence[CameraPose],
    scan: Scan | None,
) -> CameraPose:
    """Return the next pose of a person who follows the advice as far as it goes."""
    advice = None if scan is None else next_view(scan)
    if scan is None or advice is None:
        return next_pose(rng, room, phone, poses)
    if advice.position_m is None or advice.look_at_m is None:
        return next_pose(rng, room, phone, poses, wanted=advice.names[0])
    scale, rotation, shift = _to_the_room(room, scan.strips)[0]
    there = scale * np.array([advice.position_m, advice.look_at_m]) @ rotation.T + shift
    return next_pose(rng, room, phone, poses, wanted=advice.names[0], advised=(there[0], there[1]))


def _to_the_room(
    room: ScanRoom, scanned: Mapping[str, ScannedStrip]
) -> tuple[tuple[float, Array, Array], Array, Array]:
    """Return the scale, rotation and shift from a scan to the room, and errors and sigmas of both ends, m."""
    true = {strip.spec.name: strip for strip in room.strips}
    measured = np.array([end for each in scanned.values() for end in (each.start, each.end)])
    actual = np.array([end for name in scanned for end in (true[name].line_m[0], true[name].line_m[-1])])
    sigmas = np.repeat([each.sigma_m for each in scanned.values()], 2)
    scale, rotation, shift = aligned(measured, actual, sigmas)
    errors = np.linalg.norm(scale * measured @ rotation.T + shift - actual, axis=1)
    return (scale, rotation, shift), errors, sigmas


def _trial(seed: int, room: ScanRoom, scan: Scan | None, refused: str, cpu_s: float) -> ScanTrial:
    found = {} if scan is None else {k: each for k, each in scan.strips.items() if each.identified}
    tilt = level = scale_error = math.nan
    errors: Array = np.zeros(0)
    sigmas: Array = np.zeros(0)
    lamps: list[tuple[float, float]] = []
    if scan is not None and found:
        (scale, rotation, shift), errors, sigmas = _to_the_room(room, found)
        tilt = math.acos(min(1.0, float(rotation[2, 2])))
        level, scale_error = scan.level_sigma_rad, 1.0 / scale - 1.0
        for spec, place in room.lamps if len(found) > 1 else ():  # one strip gives no direction round it
            lamp = scan.lamps.get(spec.name)
            if lamp is not None and lamp.identified:
                at = scale * rotation @ np.array(lamp.position_m) + shift
                lamps.append((float(np.linalg.norm(at - place)), lamp.sigma_m))
    return ScanTrial(
        seed,
        len(room.strips),
        len(found),
        tuple(errors.tolist()),
        tuple(sigmas.tolist()),
        scan is not None and scan.complete(),
        refused,
        tilt,
        level,
        scale_error,
        cpu_s,
        len(room.lamps),
        tuple(error for error, _ in lamps),
        tuple(sigma for _, sigma in lamps),
    )


def aligned(measured: Array, actual: Array, sigmas: Array) -> tuple[float, Array, Array]:
    """Return the scale, rotation and shift from `measured` (2 a strip) to `actual` that most strips fit."""
    strips = len(measured) // 2
    best: tuple[float, Array] | None = None
    for pair in combinations(range(strips), min(2, strips)):
        rows = np.array([row for strip in pair for row in (2 * strip, 2 * strip + 1)])
        scale, rotation, shift = _similarity(measured[rows], actual[rows], sigmas[rows])
        off = np.linalg.norm(scale * measured @ rotation.T + shift - actual, axis=1) / sigmas
        cost = float(np.minimum(off**2, 16.0).sum()) + (1e6 if abs(scale - 1.0) > 0.05 else 0.0)
        if best is None or cost < best[0]:
            best = (cost, off)
    off = np.zeros(len(measured)) if best is None else best[1]
    result = _similarity(measured, actual, sigmas * np.sqrt(1.0 + (off / 3.0) ** 2) ** 3)
    for _ in range(5):
        scale, rotation, shift = result
        off = np.linalg.norm(scale * measured @ rotation.T + shift - actual, axis=1) / sigmas
        result = _similarity(measured, actual, sigmas * np.sqrt(1.0 + (off / 3.0) ** 2) ** 3)
    return result


def _similarity(measured: Array, actual: Array, sigmas: Array) -> tuple[float, Array, Array]:
    weights = sigmas**-2.0 / np.sum(sigmas**-2.0)
    middle, target = weights @ measured, weights @ actual
    a, b = measured - middle, actual - target
    left, sizes, right = np.linalg.svd((weights[:, None] * b).T @ a)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = left @ np.diag(signs) @ right
    scale = float((sizes * signs).sum() / (weights @ np.sum(a**2, axis=1)))
    return scale, rotation, target - scale * rotation @ middle
