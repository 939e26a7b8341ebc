"""The next best view: from where a further photograph helps the strip that is known worst."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.scan.bundle import Array
from pointit.scan.result import COMPLETE_M, Scan, ScannedLamp, ScannedStrip

STEP_M = 1.0
"""Distance of a step aside."""
NEARER = 0.6
"""Share of the distance to a strip that remains after going nearer."""
CLOSEST_M = 0.8


@dataclass(frozen=True)
class Advice:
    """A sentence for a person, the strips and lamps that it is about, and where to stand if that is known.

    Attributes:
        position_m, look_at_m: of the camera, and what it is pointed at, in the scan's frame.
    """

    text: str
    names: tuple[str, ...]
    position_m: Vec3 | None = None
    look_at_m: Vec3 | None = None


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
    points = np.array(worst.line_m if isinstance(worst, ScannedStrip) else (worst.position_m,))
    blocks = [worst.covariance[row : row + 3, row : row + 3] for row in range(0, 3 * len(points), 3)]
    sizes, axes = np.linalg.eigh(np.array(blocks))
    vertex = int(np.argmax(sizes[:, 2]))

    def change(candidate: tuple[str, Array]) -> float:
        """Return how much the image changes if the vertex moves along its least certain direction."""
        sight = points[vertex] - candidate[1]
        return float(np.linalg.norm(np.cross(sight, axes[vertex, :, 2])) / (sight @ sight))

    where, position = max(_candidates(scan, points.mean(axis=0)), key=change)
    reason = worst.reason or f"its ends are known to {100 * worst.sigma_m:.1f} cm"
    text = f"{worst.name}: {reason}. Photograph it {where}, with two other strips in the picture"
    return Advice(text, names, _vec3(position), _vec3(points.mean(axis=0)))


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


def _vec3(values: Array) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
