"""Poses of views by the strips they share: rigid motions between sets of points (Kabsch), by consensus."""

from itertools import combinations

import numpy as np

from pointit.scan.bundle import DOWN, Array

MAX_PAIRS = 300
COARSE = 0.05
"""Tolerance of a first pose, as a share of the image's width: depth from one photograph is coarse."""
DISTINCT_M = 0.15
"""Distance of poses that differ."""
MAX_POSES = 3
GRAVITY_ARM_M = 0.5
"""Gravity counts as a point at this distance."""


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
    count = len(room)
    sets: list[tuple[int, int]] = list(combinations(range(count), 2))
    if down is not None:
        sets += [(each, each) for each in range(count)]
    if not sets:
        return []
    sets = sets[:: -(-len(sets) // MAX_PAIRS)]
    members = np.zeros((len(sets), count))
    for row, pair in enumerate(sets):
        members[row, list(pair)] = 1.0
    rotations, translations = _rigid_motions(room, camera, members, down)
    points = np.einsum("hij,nkj->hnki", rotations, room) + translations[:, None, None]
    depth = points[..., 2:]
    error = np.linalg.norm(points[..., :2] / np.maximum(depth, 0.05) - images, axis=3).mean(axis=2)
    error = np.where(np.min(depth[..., 0], axis=2) > 0.05, error, np.inf)
    costs = np.minimum(error / tolerance, 1.0).sum(axis=1)
    found: list[int] = []
    places = -np.einsum("hji,hj->hi", rotations, translations)
    for index in np.argsort(costs):
        is_new = all(np.linalg.norm(places[index] - places[other]) > DISTINCT_M for other in found)
        if costs[index] < count and is_new:
            found.append(int(index))
    return [(rotations[index], translations[index]) for index in found[:MAX_POSES]]


def _rigid_motions(room: Array, camera: Array, members: Array, down: Array | None) -> tuple[Array, Array]:
    """Return the rotations and translations from the lines that are `members` (h x n) of each hypothesis."""
    near = 1.0 / np.linalg.norm(camera[:, 1], axis=1) ** 2  # depth errs by the square of the distance
    weights = members * near
    weights /= weights.sum(axis=1, keepdims=True)
    room_mean = np.einsum("hn,nki->hi", weights, room) / 3.0
    camera_mean = np.einsum("hn,nki->hi", weights, camera) / 3.0
    # sum of w (c - c0)(r - r0)' without the h x n x 3 x 3 x 3 array of differences
    products = np.einsum("nki,nkj->nij", camera, room)
    matrix = np.einsum("hn,nij->hij", weights, products) / 3.0 - camera_mean[:, :, None] * room_mean[:, None]
    if down is not None:
        matrix = matrix + GRAVITY_ARM_M**2 * np.outer(down, DOWN)
    left, _, right = np.linalg.svd(matrix)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    rotations = left @ right
    return rotations, camera_mean - np.einsum("hij,hj->hi", rotations, room_mean)


def levelled(directions: Array, lengths: Array, up: Array) -> Array:
    """Return the rotation into a level room in which most strips are level or upright.

    Args:
        directions: unit directions of straight pieces, n x 3.
        lengths: their lengths, m, n.
        up: rough direction of up, from the way in which the cameras were held, unit.
    """
    candidates = [up, *directions, *(np.cross(a, b) for a, b in combinations(directions, 2))]
    vectors = np.array([c / np.linalg.norm(c) for c in candidates if np.linalg.norm(c) > 0.1])
    vectors *= np.where(vectors @ up < 0, -1.0, 1.0)[:, None]
    vectors = vectors[vectors @ up > np.cos(np.radians(50.0))]
    rise = np.abs(np.einsum("ci,ni->cn", vectors, directions))
    angle = np.minimum(np.arcsin(np.clip(rise, 0, 1)), np.arccos(np.clip(rise, 0, 1)))
    scores = (lengths / (1.0 + (angle / np.radians(2.0)) ** 2)).sum(axis=1) + 1e-3 * (vectors @ up)
    return upright(vectors[int(np.argmax(scores))])


def upright(up: Array) -> Array:
    """Return the rotation with the least turn that moves the unit vector `up` to +z."""
    axis, cosine = np.cross(up, [0.0, 0.0, 1.0]), float(up[2])
    if cosine < -0.999999:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z = axis
    matrix = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + matrix + matrix @ matrix / (1.0 + cosine))
