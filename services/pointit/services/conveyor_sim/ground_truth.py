"""Packages as reported by a perfect tracker."""

from collections.abc import Callable

import numpy as np

from pointit.schemas import FARTHEST, TrackedObject
from pointit.services.conveyor_sim.traffic.package import Package
from pointit.services.conveyor_sim.traffic.traffic import Traffic


def ground_truth_objects(traffic: Traffic, until_ns: Callable[[Package], int | None]) -> list[TrackedObject]:
    """Return every package of `traffic`, belt by belt, with exact positions and speeds.

    `until_ns` returns the time until which the bay of a package can be changed, None without limit.
    """
    objects: list[TrackedObject] = []
    for parts in traffic.network.parts:
        held = [package for part in parts for package in traffic.held[part.index]]
        if not held:
            continue
        piece = parts[0]  # lines and positions are those of the whole section
        line = piece.line
        along_m = np.array([piece.start_m + package.offset_m for package in held])
        segments = np.clip(
            np.searchsorted(line.starts_m, along_m, side="right") - 1, 0, len(line.tangents) - 1
        )
        speeds_mps = np.array([package.speed_mps for package in held])
        velocities = (line.tangents[segments] * speeds_mps[:, None]).tolist()
        points = np.clip(line.points_at(along_m), -FARTHEST, FARTHEST).tolist()  # against rounding
        for package, point, velocity in zip(held, points, velocities, strict=True):
            belt, position_m = piece.place(package.offset_m)
            objects.append(
                TrackedObject(
                    id=package.id,
                    kind=package.kind,
                    position_m=(point[0], point[1], point[2]),
                    velocity_mps=(velocity[0], velocity[1], velocity[2]),
                    length_m=package.length_m,
                    surface=traffic.network.surface if belt else "none",
                    surface_id=belt,
                    surface_position_m=position_m,
                    surface_speed_mps=package.speed_mps,
                    bay=package.bay,
                    bay_until_ns=until_ns(package),
                )
            )
    return objects
