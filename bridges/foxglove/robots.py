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
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)


def robot(
    name: str, state: RobotState, plan: RobotPlan | None, colors: Mapping[str, Rgb], now_ns: int
) -> NamedEntity:
    """Return the entity of a robot, in the colour of the person in `colors` who steers it."""
    rgb = colors.get(state.user, shapes.WHITE) if state.user else FREE
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
    words = f"{name}\n{state.user} {phase}" if state.user else f"{name}\n{phase}"
    label = shapes.label(words, vector.add(at, (0.0, 0.0, ABOVE_M)), rgb)
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
        arrows=[arrow],
        lines=lines,
        texts=[label],
    )


def waypoints(user: str, steering: Steering, rgb: Rgb, now_ns: int) -> NamedEntity:
    """Return the way-points that `user` has set and not yet sent, numbered."""
    points = steering.waypoints_m
    spheres = [shapes.sphere(point, WAYPOINT_M, rgb) for point in points]
    lines = [shapes.line(points, rgb)] if len(points) > 1 else []
    labels: list[TextPrimitive] = []
    for number, point in enumerate(points, 1):
        above = vector.add(point, (0.0, 0.0, 2.0 * WAYPOINT_M))
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
        rotors.append(vector.add(at, vector.scale(direction, 0.7 * radius_m)))

    # Two arms cross, with a disc at each end
    parts: list[CylinderPrimitive] = []
    for start, end in ((rotors[0], rotors[2]), (rotors[1], rotors[3])):
        parts.append(shapes.cylinder_between(start, end, 0.12 * radius_m, BODY))
    for rotor in rotors:
        parts.append(shapes.cylinder(rotor, 0.1 * radius_m, 0.7 * radius_m, BODY, alpha=0.8))
    return parts


def _circle(center_m: Vec3, radius_m: float) -> list[list[float]]:
    level = np.zeros(len(_CIRCLE))
    around = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE), level])
    offset_m = np.array(center_m)
    places: list[list[float]] = (around * radius_m + offset_m).tolist()
    return places


def _ring(center_m: Vec3, radius_m: float, rgb: Rgb) -> LinePrimitive:
    return shapes.line(_circle(center_m, radius_m), rgb, kind="loop", alpha=0.6)
