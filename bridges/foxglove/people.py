"""Entities of people: body, ray, cursor and goal, and the uncertainty of the position."""

from dataclasses import dataclass

import numpy as np
from foxglove.messages import CylinderPrimitive, FrameTransform, LinePrimitive, Quaternion

from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.shapes import NamedEntity, Places
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.plugins import rotation
from pointit.schemas import Cursor, Goal, UserPose, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.topics import POSE
from pointit.sim.aim import Stance

LIFETIME_S = 2.0
"""Lifetime of an entity, s, for viewers that missed its deletion."""
NO_PROFILE = UserProfile(stamp_ns=0)
"""Profile of a person who has not published one."""

SIGMAS = 2.0
"""Size of the position's ellipse, in standard deviations."""
SMALLEST_M = 5e-3
"""An ellipse with a shorter major half-axis is not drawn: the position is known."""
FREE_RAY_M = 4.0
"""Drawn length of a ray that meets nothing, as in the page (`appearance.ts`)."""
CURSOR_M = 0.08
GOAL_M = 0.5
"""Length of the arrow at a goal."""
GOAL_ABOVE_M = 0.03
"""Height of the arrow above the floor, to be visible."""
TORSO_M = 0.34
HEAD_M = 0.22
ARM_M = 0.07
RAY_M = 0.012
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Points of the unit circle."""


@dataclass(slots=True)
class DrawnPerson:
    """Last messages of one person."""

    profile: UserProfile = NO_PROFILE
    pose: UserPose | None = None
    cursor: Cursor | None = None
    goal: Goal | None = None
    """Last goal that the person sent a robot to."""

    @property
    def color(self) -> Rgb:
        """Return the person's colour."""
        return self.profile.cursor_color


def frame_of(user: str) -> str:
    """Return the name of the person's frame {H}, beside the key of their pose."""
    return POSE.at(user).rpartition("/")[0] + "/feet"


def transform(user: str, pose: UserPose, now_ns: int) -> FrameTransform:
    """Return {H} of `user` in {W}."""
    x, y, z, w = rotation.from_yaw(pose.yaw_rad)
    orientation = Quaternion(x=x, y=y, z=z, w=w)
    return FrameTransform(
        timestamp=shapes.timestamp(now_ns),
        parent_frame_id=shapes.WORLD,
        child_frame_id=frame_of(user),
        translation=shapes.size(*pose.position_m),
        rotation=orientation,
    )


def ellipse(pose: UserPose) -> Places | None:
    """Return the points of the `SIGMAS` ellipse around the position, or None if it is too small to see."""
    covariance = np.array(pose.covariance).reshape(3, 3)
    horizontal = covariance[:2, :2]
    symmetric = (horizontal + horizontal.T) / 2.0
    variances, axes = np.linalg.eigh(symmetric)
    half_axes_m = SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    if half_axes_m[1] < SMALLEST_M:
        return None
    around = _CIRCLE * half_axes_m @ axes.T
    above_floor = np.full(len(around), 0.01)
    offsets = np.column_stack([around, above_floor])
    rim: Places = offsets + np.array(pose.position_m)
    return rim


def entities(user: str, person: DrawnPerson, now_ns: int) -> list[NamedEntity]:
    """Return the body of `user` if the position is known, ray and cursor while pointing, and the goal."""
    entities: list[NamedEntity] = []
    if person.pose is not None:
        entities.append(_body(user, person, person.pose, now_ns))
    if person.cursor is not None:
        entities += _pointing(user, person.cursor, person.color, now_ns)
    if person.goal is not None:
        entities.append(_goal(user, person.goal, person.color, now_ns))
    return entities


def _body(user: str, person: DrawnPerson, pose: UserPose, now_ns: int) -> NamedEntity:
    profile = person.profile
    rgb = person.color
    stance = Stance(profile.body, profile.hand, pose.position_m, ray_model=profile.ray_model)
    neck_m = profile.body.footprint_to_neck_m
    limbs = [shapes.cylinder(pose.position_m, neck_m, TORSO_M, rgb, alpha=0.75, waist=0.6)]
    if person.cursor is not None:
        limbs += _arm(stance, person.cursor, rgb)

    # The ellipse of the position, unless it is known
    rim = ellipse(pose)
    lines: list[LinePrimitive] = []
    if rim is not None:
        lines.append(shapes.line(rim.tolist(), rgb, kind="loop"))
    head = shapes.sphere(stance.eyes_m, HEAD_M, rgb)
    label = shapes.label(user, shapes.above(stance.eyes_m, 0.3), rgb)
    facts = {"user": user, "located by": pose.method, "samples": str(pose.samples)}
    return shapes.entity(
        f"person {user}",
        now_ns,
        facts=facts,
        cylinders=limbs,
        spheres=[head],
        lines=lines,
        texts=[label],
    )


def _arm(stance: Stance, cursor: Cursor, rgb: Rgb) -> list[CylinderPrimitive]:
    """Return the arm that points to the cursor, or along a ray that meets nothing."""
    if cursor.origin_m is None or cursor.direction is None:
        return []
    range_m = cursor.range_m or FREE_RAY_M
    ray_m = vector.scale(cursor.direction, range_m)
    target = vector.add(cursor.origin_m, ray_m)
    azimuth, elevation = stance.aim_at(target)
    arm = vector.scale(vector.direction(azimuth, elevation), stance.arm_m)
    shoulder = stance.shoulder_m(azimuth)
    hand = vector.add(shoulder, arm)
    return [shapes.cylinder_between(shoulder, hand, ARM_M, rgb)]


def _pointing(user: str, cursor: Cursor, rgb: Rgb, now_ns: int) -> list[NamedEntity]:
    entities: list[NamedEntity] = []
    point_m: Vec3 | None = cursor.point_m
    if cursor.origin_m is not None and cursor.direction is not None:
        length_m = FREE_RAY_M if point_m is None else max(cursor.range_m, 0.1)
        step = vector.scale(cursor.direction, length_m)
        alpha = 0.3 if point_m is None else 0.8
        ray = shapes.arrow(cursor.origin_m, step, rgb, width_m=RAY_M, alpha=alpha)
        facts = {"user": user}
        entity = shapes.entity(f"ray {user}", now_ns, lifetime_s=LIFETIME_S, facts=facts, arrows=[ray])
        entities.append(entity)
    if point_m is not None:
        on = cursor.solid or cursor.surface
        place = f"{on} {cursor.surface_id}"
        facts = {"user": user, "on": place, "miss_m": f"{cursor.miss_m:.3f}"}
        ball = shapes.sphere(point_m, CURSOR_M, rgb)
        entity = shapes.entity(f"cursor {user}", now_ns, lifetime_s=LIFETIME_S, facts=facts, spheres=[ball])
        entities.append(entity)
    return entities


def _goal(user: str, goal: Goal, rgb: Rgb, now_ns: int) -> NamedEntity:
    foot = shapes.above(goal.position_m, GOAL_ABOVE_M)
    step = vector.scale(vector.direction(goal.yaw_rad, 0.0), GOAL_M)
    arrow = shapes.arrow(foot, step, rgb, width_m=0.05)
    above = shapes.above(foot, 0.4)
    label = shapes.label(f"goal of {user}", above, rgb)
    sigma_m = f"{goal.position_sigma_m:.3f}"
    facts = {"user": user, "on": goal.surface_id, "sigma_m": sigma_m}
    return shapes.entity(f"goal {user}", now_ns, facts=facts, arrows=[arrow], texts=[label])
