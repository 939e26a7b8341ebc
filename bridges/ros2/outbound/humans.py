"""Output of people by REP-155 (ROS4HRI): presence, position with its uncertainty, arm; and the routes of it.

A person's ID is their name in ROS. A body's ID differs from it, because hri_person_manager rejects equal
ones. Values that arm and position do not determine are those of the reference model `human_description`, see
docs/how-to/ros4hri.md.

Lists are latched and repeated: libhri reads them as volatile, others as latched. `location_confidence` is
volatile as hri_person_manager's. libhri subscribes to it when an ID has come, so it is repeated, too.
"""

import math
from dataclasses import replace

from pointit.bridges.ros2.graph.backend import LATCHED, Qos
from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.outbound.person import transforms
from pointit.bridges.ros2.outbound.table import TF_HZ
from pointit.bridges.ros2.routing.conversion_state import ConversionState
from pointit.bridges.ros2.routing.route_types import ConversionContext, Converted, OutboundRoute
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.schemas import ImuSample, Message, UserPose, topics

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

LISTED_HZ = 2.0
"""Rate of lists and confidences: this late people are seen to come and go."""
MATCHED_HZ = 1.0
JOINTS_HZ = 20.0

TRACKED = "/humans/persons/tracked"
"""List whose publisher owns the people of a graph: hri_person_manager, if it runs."""

PERSON = "/humans/persons/{user}"
BODY_ROUTES = f"/humans/bodies/{BODY}"


class KnownPeople:
    """People who have been here since the bridge started."""

    def __init__(self) -> None:
        self._ids: dict[str, None] = {}

    def __call__(self, _message: Message, context: ConversionContext) -> Converted:
        """Return their IDs."""
        for person in _here(context.state):
            self._ids.pop(person, None)
            self._ids[person] = None
        newest = list(self._ids)[-MAX_KNOWN:]
        self._ids = dict.fromkeys(newest)
        return _ids(context, list(self._ids))


def tracked_people(_message: Message, context: ConversionContext) -> Converted:
    """Return the IDs of all who are here and have a position."""
    return _ids(context, _here(context.state))


def tracked_bodies(_message: Message, context: ConversionContext) -> Converted:
    """Return the IDs of their bodies."""
    bodies = [BODY.format(user=person) for person in _here(context.state)]
    return _ids(context, bodies)


def anonymous(_user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return false: a person's name is a permanent ID."""
    return (context.state.types.make("std_msgs/msg/Bool", data=False),)


def body_id(_user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return the ID of a person's body."""
    return (context.state.types.make("std_msgs/msg/String", data=_body(context)),)


def location_confidence(user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return the probability that the person is within `NEAR_M` of the position."""
    return (context.state.types.make("std_msgs/msg/Float32", data=confidence(user_pose)),)


def confidence(user_pose: UserPose) -> float:
    """Return a lower bound of the probability that the person is within `NEAR_M` of the position, 0 to 1.

    Distribution function of Rayleigh's distribution, with the largest 1 sigma of the horizontal position.
    """
    xx, xy, _, _, yy, *_ = user_pose.covariance
    mean = (xx + yy) / 2.0
    largest = mean + math.hypot((xx - yy) / 2.0, xy)
    if largest <= 0.0:
        return 1.0
    return -math.expm1(-(NEAR_M**2) / (2.0 * largest))


def candidate_match(_user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return the match of a person's body with the person, for hri_person_manager."""
    make = context.state.types.make
    match = make("hri_msgs/msg/IdsMatch")
    match.id1 = _body(context)
    match.id1_type = match.BODY
    match.id2 = context.state.names.of(context.name)
    match.id2_type = match.PERSON
    match.confidence = 1.0
    return (match,)


def person_frame(user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return the frame `person_<id>`: the head's."""
    head_m = vector.add(user_pose.position_m, (0.0, 0.0, _eyes_m(context)))
    child = f"person_{context.state.names.of(context.name)}"
    return (transforms(context, [(child, head_m, _facing(user_pose, context))]),)


def body_frame(user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return the frame `body_<id>`, midway between the hips, x to where the arm points."""
    hips_m = vector.add(user_pose.position_m, (0.0, 0.0, HIPS * _eyes_m(context)))
    child = f"body_{_body(context)}"
    return (transforms(context, [(child, hips_m, _facing(user_pose, context))]),)


def head_frame(_user_pose: UserPose, context: ConversionContext) -> Converted:
    """Return the frame `head_<id>` at the eyes, in that of the body."""
    above_m = (0.0, 0.0, (1.0 - HIPS) * _eyes_m(context))
    child = f"head_{_body(context)}"
    return (transforms(context, [(child, above_m, rotation.IDENTITY)]),)


def joint_states(_sample: ImuSample, context: ConversionContext) -> Converted:
    """Return the angles of the pointing arm's shoulder, and 0 for all other joints."""
    person = context.state.person(context.name)
    types = context.state.types
    angles = dict.fromkeys(JOINTS, 0.0)
    if person.arm is not None:
        side = person.profile.hand[0]
        arm = vector.rotate_z(person.arm, -person.facing_rad)
        y_shoulder, p_shoulder = shoulder(arm, is_left=side == "l")
        angles[f"{side}_y_shoulder"] = y_shoulder
        angles[f"{side}_p_shoulder"] = p_shoulder
    body = _body(context)
    message = types.make(
        "sensor_msgs/msg/JointState",
        header=values.header(types, context.stamp_ns, ""),
        name=[f"{joint}_{body}" for joint in angles],
        position=list(angles.values()),
    )
    return (message,)


def shoulder(arm: Vec3, *, is_left: bool) -> tuple[float, float]:
    """Return `y_shoulder` and `p_shoulder` of a straight arm with direction `arm` in the body's frame, rad.

    In `human_description` an arm hangs along -z, `p_shoulder` lifts it sideways, and then `y_shoulder` turns
    it to the front.
    """
    x, y, z = arm
    outward = y if is_left else -y
    lift_rad = math.atan2(math.hypot(x, y), -z)
    return math.atan2(x, outward), lift_rad


def _here(state: ConversionState) -> list[str]:
    """Return the IDs of all who are here and have a position, in order."""
    present: list[str] = []
    for user, person in state.people.items():
        if person.is_here and person.pose is not None:
            present.append(user)
    return sorted(map(state.names.of, present))


def _ids(context: ConversionContext, ids: list[str]) -> Converted:
    types = context.state.types
    header = values.header(types, context.stamp_ns, "")
    return (types.make("hri_msgs/msg/IdsList", header=header, ids=ids),)


def _body(context: ConversionContext) -> str:
    return BODY.format(user=context.state.names.of(context.name))


def _eyes_m(context: ConversionContext) -> float:
    body = context.state.person(context.name).profile.body
    return body.footprint_to_neck_m + body.neck_to_eyes_m


def _facing(user_pose: UserPose, context: ConversionContext) -> rotation.Quaternion:
    person = context.state.person(context.name)
    return rotation.from_yaw(user_pose.yaw_rad + person.facing_rad)


def of_ros4hri() -> tuple[OutboundRoute, ...]:
    """Return the routes, with new converters."""
    rows = (*_lists(), *_people(), *_frames())
    return tuple(replace(row, is_ros4hri=True) for row in rows)


def _lists() -> tuple[OutboundRoute, ...]:
    tracked = OutboundRoute(
        name="tracked_people",
        ros=TRACKED,
        type="hri_msgs/msg/IdsList",
        qos=LATCHED,
        reads=(topics.POSE,),
        by=tracked_people,
        rate_hz=LISTED_HZ,
        repeat_hz=LISTED_HZ,
        yields=True,
        has_end=True,
        context="who is here and has a position",
    )
    known = replace(
        tracked,
        name="known_people",
        ros="/humans/persons/known",
        by=KnownPeople(),
        context="people seen since the bridge started",
    )
    bodies = replace(
        tracked,
        name="tracked_bodies",
        ros="/humans/bodies/tracked",
        by=tracked_bodies,
        context="the bodies of who is here",
    )
    return tracked, known, bodies


def _people() -> tuple[OutboundRoute, ...]:
    return (
        # Facts about each person
        OutboundRoute(
            name="anonymous",
            ros=f"{PERSON}/anonymous",
            type="std_msgs/msg/Bool",
            qos=LATCHED,
            reads=(topics.POSE,),
            by=anonymous,
            rate_hz=LISTED_HZ,
            on_change=True,
            yields=True,
            context="false: people have names",
        ),
        OutboundRoute(
            name="body_id",
            ros=f"{PERSON}/body_id",
            type="std_msgs/msg/String",
            qos=LATCHED,
            reads=(topics.POSE,),
            by=body_id,
            rate_hz=LISTED_HZ,
            on_change=True,
            yields=True,
            has_end=True,
            context="a person's body",
        ),
        OutboundRoute(
            name="location_confidence",
            ros=f"{PERSON}/location_confidence",
            type="std_msgs/msg/Float32",
            qos=Qos(depth=1),
            reads=(topics.POSE,),
            by=location_confidence,
            rate_hz=LISTED_HZ,
            repeat_hz=LISTED_HZ,
            yields=True,
            has_end=True,
            context="probability that a person is within 0.5 m of their position",
        ),
        # Their bodies
        OutboundRoute(
            name="joint_states",
            ros=f"{BODY_ROUTES}/joint_states",
            type="sensor_msgs/msg/JointState",
            qos=Qos(depth=1),
            reads=(topics.IMU,),
            by=joint_states,
            rate_hz=JOINTS_HZ,
            context="the shoulder of the pointing arm; all other joints are 0",
        ),
        OutboundRoute(
            name="candidate_matches",
            ros="/humans/candidate_matches",
            type="hri_msgs/msg/IdsMatch",
            qos=Qos(depth=10),
            reads=(topics.POSE,),
            by=candidate_match,
            is_each=True,
            rate_hz=MATCHED_HZ,
            repeat_hz=MATCHED_HZ,
            context="person of each body, for hri_person_manager",
        ),
    )


def _frames() -> tuple[OutboundRoute, ...]:
    person = OutboundRoute(
        name="person_tf",
        ros="/tf",
        type="tf2_msgs/msg/TFMessage",
        qos=Qos(depth=100),
        reads=(topics.POSE,),
        by=person_frame,
        is_each=True,
        rate_hz=TF_HZ,
        repeat_hz=TF_HZ,
        yields=True,
        yields_to=TRACKED,
        context="`person_<id>` at the head",
    )
    # Only the person's frame is hri_person_manager's, if it runs; frames of bodies stay ours
    body = replace(
        person,
        name="body_tf",
        by=body_frame,
        yields=False,
        context="`body_<id>` at the hips, x to where the arm points",
    )
    head = replace(
        person,
        name="head_tf",
        frame=f"body_{BODY}",
        by=head_frame,
        yields=False,
        context="`head_<id>` at the eyes, in the body's frame",
    )
    return person, body, head
