"""Output of people as REP-155 (ROS4HRI) defines: who is here, where, how sure that is, and their arm.

A person's ID is their name in ROS. A body's ID differs from it, because hri_person_manager rejects equal
ones. What an arm and a position do not tell follows the reference model `human_description`, see
docs/how-to/ros4hri.md.
"""

import math

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.outbound.person import transforms
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import ImuSample, Message, UserPose

BODY = "{user}_body"
"""ID of a body, with the person's for {user}."""

MAX_KNOWN = 100
"""Maximum number of known people; those who left first are forgotten first."""

NEAR_M = 0.5
"""Distance from the published position within which a person counts as found there: an arm's reach."""

HIPS = 0.5
"""Height of the hips as a share of that of the eyes, as in `human_description`."""

JOINTS = (
    *("waist", "r_head", "y_head", "p_head"),
    *("l_y_shoulder", "l_p_shoulder", "l_r_shoulder", "l_elbow"),
    *("r_y_shoulder", "r_p_shoulder", "r_r_shoulder", "r_elbow"),
    *("l_y_hip", "l_p_hip", "l_r_hip", "l_knee", "r_y_hip", "r_p_hip", "r_r_hip", "r_knee"),
)
"""All joints of `human_description` that are not fixed. At 0 the person stands, arms down."""


class KnownPeople:
    """People who have been here since the bridge started."""

    def __init__(self) -> None:
        self._ids: dict[str, None] = {}

    def __call__(self, _message: Message, about: ConversionContext) -> Converted:
        """Return their IDs."""
        for person in _here(about.scene):
            self._ids.pop(person, None)
            self._ids[person] = None
        self._ids = dict.fromkeys(list(self._ids)[-MAX_KNOWN:])
        return _ids(about, list(self._ids))


def tracked_people(_message: Message, about: ConversionContext) -> Converted:
    """Return the IDs of all who are here and have a position."""
    return _ids(about, _here(about.scene))


def tracked_bodies(_message: Message, about: ConversionContext) -> Converted:
    """Return the IDs of their bodies."""
    return _ids(about, [BODY.format(user=person) for person in _here(about.scene)])


def anonymous(_place: UserPose, about: ConversionContext) -> Converted:
    """Return false: a person's name is a permanent ID."""
    return (about.scene.types.make("std_msgs/msg/Bool", data=False),)


def body_id(_place: UserPose, about: ConversionContext) -> Converted:
    """Return the ID of a person's body."""
    return (about.scene.types.make("std_msgs/msg/String", data=_body(about)),)


def location_confidence(place: UserPose, about: ConversionContext) -> Converted:
    """Return the probability that the person is within `NEAR_M` of the position."""
    return (about.scene.types.make("std_msgs/msg/Float32", data=confidence(place)),)


def confidence(place: UserPose) -> float:
    """Return a lower bound of the probability that the person is within `NEAR_M` of the position, 0 to 1.

    Distribution function of Rayleigh's distribution, with the largest 1 sigma of the horizontal position.
    """
    xx, xy, _, _, yy, *_ = place.covariance
    variance = (xx + yy) / 2.0 + math.hypot((xx - yy) / 2.0, xy)
    return 1.0 if variance <= 0.0 else -math.expm1(-(NEAR_M**2) / (2.0 * variance))


def candidate_match(_place: UserPose, about: ConversionContext) -> Converted:
    """Return the match of a person's body with the person, for hri_person_manager."""
    make = about.scene.types.make
    match = make("hri_msgs/msg/IdsMatch")
    match.id1, match.id1_type = _body(about), match.BODY
    match.id2, match.id2_type = about.scene.names.of(about.name), match.PERSON
    match.confidence = 1.0
    return (match,)


def person_frame(place: UserPose, about: ConversionContext) -> Converted:
    """Return the frame `person_<id>`: the head's."""
    at_m = vector.add(place.position_m, (0.0, 0.0, _eyes_m(about)))
    child = f"person_{about.scene.names.of(about.name)}"
    return (transforms(about, [(child, at_m, _facing(place, about))]),)


def body_frame(place: UserPose, about: ConversionContext) -> Converted:
    """Return the frame `body_<id>`, midway between the hips, x to where the arm points."""
    at_m = vector.add(place.position_m, (0.0, 0.0, HIPS * _eyes_m(about)))
    return (transforms(about, [(f"body_{_body(about)}", at_m, _facing(place, about))]),)


def head_frame(_place: UserPose, about: ConversionContext) -> Converted:
    """Return the frame `head_<id>` at the eyes, in that of the body."""
    above_m = (0.0, 0.0, (1.0 - HIPS) * _eyes_m(about))
    return (transforms(about, [(f"head_{_body(about)}", above_m, rotation.IDENTITY)]),)


def joint_states(_sample: ImuSample, about: ConversionContext) -> Converted:
    """Return the angles of the pointing arm's shoulder, and 0 for all other joints."""
    person, types = about.scene.person(about.name), about.scene.types
    angles = dict.fromkeys(JOINTS, 0.0)
    if person.arm is not None:
        side = person.profile.hand[0]
        arm = vector.rotate_z(person.arm, -person.facing_rad)
        angles[f"{side}_y_shoulder"], angles[f"{side}_p_shoulder"] = shoulder(arm, is_left=side == "l")
    body = _body(about)
    return (
        types.make(
            "sensor_msgs/msg/JointState",
            header=values.header(types, about.stamp_ns, ""),
            name=[f"{joint}_{body}" for joint in angles],
            position=list(angles.values()),
        ),
    )


def shoulder(arm: Vec3, *, is_left: bool) -> tuple[float, float]:
    """Return `y_shoulder` and `p_shoulder` of a straight arm with direction `arm` in the body's frame, rad.

    In `human_description` an arm hangs along -z, `p_shoulder` lifts it sideways, and then `y_shoulder` turns
    it to the front.
    """
    x, y, z = arm
    outward = y if is_left else -y
    return math.atan2(x, outward), math.atan2(math.hypot(x, y), -z)


def _here(scene: ConversionState) -> list[str]:
    """Return the IDs of all who are here and have a position, in order."""
    there = (user for user, person in scene.people.items() if person.is_here and person.pose is not None)
    return sorted(map(scene.names.of, there))


def _ids(about: ConversionContext, ids: list[str]) -> Converted:
    types = about.scene.types
    header = values.header(types, about.stamp_ns, "")
    return (types.make("hri_msgs/msg/IdsList", header=header, ids=ids),)


def _body(about: ConversionContext) -> str:
    return BODY.format(user=about.scene.names.of(about.name))


def _eyes_m(about: ConversionContext) -> float:
    body = about.scene.person(about.name).profile.body
    return body.footprint_to_neck_m + body.neck_to_eyes_m


def _facing(place: UserPose, about: ConversionContext) -> rotation.Quaternion:
    return rotation.from_yaw(place.yaw_rad + about.scene.person(about.name).facing_rad)
