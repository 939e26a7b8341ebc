"""The next best view: from where a further photograph helps the strip that is known worst."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.scan.bundle import Array
from pointit.scan.result import COMPLETE_M, Camera, Scan, ScannedLamp, ScannedStrip

STEP_M = 1.0
"""Distance of a step aside."""
NEARER = 0.6
"""Share of the distance to a strip that remains after going nearer."""
CLOSEST_M = 0.8
MARKS = 8
"""Number of pixels that a photograph is expected to show of a strip."""


@dataclass(frozen=True)
class Advice:
    """A sentence for a person, the strips and lamps that it is about, and where to stand if that is known.

    Attributes:
        position_m, look_at_m: of the camera, and what it is pointed at, in the scan's frame.
        expected_sigma_m: sigma of the strip with that view.
    """

    text: str
    names: tuple[str, ...]
    position_m: Vec3 | None = None
    look_at_m: Vec3 | None = None
    expected_sigma_m: float | None = None


def next_view(scan: Scan, limit_m: float = COMPLETE_M) -> Advice | None:
    """Return from where to take a further photograph, or None if the scan is complete."""
    if scan.missing:
        listed = ", ".join(scan.missing[:3])
        return Advice(
            f"photograph {listed} from two positions, each time together with two strips that are known",
            scan.missing,
        )
    found: list[ScannedStrip | ScannedLamp] = [*scan.strips.values(), *scan.lamps.values()]
    open_ones = sorted(
        (each for each in found if not each.identified or each.sigma_m > limit_m),
        key=lambda each: -each.sigma_m,
    )
    if not open_ones:
        return None
    worst = open_ones[0]
    names = tuple(each.name for each in open_ones)
    points = _points(worst)
    middle = points.mean(axis=0)
    best: tuple[float, str, Array] | None = None
    for text, position in _candidates(scan, middle):
        sigma_m = _expected_sigma_m(scan, worst, points, position)
        if best is None or sigma_m < best[0]:
            best = (sigma_m, text, position)
    if best is None:
        return Advice(f"photograph {worst.name} once more, from another position", names)
    sigma_m, where, position = best
    reason = worst.reason or f"its ends are known to {100 * worst.sigma_m:.1f} cm"
    text = f"{worst.name}: {reason}. Photograph it {where}, with two other strips in the picture"
    return Advice(text, names, _vec3(position), _vec3(middle), sigma_m)


def _points(found: ScannedStrip | ScannedLamp) -> Array:
    points = found.line_m if isinstance(found, ScannedStrip) else (found.position_m,)
    return np.array(points, dtype=np.float64)


def _candidates(scan: Scan, middle: Array) -> Iterator[tuple[str, Array]]:
    """Yield positions a step aside of a camera, or nearer, each with its words."""
    for number, camera in enumerate(scan.cameras, 1):
        if camera is None:
            continue
        at = np.array(camera.position_m)
        sight = middle - at
        right = np.cross(sight, [0.0, 0.0, 1.0])
        right /= max(float(np.linalg.norm(right)), 1e-9)
        yield f"from {STEP_M:g} m to the right of photograph {number}", at + STEP_M * right
        yield f"from {STEP_M:g} m to the left of photograph {number}", at - STEP_M * right
        if NEARER * float(np.linalg.norm(sight)) > CLOSEST_M:
            yield f"from nearer than photograph {number}", at + (1.0 - NEARER) * sight


def _expected_sigma_m(scan: Scan, found: ScannedStrip | ScannedLamp, points: Array, position: Array) -> float:
    """Return the largest sigma of the vertices with a further view from `position`."""
    covariance = found.covariance + 1e-8 * np.eye(len(found.covariance))
    sight = points.mean(axis=0) - position
    forward = sight / max(float(np.linalg.norm(sight)), 1e-9)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= max(float(np.linalg.norm(right)), 1e-9)
    camera = Camera(np.array([right, np.cross(forward, right), forward]), np.zeros(3))
    information = np.linalg.inv(covariance)
    for row, point in enumerate(points):
        x, y, z = camera.rotation @ (point - position)
        z = max(float(z), 0.2)
        jacobian = scan.focal_px / z * np.array([[1.0, 0.0, -x / z], [0.0, 1.0, -y / z]]) @ camera.rotation
        jacobian *= np.sqrt(MARKS / len(points)) / scan.noise_px
        part = slice(3 * row, 3 * row + 3)
        information[part, part] += jacobian.T @ jacobian
    after = np.linalg.inv(information)
    return float(
        np.sqrt(max(np.linalg.eigvalsh(after[r : r + 3, r : r + 3])[-1] for r in range(0, len(after), 3)))
    )


def _vec3(values: Array) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
