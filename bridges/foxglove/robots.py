"""Entities of robots and of the way-points that people have set."""

from collections.abc import Mapping

import numpy as np
from foxglove.messages import CylinderPrimitive, LinePrimitive, TextPrimitive

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
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(len(_ANGLES))])
"""Points of the unit circle in the plane z = 0."""


def robot(
    name: str, state: RobotState, plan: RobotPlan | None, colors: Mapping[str, Rgb], now_ns: int
) -> NamedEntity:
    """Return the entity of a robot, in the colour of the person in `colors` who steers it."""
    rgb = FREE
    if state.user:
        rgb = colors.get(state.user, shapes.WHITE)
    at = state.position_m
    radius_m = state.radius_m

    # A ring around it: on the floor, or around a flying one, which has a line down to the floor
    floor: Vec3 = (at[0], at[1], 0.01)
    is_flying = state.kind == "quadrotor" and at[2] >= FLYING_M
    circle = _circle(at if is_flying else floor, 1.35 * radius_m)
    lines = [shapes.line(circle, rgb, kind="loop", pixels=3.0)]
    if is_flying:
        lines.append(shapes.line((at, floor), rgb, pixels=1.0))
        lines.append(_ring(floor, radius_m, rgb))

    # Its way and target
    if plan is not None and plan.line_m:
        places = (at, *plan.line_m)
        lines.append(shapes.line(places, rgb, pixels=3.0))
    if state.target_m is not None:
        lines.append(_ring(state.target_m, radius_m, rgb))

    # Where it heads, and what it does
    heading = vector.direction(state.yaw_rad, 0.0)
    front = vector.scale(heading, 1.5 * radius_m)
    arrow = shapes.arrow(at, front, rgb, width_m=0.1 * radius_m)
    phase = state.phase.replace("_", " ")
    action = f"{state.user} {phase}" if state.user else phase
    text = f"{name}\n{action}"
    above = shapes.above(at, ABOVE_M)
    label = shapes.label(text, above, rgb)
    steered_by = state.user or "nobody"
    facts = {"robot": name, "steered by": steered_by, "phase": state.phase}
    facts["reason"] = state.reason
    if state.battery is not None:
        facts["battery"] = f"{state.battery:.0%}"
    return shapes.entity(
        f"robot {name}",
        now_ns,
        lifetime_s=LIFETIME_S,
        facts=facts,
        cylinders=_body(state),
        arrows=[arrow],
        lines=lines,
        texts=[label],
    )


def waypoints(user: str, steering: Steering, rgb: Rgb, now_ns: int) -> NamedEntity:
    """Return the way-points that `user` has set and not yet sent, numbered."""
    points = steering.waypoints_m
    spheres = [shapes.sphere(point, WAYPOINT_M, rgb) for point in points]
    lines: list[LinePrimitive] = []
    if len(points) > 1:
        lines.append(shapes.line(points, rgb))
    labels: list[TextPrimitive] = []
    for number, point in enumerate(points, 1):
        above = shapes.above(point, 2.0 * WAYPOINT_M)
        labels.append(shapes.label(str(number), above, rgb))
    facts = {"user": user}
    return shapes.entity(
        f"way-points {user}", now_ns, facts=facts, spheres=spheres, lines=lines, texts=labels
    )


def _body(state: RobotState) -> list[CylinderPrimitive]:
    at = state.position_m
    radius_m = state.radius_m
    if state.kind == "ground":
        return [shapes.cylinder(at, radius_m, 2.0 * radius_m, BODY)]
    rotors: list[Vec3] = []
    for corner in np.radians([45.0, 135.0, 225.0, 315.0]).tolist():
        direction = vector.direction(state.yaw_rad + corner, 0.0)
        arm_m = vector.scale(direction, 0.7 * radius_m)
        rotors.append(vector.add(at, arm_m))

    # Two arms cross, with a disc at each end
    parts: list[CylinderPrimitive] = []
    for start, end in zip(rotors[:2], rotors[2:], strict=True):
        arm = shapes.cylinder_between(start, end, 0.12 * radius_m, BODY)
        parts.append(arm)
    height_m = 0.1 * radius_m
    diameter_m = 0.7 * radius_m
    for rotor in rotors:
        disc = shapes.cylinder(rotor, height_m, diameter_m, BODY, alpha=0.8)
        parts.append(disc)
    return parts


def _circle(center_m: Vec3, radius_m: float) -> list[list[float]]:
    circle_m = _CIRCLE * radius_m + np.array(center_m)
    places: list[list[float]] = circle_m.tolist()
    return places


def _ring(center_m: Vec3, radius_m: float, rgb: Rgb) -> LinePrimitive:
    return shapes.line(_circle(center_m, radius_m), rgb, kind="loop", alpha=0.6)
