"""Routes of ROS4HRI (REP-155), in the table only with the parameter `ros4hri`.

Lists are latched and repeated: libhri reads them as volatile, others as latched. `location_confidence` is
volatile as hri_person_manager's. libhri subscribes to it when an ID has come, so it is repeated, too.
"""

from dataclasses import replace

from pointit.bridges.ros2.graph.backend import LATCHED, Qos
from pointit.bridges.ros2.outbound import humans
from pointit.bridges.ros2.outbound.table import TF_HZ
from pointit.bridges.ros2.routing.route_types import OutboundRoute
from pointit.schemas import topics

LISTED_HZ = 2.0
"""Rate of lists and confidences: this late people are seen to come and go."""
MATCHED_HZ = 1.0
JOINTS_HZ = 20.0

TRACKED = "/humans/persons/tracked"
"""List whose publisher owns the people of a graph: hri_person_manager, if it runs."""

PERSON = "/humans/persons/{user}"
BODY = f"/humans/bodies/{humans.BODY}"


def of_ros4hri() -> tuple[OutboundRoute, ...]:
    """Return the routes, with new converters."""
    rows = (*_lists(), *_people(), *_frames())
    return tuple(replace(row, is_ros4hri=True) for row in rows)


def _lists() -> tuple[OutboundRoute, ...]:
    tracked = OutboundRoute(
        name="tracked_people",
        ros=TRACKED,
        type="hri_msgs/msg/IdsList",
        reads=(topics.POSE,),
        by=humans.tracked_people,
        qos=LATCHED,
        rate_hz=LISTED_HZ,
        repeat_hz=LISTED_HZ,
        yields=True,
        ends=humans.no_ids,
        about="who is here and has a position",
    )
    return (
        tracked,
        replace(
            tracked,
            name="known_people",
            ros="/humans/persons/known",
            by=humans.KnownPeople(),
            about="who has been here since the bridge started",
        ),
        replace(
            tracked,
            name="tracked_bodies",
            ros="/humans/bodies/tracked",
            by=humans.tracked_bodies,
            about="the bodies of who is here",
        ),
    )


def _people() -> tuple[OutboundRoute, ...]:
    return (
        OutboundRoute(
            name="anonymous",
            ros=f"{PERSON}/anonymous",
            type="std_msgs/msg/Bool",
            reads=(topics.POSE,),
            by=humans.anonymous,
            qos=LATCHED,
            rate_hz=LISTED_HZ,
            on_change=True,
            yields=True,
            about="false: people have names",
        ),
        OutboundRoute(
            name="body_id",
            ros=f"{PERSON}/body_id",
            type="std_msgs/msg/String",
            reads=(topics.POSE,),
            by=humans.body_id,
            qos=LATCHED,
            rate_hz=LISTED_HZ,
            on_change=True,
            yields=True,
            ends=humans.no_body,
            about="a person's body",
        ),
        OutboundRoute(
            name="location_confidence",
            ros=f"{PERSON}/location_confidence",
            type="std_msgs/msg/Float32",
            reads=(topics.POSE,),
            by=humans.location_confidence,
            qos=Qos(depth=1),
            rate_hz=LISTED_HZ,
            repeat_hz=LISTED_HZ,
            yields=True,
            ends=humans.nowhere,
            about="probability that a person is within 0.5 m of their position",
        ),
        OutboundRoute(
            name="joint_states",
            ros=f"{BODY}/joint_states",
            type="sensor_msgs/msg/JointState",
            reads=(topics.IMU,),
            by=humans.joint_states,
            qos=Qos(depth=1),
            rate_hz=JOINTS_HZ,
            about="the shoulder of the pointing arm; all other joints are 0",
        ),
        OutboundRoute(
            name="candidate_matches",
            ros="/humans/candidate_matches",
            type="hri_msgs/msg/IdsMatch",
            reads=(topics.POSE,),
            by=humans.candidate_match,
            is_each=True,
            qos=Qos(depth=10),
            rate_hz=MATCHED_HZ,
            repeat_hz=MATCHED_HZ,
            about="whose body it is, for hri_person_manager",
        ),
    )


def _frames() -> tuple[OutboundRoute, ...]:
    person = OutboundRoute(
        name="person_tf",
        ros="/tf",
        type="tf2_msgs/msg/TFMessage",
        reads=(topics.POSE,),
        by=humans.person_frame,
        is_each=True,
        qos=Qos(depth=100),
        rate_hz=TF_HZ,
        repeat_hz=TF_HZ,
        yields=True,
        yields_to=TRACKED,
        about="`person_<id>` at the head",
    )
    return (
        person,
        replace(
            person,
            name="body_tf",
            by=humans.body_frame,
            yields=False,
            about="`body_<id>` at the hips, x to where the arm points",
        ),
        replace(
            person,
            name="head_tf",
            frame=f"body_{humans.BODY}",
            by=humans.head_frame,
            yields=False,
            about="`head_<id>` at the eyes, in the body's frame",
        ),
    )
