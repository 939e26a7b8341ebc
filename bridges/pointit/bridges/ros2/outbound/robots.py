"""Markers of robots that people steer: where they are, who steers them, where they go, way-points."""

from collections.abc import Iterator
from typing import Any

from pointit.bridges.ros2.outbound.drawing import MarkerBuilder
from pointit.bridges.ros2.routing.scene import Scene
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import RobotState
from pointit.schemas.base import Rgb
from pointit.schemas.environment import OTHER_COLOR

HALTED: Rgb = (230, 60, 50)
"""Colour of a robot that a stop condition holds, or that is lost."""
HIGH_M = {"quadrotor": 0.08, "ground": 0.25}
"""Drawn height of a robot by its kind."""
FRONT_M: Vec3 = (0.02, 0.05, 0.06)
"""Width of the shaft and head of the arrow to its front, length of the head."""
PLAN_M, SPOT_M, LABEL_M = 0.03, 0.1, 0.3
SIGMAS = 2.0
"""Size of the circle of uncertainty, in standard deviations."""


def robots(pen: MarkerBuilder, scene: Scene) -> Iterator[Any]:
    """Yield the markers of all robots, and of the way-points that people have set."""
    for name, state in sorted(scene.robots.items()):
        yield from _robot(pen, scene, name, state)
    for user, person in sorted(scene.people.items()):
        waypoints_m = () if person.steering is None else person.steering.waypoints_m
        size_m = (SPOT_M, SPOT_M, SPOT_M)
        for number, place_m in enumerate(waypoints_m):
            rgb = person.profile.cursor_color
            yield pen.shape("sphere", f"{user}/waypoints", number, size_m=size_m, rgb=rgb, at_m=place_m)


def _robot(pen: MarkerBuilder, scene: Scene, name: str, state: RobotState) -> Iterator[Any]:
    owner = scene.people.get(state.user)
    rgb = OTHER_COLOR if owner is None else owner.profile.cursor_color
    is_halted = state.phase in {"stopped", "lost"}
    group, at_m, wide_m = f"robot {name}", state.position_m, 2.0 * state.radius_m
    size_m = (wide_m, wide_m, HIGH_M[state.kind])
    body = HALTED if is_halted else rgb
    yield pen.shape("cylinder", group, 0, size_m=size_m, rgb=body, at_m=at_m)
    ahead = vector.scale(vector.direction(state.yaw_rad, 0.0), max(1.5 * state.radius_m, 0.1))
    ends_m = (at_m, vector.add(at_m, ahead))
    yield pen.shape("arrow", f"{group}/front", 0, size_m=FRONT_M, rgb=body, places_m=ends_m)
    words = f"{name}: {state.phase}" + (f", {state.user}" if state.user else "")
    yield pen.label(words, f"{group}/name", 0, vector.add(at_m, (0.0, 0.0, LABEL_M)))
    if state.position_sigma_m:
        spread_m = 2.0 * SIGMAS * state.position_sigma_m
        yield pen.shape(
            *("cylinder", f"{group}/place", 0),
            size_m=(spread_m, spread_m, 0.01),
            rgb=rgb,
            at_m=at_m,
            turned=rotation.IDENTITY,
            alpha=0.3,
        )
    plan = scene.plan(name)
    if plan is not None and plan.line_m:
        line_m = (at_m, *plan.line_m)
        yield pen.shape("line", f"{group}/plan", 0, size_m=(PLAN_M, 0.0, 0.0), rgb=rgb, places_m=line_m)
    if state.target_m is not None:
        spot_m = (SPOT_M, SPOT_M, SPOT_M)
        yield pen.shape(
            "sphere", f"{group}/target", 0, size_m=spot_m, rgb=rgb, at_m=state.target_m, alpha=0.6
        )
