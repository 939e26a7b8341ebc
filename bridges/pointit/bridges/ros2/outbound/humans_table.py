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
        *("tracked_people", TRACKED, "hri_msgs/msg/IdsList"),
        *(LATCHED, (topics.POSE,), humans.tracked_people),
        rate_hz=LISTED_HZ,
        repeat_hz=LISTED_HZ,
        yields=True,
        has_end=True,
        context="who is here and has a position",
    )
    return (
        tracked,
        replace(
            tracked,
            name="known_people",
            ros="/humans/persons/known",
            by=humans.KnownPeople(),
            context="people seen since the bridge started",
        ),
        replace(
            tracked,
            name="tracked_bodies",
            ros="/humans/bodies/tracked",
            by=humans.tracked_bodies,
            context="the bodies of who is here",
        ),
    )


def _people() -> tuple[OutboundRoute, ...]:
    return (
        OutboundRoute(
            *("anonymous", f"{PERSON}/anonymous", "std_msgs/msg/Bool"),
            *(LATCHED, (topics.POSE,), humans.anonymous),
            rate_hz=LISTED_HZ,
            on_change=True,
            yields=True,
            context="false: people have names",
        ),
        OutboundRoute(
            *("body_id", f"{PERSON}/body_id", "std_msgs/msg/String"),
            *(LATCHED, (topics.POSE,), humans.body_id),
            rate_hz=LISTED_HZ,
            on_change=True,
            yields=True,
            has_end=True,
            context="a person's body",
        ),
        OutboundRoute(
            *("location_confidence", f"{PERSON}/location_confidence", "std_msgs/msg/Float32"),
            *(Qos(depth=1), (topics.POSE,), humans.location_confidence),
            rate_hz=LISTED_HZ,
            repeat_hz=LISTED_HZ,
            yields=True,
            has_end=True,
            context="probability that a person is within 0.5 m of their position",
        ),
        OutboundRoute(
            *("joint_states", f"{BODY}/joint_states", "sensor_msgs/msg/JointState"),
            *(Qos(depth=1), (topics.IMU,), humans.joint_states),
            rate_hz=JOINTS_HZ,
            context="the shoulder of the pointing arm; all other joints are 0",
        ),
        OutboundRoute(
            *("candidate_matches", "/humans/candidate_matches", "hri_msgs/msg/IdsMatch"),
            *(Qos(depth=10), (topics.POSE,), humans.candidate_match),
            is_each=True,
            rate_hz=MATCHED_HZ,
            repeat_hz=MATCHED_HZ,
            context="person of each body, for hri_person_manager",
        ),
    )


def _frames() -> tuple[OutboundRoute, ...]:
    person = OutboundRoute(
        *("person_tf", "/tf", "tf2_msgs/msg/TFMessage"),
        *(Qos(depth=100), (topics.POSE,), humans.person_frame),
        is_each=True,
        rate_hz=TF_HZ,
        repeat_hz=TF_HZ,
        yields=True,
        yields_to=TRACKED,
        context="`person_<id>` at the head",
    )
    return (
        person,
        replace(
            person,
            name="body_tf",
            by=humans.body_frame,
            yields=False,
            context="`body_<id>` at the hips, x to where the arm points",
        ),
        replace(
            person,
            name="head_tf",
            frame=f"body_{humans.BODY}",
            by=humans.head_frame,
            yields=False,
            context="`head_<id>` at the eyes, in the body's frame",
        ),
    )
