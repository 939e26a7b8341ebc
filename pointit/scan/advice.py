"""The next best view of a scan: where to take a further photograph, and of what."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.scan.bundle import vec3, vertex_blocks
from pointit.scan.result import COMPLETE_M, Scan, ScannedLamp, ScannedStrip

STEP_M = 1.0
"""Distance of a step aside."""
NEARER = 0.6
"""Share of the distance to a strip that remains after going nearer."""
CLOSEST_M = 0.8
CONE = np.cos(np.radians(28.0))
"""Cosine of the angle from the middle of an image within which a photograph surely shows a thing."""
TIES = 3
"""Number of known strips in a photograph that place it."""
AIMS = 8
"""Number of the worst strips that are looked at by turns."""


@dataclass(frozen=True)
class Advice:
    """A sentence for a user, its strips and lamps, and the camera position if known.

    Attributes:
        position_m, look_at_m: positions of the camera and of its target, in the scan's frame.
    """

    text: str
    names: tuple[str, ...]
    position_m: Vec3 | None = None
    look_at_m: Vec3 | None = None


def next_view(scan: Scan, limit_m: float = COMPLETE_M) -> Advice | None:
    """Return from where to take a further photograph, or None if the scan is complete."""
    if scan.missing:
        listed = ", ".join(scan.missing[:3])
        text = f"photograph {listed} from two positions, each time together with two strips that are known"
        return Advice(text, scan.missing)

    # Lights that are not good enough, the worst first
    scanned = sorted(scan.lights, key=lambda light: -light.sigma_m)
    open_lights = [not light.identified or light.sigma_m > limit_m for light in scanned]
    is_open = np.array(open_lights, dtype=bool)
    if not is_open.any():
        return None
    open_indices: list[int] = np.flatnonzero(is_open).tolist()
    names = [scanned[index].name for index in open_indices]

    # What a photograph shows: the ends of all lights, and the direction in which each is known worst.
    ends = np.array([_ends(light) for light in scanned])
    axes = np.array([_least_certain(light) for light in scanned])
    is_known = np.array([light.views > 1 for light in scanned], dtype=bool)

    def worth(candidate: tuple[str, Array, int]) -> float:
        """Return the value of a photograph: known strips that place it, and open ones from aside."""
        _, position, aim = candidate
        sights = ends - position
        distances = np.linalg.norm(sights, axis=2, keepdims=True)
        sights /= np.maximum(distances, 1e-9)

        # A light is shown if both its ends are near the middle of the picture.
        ahead = sights[aim].sum(axis=0)
        is_near = sights @ ahead > CONE * np.linalg.norm(ahead)
        is_shown = np.all(is_near, axis=1)
        ties = min(float((is_shown & is_known).sum()), TIES)

        # Seen at right angles to that direction, it becomes most certain.
        across = np.cross(sights.mean(axis=1), axes)
        aside = np.linalg.norm(across, axis=1)
        return 10.0 * ties + float(aside[is_shown & is_open].sum())

    candidates = _candidates(scan, ends, open_indices[:AIMS])
    best = max(candidates, key=worth, default=None)
    if best is None:
        return Advice(f"photograph {names[0]} once more, from another position", tuple(names))
    where, position, aim = best
    light = scanned[aim]
    reason = light.reason or f"its ends are known to {100 * light.sigma_m:.1f} cm"
    text = f"{light.name}: {reason}. Photograph it {where}, with two other strips in the picture"
    names.remove(light.name)
    middle = ends[aim].mean(axis=0)
    return Advice(text, (light.name, *names), vec3(position), look_at_m=vec3(middle))


def _ends(scanned: ScannedStrip | ScannedLamp) -> Array:
    """Return the first and last point, 2 x 3, m. Those of a lamp are the same."""
    points = scanned.line_m if isinstance(scanned, ScannedStrip) else (scanned.position_m,)
    return np.array([points[0], points[-1]], dtype=np.float64)


def _least_certain(scanned: ScannedStrip | ScannedLamp) -> Array:
    """Return the direction in which a strip or lamp is known worst."""
    blocks = vertex_blocks(scanned.covariance)
    _, axes = np.linalg.eigh(np.sum(blocks, axis=0))
    return np.asarray(axes[:, -1])


def _candidates(scan: Scan, ends: Array, aims: Sequence[int]) -> Iterator[tuple[str, Array, int]]:
    """Yield positions one step beside a camera or nearer, with their descriptions and targets."""
    # The extent of the room, as far as it is known
    cameras_m = [camera.position_m for camera in scan.cameras if camera is not None]
    around = np.concatenate([ends.reshape(-1, 3), cameras_m])
    low = around.min(axis=0)
    high = around.max(axis=0)

    for number, camera in enumerate(scan.cameras, 1):
        if camera is None:
            continue
        camera_m = np.array(camera.position_m)
        for aim in aims:
            sight = ends[aim].mean(axis=0) - camera_m
            distance_m = float(np.linalg.norm(sight))
            right = np.cross(sight, [0.0, 0.0, 1.0])
            right *= STEP_M / max(float(np.linalg.norm(right)), 1e-9)
            positions = {
                f"from {STEP_M:g} m to the right of photograph {number}": camera_m + right,
                f"from {STEP_M:g} m to the left of photograph {number}": camera_m - right,
            }
            if NEARER * distance_m > CLOSEST_M:
                nearer_m = camera_m + (1.0 - NEARER) * sight
                positions[f"from nearer than photograph {number}"] = nearer_m
            for description, position in positions.items():
                is_inside = (position > low) & (position < high)
                if np.all(is_inside):
                    yield description, position, aim
