"""Routes to ROS: standard types first, then the ROS toolkit's messages under its names."""

from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, Qos
from pointit.bridges.ros2.outbound import conveyor, person, room, things
from pointit.bridges.ros2.outbound.map_markers import map_markers
from pointit.bridges.ros2.outbound.markers import Markers
from pointit.bridges.ros2.outbound.rosout import Rosout
from pointit.bridges.ros2.routing.frames import PERSON
from pointit.bridges.ros2.routing.route_types import OutboundRoute
from pointit.schemas import topics

POINTING_HZ = 50.0
"""Rate of what follows an arm."""
DRAWN_HZ = 20.0
"""Rate of what is only viewed."""
TF_HZ = 10.0
"""Rate of repeated transforms: listeners forget old ones, and need one not older than their data."""
LOG_HZ = 2.0
"""Rate at which one service's reports, one a second, are read: no service can flood ROS's log."""
CLOCK_HZ = 50.0
CLOCK_S = 10.0
"""Silence after which a clock has ended, for the site itself too (`runtime.bus.site_clock.SILENT_NS`), s."""

# A reliable publisher reaches both kinds of subscribers, also over DDS.
_NEWEST = Qos(depth=1)
_STREAM = Qos(depth=10)
_MANY = Qos(depth=100)


def outward() -> tuple[OutboundRoute, ...]:
    """Return the routes, with new converters."""
    return (*_standard(), *_toolkit())


def _standard() -> tuple[OutboundRoute, ...]:
    rosout = Rosout()
    return (
        OutboundRoute(
            *("pose", "/{user}/pose", "geometry_msgs/msg/PoseStamped"),
            *(LATCHED, (topics.POSE,), person.pose),
            rate_hz=POINTING_HZ,
            context="where a person stands, and where x of their IMU points",
        ),
        OutboundRoute(
            *(
                "pose_with_covariance",
                "/{user}/pose_with_covariance",
                "geometry_msgs/msg/PoseWithCovarianceStamped",
            ),
            *(LATCHED, (topics.POSE,), person.pose_with_covariance),
            rate_hz=POINTING_HZ,
            context="the same, and how sure that is",
        ),
        OutboundRoute(
            *("tf", "/tf", "tf2_msgs/msg/TFMessage"),
            *(_MANY, (topics.POSE,), person.transform),
            is_each=True,
            repeat_hz=TF_HZ,
            context="a person's frame in the world; not of people whose frame somebody else gives",
        ),
        OutboundRoute(
            *("tf_static", "/tf_static", "tf2_msgs/msg/TFMessage"),
            *(LATCHED, (topics.MAP,), room.static_frames),
            context="lamps, starts of belts and strips, all in one message",
        ),
        OutboundRoute(
            *("imu", "/{user}/imu", "sensor_msgs/msg/Imu"),
            *(_STREAM, (topics.IMU,), person.imu),
            rate_hz=POINTING_HZ,
            frame=PERSON,
            context="the arm's orientation, turning and acceleration, all in the person's frame",
        ),
        OutboundRoute(
            *("cursor", "/{user}/cursor", "geometry_msgs/msg/PointStamped"),
            *(_STREAM, (topics.CURSOR,), person.cursor),
            rate_hz=POINTING_HZ,
            context="where a person's ray meets the room",
        ),
        OutboundRoute(
            *("goal_pose", "/{user}/goal_pose", "geometry_msgs/msg/PoseStamped"),
            *(_STREAM, (topics.GOAL,), person.goal),
            context="where a person sends a robot, confirmed",
        ),
        OutboundRoute(
            *("thing_on", "/pointit/thing_on", "vision_msgs/msg/Detection3D"),
            *(_STREAM, (topics.SELECTION_EVENTS,), things.turned_on),
            context="a thing of the map fired, or was switched on: which, by whom, how sure",
        ),
        OutboundRoute(
            *("thing_off", "/pointit/thing_off", "vision_msgs/msg/Detection3D"),
            *(_STREAM, (topics.SELECTION_EVENTS,), things.turned_off),
            context="a thing of the map was switched off",
        ),
        OutboundRoute(
            *("is_pointing", "/{user}/is_pointing", "std_msgs/msg/Bool"),
            *(LATCHED, (topics.INTERACTION,), person.is_pointing),
            on_change=True,
            context="whether a person points",
        ),
        OutboundRoute(
            *("clock", "/clock", "rosgraph_msgs/msg/Clock"),
            *(_NEWEST, (topics.CLOCK,), room.clock),
            repeat_hz=CLOCK_HZ,
            repeat_for_s=CLOCK_S,
            yields=True,
            context="the site's time, while it is simulated",
        ),
        OutboundRoute(
            *("diagnostics", "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
            *(_STREAM, (topics.HEALTH,), room.diagnostics),
            is_each=True,
            context="health of every service",
        ),
        OutboundRoute(
            *("rosout", "/rosout", "rcl_interfaces/msg/Log"),
            *(ROSOUT, (topics.HEALTH,), rosout),
            is_each=True,
            rate_hz=LOG_HZ,
            begins=rosout.begin,
            forgets=rosout.forget,
            context="what goes wrong with a service, once, and when it is over",
        ),
        OutboundRoute(
            *("markers", "/pointit/markers", "visualization_msgs/msg/MarkerArray"),
            *(
                _NEWEST,
                (
                    *(topics.CURSOR, topics.OBJECTS, topics.POSE, topics.SELECTION, topics.INTERACTION),
                    *(topics.ROBOT_STATE, topics.ROBOT_PLAN, topics.STEERING),
                ),
                Markers(),
            ),
            rate_hz=DRAWN_HZ,
            context="rays, cursors, people, objects, robots, whose they are: for RViz and Foxglove",
        ),
        OutboundRoute(
            *("map_markers", "/pointit/map_markers", "visualization_msgs/msg/MarkerArray"),
            *(LATCHED, (topics.MAP,), map_markers),
            context="the map: belts, strips, lamps, solids, fences",
        ),
    )


def _toolkit() -> tuple[OutboundRoute, ...]:
    return (
        OutboundRoute(
            *("pointing_ray", "/{user}/pointing_ray", "geometry_msgs/msg/PoseStamped"),
            *(_MANY, (topics.RAY,), person.pointing_ray),
            rate_hz=POINTING_HZ,
            frame=PERSON,
            is_theirs=True,
            context="a person's ray: from the eyes along x",
        ),
        OutboundRoute(
            *("rotation", "/{user}/metawear_ros/rotation", "geometry_msgs/msg/QuaternionStamped"),
            *(_STREAM, (topics.IMU,), person.rotation_of_arm),
            rate_hz=POINTING_HZ,
            yields=True,
            frame=PERSON,
            is_theirs=True,
            context="how a person's arm is turned",
        ),
        OutboundRoute(
            *("button", "/{user}/metawear_ros/button", "std_msgs/msg/Bool"),
            *(LATCHED, (topics.BUTTON,), person.button),
            yields=True,
            apart_s=person.BUTTON_DOWN_S,
            is_theirs=True,
            context="a person's button: true, then false",
        ),
        OutboundRoute(
            *("state_transition", "/{user}/state_transition", "conveyor_msgs/msg/State"),
            *(LATCHED, (topics.INTERACTION,), person.state),
            on_change=True,
            is_theirs=True,
            context="where a person is in the interaction",
        ),
        OutboundRoute(
            *("subscription", "/PUI_subscription", "conveyor_msgs/msg/PUISubscription"),
            *(_STREAM, (topics.INTERACTION,), person.subscription),
            is_each=True,
            on_change=True,
            is_theirs=True,
            context="who points wants a cursor, for a pui_node of the ROS toolkit",
        ),
        OutboundRoute(
            *("packages", "/packages", "conveyor_msgs/msg/PackageList"),
            *(_NEWEST, (topics.OBJECTS,), conveyor.packages),
            rate_hz=POINTING_HZ,
            yields=True,
            context="what moves on belts and strips",
        ),
        OutboundRoute(
            *("selected_packages", "/selected_packages", "conveyor_msgs/msg/PackageUIDList"),
            *(LATCHED, (topics.SELECTION,), conveyor.selected),
            on_change=True,
            context="what is selected",
        ),
        OutboundRoute(
            *("pointers", "/pointers", "conveyor_msgs/msg/PointerList"),
            *(_NEWEST, (topics.CURSOR, topics.HOVER, topics.INTERACTION), conveyor.pointers),
            rate_hz=POINTING_HZ,
            context="who points where on which line, and at what",
        ),
        OutboundRoute(
            *("led_strips", "/led_strips", "led_strip_msgs/msg/LedStrips"),
            *(_NEWEST, (topics.STRIPS_FRAME,), room.led_strips),
            rate_hz=60.0,
            context="pixels of every strip",
        ),
        OutboundRoute(
            *("lamp_color", "/{led}/color", "std_msgs/msg/ColorRGBA"),
            *(_NEWEST, (topics.LAMP_COLOR,), room.lamp_color),
            context="what a lamp shows",
        ),
        OutboundRoute(
            *("step_number", "/step_number", "std_msgs/msg/Int32"),
            *(LATCHED, (topics.CONVEYOR_STATE,), conveyor.step_number),
            on_change=True,
            context="step of the feeding schedule",
        ),
    )
