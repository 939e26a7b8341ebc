"""Routes to ROS: standard types first, then the ROS toolkit's messages under its names."""

from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, Qos
from pointit.bridges.ros2.outbound import conveyor, person, room
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
            name="pose",
            ros="/{user}/pose",
            type="geometry_msgs/msg/PoseStamped",
            reads=(topics.POSE,),
            by=person.pose,
            qos=LATCHED,
            rate_hz=POINTING_HZ,
            about="where a person stands, and where x of their IMU points",
        ),
        OutboundRoute(
            name="pose_with_covariance",
            ros="/{user}/pose_with_covariance",
            type="geometry_msgs/msg/PoseWithCovarianceStamped",
            reads=(topics.POSE,),
            by=person.pose_with_covariance,
            qos=LATCHED,
            rate_hz=POINTING_HZ,
            about="the same, and how sure that is",
        ),
        OutboundRoute(
            name="tf",
            ros="/tf",
            type="tf2_msgs/msg/TFMessage",
            reads=(topics.POSE,),
            by=person.transform,
            is_each=True,
            qos=_MANY,
            repeat_hz=TF_HZ,
            about="a person's frame in the world; not of people whose frame somebody else gives",
        ),
        OutboundRoute(
            name="tf_static",
            ros="/tf_static",
            type="tf2_msgs/msg/TFMessage",
            reads=(topics.MAP,),
            by=room.static_frames,
            qos=LATCHED,
            about="lamps, starts of belts and strips, all in one message",
        ),
        OutboundRoute(
            name="imu",
            ros="/{user}/imu",
            type="sensor_msgs/msg/Imu",
            reads=(topics.IMU,),
            by=person.imu,
            qos=_STREAM,
            rate_hz=POINTING_HZ,
            frame=PERSON,
            about="the arm's orientation, turning and acceleration, all in the person's frame",
        ),
        OutboundRoute(
            name="cursor",
            ros="/{user}/cursor",
            type="geometry_msgs/msg/PointStamped",
            reads=(topics.CURSOR,),
            by=person.cursor,
            qos=_STREAM,
            rate_hz=POINTING_HZ,
            about="where a person's ray meets the room",
        ),
        OutboundRoute(
            name="goal_pose",
            ros="/{user}/goal_pose",
            type="geometry_msgs/msg/PoseStamped",
            reads=(topics.GOAL,),
            by=person.goal,
            qos=_STREAM,
            about="where a person sends a robot, confirmed",
        ),
        OutboundRoute(
            name="is_pointing",
            ros="/{user}/is_pointing",
            type="std_msgs/msg/Bool",
            reads=(topics.INTERACTION,),
            by=person.is_pointing,
            qos=LATCHED,
            on_change=True,
            about="whether a person points",
        ),
        OutboundRoute(
            name="clock",
            ros="/clock",
            type="rosgraph_msgs/msg/Clock",
            reads=(topics.CLOCK,),
            by=room.clock,
            qos=_NEWEST,
            repeat_hz=CLOCK_HZ,
            repeat_for_s=CLOCK_S,
            yields=True,
            about="the site's time, while it is simulated",
        ),
        OutboundRoute(
            name="diagnostics",
            ros="/diagnostics",
            type="diagnostic_msgs/msg/DiagnosticArray",
            reads=(topics.HEALTH,),
            by=room.diagnostics,
            is_each=True,
            qos=_STREAM,
            about="health of every service",
        ),
        OutboundRoute(
            name="rosout",
            ros="/rosout",
            type="rcl_interfaces/msg/Log",
            reads=(topics.HEALTH,),
            by=rosout,
            is_each=True,
            qos=ROSOUT,
            rate_hz=LOG_HZ,
            begins=rosout.begin,
            forgets=rosout.forget,
            about="what goes wrong with a service, once, and when it is over",
        ),
        OutboundRoute(
            name="markers",
            ros="/pointit/markers",
            type="visualization_msgs/msg/MarkerArray",
            reads=(
                *(topics.CURSOR, topics.OBJECTS, topics.POSE, topics.SELECTION, topics.INTERACTION),
                *(topics.ROBOT_STATE, topics.ROBOT_PLAN, topics.STEERING),
            ),
            by=Markers(),
            qos=_NEWEST,
            rate_hz=DRAWN_HZ,
            about="rays, cursors, people, objects, robots, whose they are: for RViz and Foxglove",
        ),
        OutboundRoute(
            name="map_markers",
            ros="/pointit/map_markers",
            type="visualization_msgs/msg/MarkerArray",
            reads=(topics.MAP,),
            by=map_markers,
            qos=LATCHED,
            about="the map: belts, strips, lamps, solids, fences",
        ),
    )


def _toolkit() -> tuple[OutboundRoute, ...]:
    return (
        OutboundRoute(
            name="pointing_ray",
            ros="/{user}/pointing_ray",
            type="geometry_msgs/msg/PoseStamped",
            reads=(topics.RAY,),
            by=person.pointing_ray,
            qos=_MANY,
            rate_hz=POINTING_HZ,
            frame=PERSON,
            is_theirs=True,
            about="a person's ray: from the eyes along x",
        ),
        OutboundRoute(
            name="rotation",
            ros="/{user}/metawear_ros/rotation",
            type="geometry_msgs/msg/QuaternionStamped",
            reads=(topics.IMU,),
            by=person.rotation_of_arm,
            qos=_STREAM,
            rate_hz=POINTING_HZ,
            yields=True,
            frame=PERSON,
            is_theirs=True,
            about="how a person's arm is turned",
        ),
        OutboundRoute(
            name="button",
            ros="/{user}/metawear_ros/button",
            type="std_msgs/msg/Bool",
            reads=(topics.BUTTON,),
            by=person.button,
            qos=LATCHED,
            yields=True,
            apart_s=person.BUTTON_DOWN_S,
            is_theirs=True,
            about="a person's button: true, then false",
        ),
        OutboundRoute(
            name="state_transition",
            ros="/{user}/state_transition",
            type="conveyor_msgs/msg/State",
            reads=(topics.INTERACTION,),
            by=person.state,
            qos=LATCHED,
            on_change=True,
            is_theirs=True,
            about="where a person is in the interaction",
        ),
        OutboundRoute(
            name="subscription",
            ros="/PUI_subscription",
            type="conveyor_msgs/msg/PUISubscription",
            reads=(topics.INTERACTION,),
            by=person.subscription,
            is_each=True,
            qos=_STREAM,
            on_change=True,
            is_theirs=True,
            about="who points wants a cursor, for a pui_node of the ROS toolkit",
        ),
        OutboundRoute(
            name="packages",
            ros="/packages",
            type="conveyor_msgs/msg/PackageList",
            reads=(topics.OBJECTS,),
            by=conveyor.packages,
            qos=_NEWEST,
            rate_hz=POINTING_HZ,
            yields=True,
            about="what moves on belts and strips",
        ),
        OutboundRoute(
            name="selected_packages",
            ros="/selected_packages",
            type="conveyor_msgs/msg/PackageUIDList",
            reads=(topics.SELECTION,),
            by=conveyor.selected,
            qos=LATCHED,
            on_change=True,
            about="what is selected",
        ),
        OutboundRoute(
            name="pointers",
            ros="/pointers",
            type="conveyor_msgs/msg/PointerList",
            reads=(topics.CURSOR, topics.HOVER, topics.INTERACTION),
            by=conveyor.pointers,
            qos=_NEWEST,
            rate_hz=POINTING_HZ,
            about="who points where on which line, and at what",
        ),
        OutboundRoute(
            name="led_strips",
            ros="/led_strips",
            type="led_strip_msgs/msg/LedStrips",
            reads=(topics.STRIPS_FRAME,),
            by=room.led_strips,
            qos=_NEWEST,
            rate_hz=60.0,
            about="pixels of every strip",
        ),
        OutboundRoute(
            name="lamp_color",
            ros="/{led}/color",
            type="std_msgs/msg/ColorRGBA",
            reads=(topics.LAMP_COLOR,),
            by=room.lamp_color,
            qos=_NEWEST,
            about="what a lamp shows",
        ),
        OutboundRoute(
            name="step_number",
            ros="/step_number",
            type="std_msgs/msg/Int32",
            reads=(topics.CONVEYOR_STATE,),
            by=conveyor.step_number,
            qos=LATCHED,
            on_change=True,
            about="step of the feeding schedule",
        ),
    )
