"""Evaluated flights: from spot to spot with a landing, as recorded, and to places on 3-D workspaces."""

import math
import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.pui.workspace import WorkspaceKind

Bench = Literal["landing", "workspace"]
BENCHES: tuple[Bench, ...] = ("landing", "workspace")

SPOT_M = 1.8
"""Coordinates of the four spots of `hri_landing` about the person: (±1.8, ±1.8)."""
HEIGHT_M = 0.57
"""Height at which the quadrotor hovers there (median of the recordings)."""

EYES_M = 1.64
"""Height of the eyes of average people."""
RANGE_M = 2.0
"""Radius of the cylinder and of the sphere."""
PLANE_M = 0.9
"""Height of the horizontal workspace."""
ABOVE_M = 0.2
"""Height of the robot above the point on a horizontal workspace."""
FAR_M = (1.0, 2.0)
"""Range of distances of places above the horizontal workspace."""
UP_RAD = math.radians(25.0)
"""Largest elevation of places on the sphere, up and down."""
TALL_M = (0.6, 2.2)
"""Range of heights of places on the cylinder."""
AROUND_RAD = (math.radians(30.0), math.radians(90.0))
"""Range of azimuths from one place to the next."""


@dataclass(frozen=True, kw_only=True)
class FlightCondition:
    """Parameters of one condition."""

    bench: Bench
    name: str
    position_sigma_m: float = 0.15
    """Error of the pose by which the person's rays are placed, drawn per axis and stated; the default is that
    of a localization within 5 s (pointing.md §4)."""
    yaw_sigma_deg: float = 4.0
    workspace: WorkspaceKind | None = None
    """Kind of the workspace. None: the floor."""
    keeps_away: bool = False
    """True if the robot keeps the default distance from people, and is slow towards them."""

    @property
    def hover_m(self) -> float:
        """Return the height of the robot above the cursor."""
        if self.workspace is None:
            return HEIGHT_M
        return ABOVE_M if self.workspace == "horizontal" else 0.0


@dataclass(frozen=True, kw_only=True)
class Flight:
    """One flight of a person."""

    condition: FlightCondition
    seed: int
    start_m: Vec3
    """Position of the hovering robot."""
    spot_m: Vec3
    """Spot on the floor to land on, or place in the air for the robot."""
    pose_off: Vec3
    """Errors of the pose by which the person's rays are placed: x, y, m; yaw, rad."""

    @property
    def entropy(self) -> tuple[int, int]:
        """Return the seed of everything random."""
        return (self.seed, zlib.crc32(f"{self.condition.bench}/{self.condition.name}".encode()))


CONDITIONS: tuple[FlightCondition, ...] = (
    FlightCondition(bench="landing", name="exact pose", position_sigma_m=0.0, yaw_sigma_deg=0.0),
    FlightCondition(bench="landing", name="pose off by 0.15 m, 4°"),
    FlightCondition(bench="landing", name="pose off, 1 m from people", keeps_away=True),
    FlightCondition(bench="workspace", name="horizontal", workspace="horizontal"),
    FlightCondition(bench="workspace", name="cylinder", workspace="cylinder"),
    FlightCondition(bench="workspace", name="sphere", workspace="sphere"),
)
"""Evaluated conditions. Flights of a seed are the same in all conditions of landing."""


def flight_of(condition: FlightCondition, seed: int) -> Flight:
    """Return the flight of the person `seed`, who stands at the origin; the same for all landings.

    Places in the air are on the workspace, which is about the person's pose, not about their true place.
    """
    rng = np.random.default_rng([seed, zlib.crc32(str(condition.workspace).encode())])
    sigmas = (condition.position_sigma_m, condition.position_sigma_m, math.radians(condition.yaw_sigma_deg))
    x_m, y_m, yaw_rad = (rng.standard_normal(3) * sigmas).tolist()
    if condition.workspace is None:
        first, second = rng.permutation(4)[:2].tolist()
        start_m, spot_m = vector.add(_corner(first), (0.0, 0.0, HEIGHT_M)), _corner(second)
    else:
        azimuth = float(rng.uniform(-math.pi, math.pi))
        turn = float(rng.uniform(*AROUND_RAD)) * float(rng.choice([-1.0, 1.0]))
        start_m, spot_m = (
            vector.add((x_m, y_m, 0.0), _place(condition.workspace, at, float(rng.uniform())))
            for at in (azimuth, azimuth + turn)
        )
    return Flight(
        condition=condition, seed=seed, start_m=start_m, spot_m=spot_m, pose_off=(x_m, y_m, yaw_rad)
    )


def _corner(number: int) -> Vec3:
    return (SPOT_M * (1 if number & 1 else -1), SPOT_M * (1 if number & 2 else -1), 0.0)


def _place(kind: WorkspaceKind, azimuth_rad: float, share: float) -> Vec3:
    """Return a place of the robot on a workspace about the origin; `share` of the free range, 0 to 1."""
    ahead = vector.direction(azimuth_rad, 0.0)
    if kind == "horizontal":
        x, y, _ = vector.scale(ahead, FAR_M[0] + share * (FAR_M[1] - FAR_M[0]))
        return (x, y, PLANE_M + ABOVE_M)
    if kind == "cylinder":
        x, y, _ = vector.scale(ahead, RANGE_M)
        return (x, y, TALL_M[0] + share * (TALL_M[1] - TALL_M[0]))
    away = vector.scale(vector.direction(azimuth_rad, UP_RAD * (2.0 * share - 1.0)), RANGE_M)
    return vector.add((0.0, 0.0, EYES_M), away)
