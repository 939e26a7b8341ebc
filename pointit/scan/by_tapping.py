"""Corners of boxes, screens and tables from their image positions in views whose cameras are known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.scan.bundle import vec3
from pointit.scan.by_pointing import PointedAt
from pointit.scan.result import Scan, pointed_text

TAP_SIGMA = 0.004
"""Standard deviation of a tap, as a share of the image's width: a finger on a phone."""
MAX_SIGMA_M = 0.1
"""Sigma of a corner from which the two views are too near each other."""
RESIDUAL = 3.0
"""Rms error of a corner's taps, in those of one, from which they show different corners."""
STEPS = 3


@dataclass(frozen=True)
class Tap:
    """An image position in view `view`, counted from 0: `u`, `v` as in a `Sighting`."""

    view: int
    u: float
    v: float


def locate(scan: Scan, size: tuple[int, int], taps: Sequence[Tap]) -> PointedAt:
    """Return the point that all `taps`, two or more, show, in the frame of `scan`.

    Args:
        scan: the views' cameras.
        size: width and height of the images, image pixels.
        taps: image positions.

    Raises:
        RefusedError: If a tap's view has no place. One sentence.
    """
    # The ray of each tap, without the lens's distortion, in the frame of the scan
    width_px, height_px = size
    origins: list[Vec3] = []
    sights: list[Array] = []
    for tap in taps:
        is_view = 0 <= tap.view < len(scan.cameras)
        camera = scan.cameras[tap.view] if is_view else None
        if camera is None:
            raise RefusedError(f"the place of view {tap.view + 1} is not known: tap in another one")
        u = tap.u - width_px / 2.0
        v = tap.v - height_px / 2.0
        image = np.array([u, v]) / scan.focal_px
        flat: Array = image
        for _ in range(10):
            square = float(flat @ flat)
            flat = image / (1.0 + scan.distortion * square)
        sight: Array = camera.rotation.T @ np.append(flat, 1.0)
        origins.append(camera.position_m)
        sights.append(sight / np.linalg.norm(sight))

    # The point nearest to all rays
    starts: Array = np.array(origins)
    directions: Array = np.array(sights)
    outer_products = directions[:, :, None] * directions[:, None, :]
    across: Array = np.eye(3) - outer_products
    sigma_rad = TAP_SIGMA * width_px / scan.focal_px
    distances: Array = np.ones(len(taps))
    point: Array = np.zeros(3)
    covariance: Array = np.zeros((3, 3))
    for _ in range(STEPS):  # a far ray counts less
        sigmas_m = sigma_rad * distances[:, None, None]
        weighted = across / sigmas_m**2
        information = weighted.sum(axis=0) + 1e-9 * np.eye(3)
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        moment = np.einsum("nij,nj->i", weighted, starts)
        point = np.asarray(covariance @ moment, dtype=np.float64)
        squares = np.sum((point - starts) ** 2, axis=1)
        distances = np.maximum(np.sqrt(squares), 0.1)

    # Whether all rays run through it, in front of their cameras
    errors_m: Array = np.einsum("nij,nj->ni", across, point - starts)
    misses: Array = np.sqrt(np.sum(errors_m**2, axis=1)) / distances
    residual_rad = float(np.sqrt(np.mean(misses**2)))
    along_rays = np.sum((point - starts) * directions, axis=1)
    is_behind = bool(np.any(along_rays < 0))
    worst_variance = np.linalg.eigvalsh(covariance)[-1]
    sigma_m = float(np.sqrt(worst_variance))
    reason = ""
    if residual_rad > RESIDUAL * sigma_rad or is_behind:
        reason = "the taps do not show the same corner: tap it again in both views"
    elif sigma_m > MAX_SIGMA_M:
        reason = "the two views are too near each other: tap in views from farther apart"
    return PointedAt(vec3(point), sigma_m, len(taps), reason)


def tapped_text(things: Mapping[str, tuple[str, Sequence[PointedAt]]]) -> str:
    """Return sections `boxes` and `planes` of a map.

    Args:
        things: shape (box, screen or table) and corners, by name.

    Raises:
        RefusedError: If corners span no box, screen or table.
    """
    text = ""
    boxes: dict[str, Sequence[PointedAt]] = {}
    planes: dict[str, Sequence[PointedAt]] = {}
    for name, (shape, corners) in things.items():
        if shape == "box":
            boxes[name] = corners
        else:
            planes[name] = corners
    if boxes:
        text += pointed_text(boxes, "box")
    if planes:
        text += pointed_text(planes, "screen")
    return text
