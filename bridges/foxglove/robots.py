"""Entities of robots and of the way-points that people have set."""

from collections.abc import Mapping

import numpy as np
from foxglove.messages import CylinderPrimitive, LinePrimitive

from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.people import LIFETIME_S
from pointit.bridges.foxglove.shapes import NamedEntity
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import RobotPlan, RobotState, Steering
from pointit.schemas.base import Rgb

FREE: Rgb = (150, 160, 172)
"""Colour of a robot that nobody steers, as in the page (`scene/robots.ts`)."""
BODY: Rgb = (215, 220, 228)
FLYING_M = 0.05
"""Height from which a quadrotor has a line down to the floor."""
ABOVE_M = 0.3
"""Height of a label above its robot."""
WAYPOINT_M = 0.1
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)


def robot(
    name: str, state: RobotState, plan: RobotPlan | None, colors: Mapping[str, Rgb], now_ns: int
) -> NamedEntity:
    """Return the entity of a robot, in the colour of the person in `colors` who steers it."""
    rgb = colors.get(state.user, shapes.WHITE) if state.user else FREE
    at = state.position_m
    radius_m = state.radius_m
    floor: Vec3 = (at[0], at[1], 0.01)
    is_flying = state.kind == "quadrotor" and at[2] >= FLYING_M
    lines = [shapes.line(_circle(at if is_flying else floor, 1.35 * radius_m), rgb, kind="loop", pixels=3.0)]
    if is_flying:
        lines += [shapes.line((at, floor), rgb, pixels=1.0), _ring(floor, radius_m, rgb)]
    if plan is not None and plan.line_m:
        lines.append(shapes.line((at, *plan.line_m), rgb, pixels=3.0))
    if state.target_m is not None:
        lines.append(_ring(state.target_m, radius_m, rgb))
    front = vector.scale(vector.direction(state.yaw_rad, 0.0), 1.5 * radius_m)
    words = [name, " ".join(filter(None, (state.user, state.phase.replace("_", " "))))]
    facts = {"robot": name, "steered by": state.user or "nobody", "phase": state.phase}
    facts["reason"] = state.reason
    if state.battery is not None:
        facts["battery"] = f"{state.battery:.0%}"
    return shapes.entity(
        f"robot {name}",
        now_ns,
        lifetime_s=LIFETIME_S,
        facts=facts,
        cylinders=_body(state),
        arrows=[shapes.arrow(at, front, rgb, width_m=0.1 * radius_m)],
        lines=lines,
        texts=[shapes.label("\n".join(words), vector.add(at, (0.0, 0.0, ABOVE_M)), rgb)],
    )


def waypoints(user: str, steering: Steering, rgb: Rgb, now_ns: int) -> NamedEntity:
    """Return the way-points that `user` has set and not yet sent, numbered."""
    points = steering.waypoints_m
    return shapes.entity(
        f"way-points {user}",
        now_ns,
        facts={"user": user},
        spheres=[shapes.sphere(point, WAYPOINT_M, rgb) for point in points],
        lines=[shapes.line(points, rgb)] if len(points) > 1 else [],
        texts=[
            shapes.label(str(number), vector.add(point, (0.0, 0.0, 2.0 * WAYPOINT_M)), rgb)
            for number, point in enumerate(points, 1)
        ],
    )


def _body(state: RobotState) -> list[CylinderPrimitive]:
    at = state.position_m
    radius_m = state.radius_m
    if state.kind == "ground":
        return [shapes.cylinder(at, radius_m, 2.0 * radius_m, BODY)]
    rotors = [
        vector.add(at, vector.scale(vector.direction(state.yaw_rad + corner, 0.0), 0.7 * radius_m))
        for corner in np.radians([45.0, 135.0, 225.0, 315.0]).tolist()
    ]
    arms = [shapes.cylinder_between(rotors[i], rotors[i + 2], 0.12 * radius_m, BODY) for i in (0, 1)]
    disc_m = (0.1 * radius_m, 0.7 * radius_m)
    return arms + [shapes.cylinder(rotor, *disc_m, BODY, alpha=0.8) for rotor in rotors]


def _circle(center_m: Vec3, radius_m: float) -> list[list[float]]:
    around = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE), np.zeros(len(_CIRCLE))])
    places: list[list[float]] = (around * radius_m + np.array(center_m)).tolist()
    return places


def _ring(center_m: Vec3, radius_m: float, rgb: Rgb) -> LinePrimitive:
    return shapes.line(_circle(center_m, radius_m), rgb, kind="loop", alpha=0.6)
