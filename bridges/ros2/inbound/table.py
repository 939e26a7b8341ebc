"""Routes from ROS, and services offered to ROS nodes."""

from typing import Any, NamedTuple

from pointit.bridges.ros2.graph.backend import SENSOR, Qos
from pointit.bridges.ros2.inbound import conveyor
from pointit.bridges.ros2.inbound.person import Button, Poses, RosWrist, people_in
from pointit.bridges.ros2.inbound.rays import Subscriptions, ray
from pointit.bridges.ros2.routing.names import PERSON
from pointit.bridges.ros2.routing.route_types import (
    BusOutput,
    ConversionContext,
    ConversionWarning,
    InboundRoute,
    ServiceRoute,
    Taken,
)
from pointit.schemas import NS_PER_S, ClockTick, topics
from pointit.schemas.topics import CLOCK

_STREAM = Qos(depth=10)

_MANY = Qos(depth=100)

_TF_BYTES = 64 * 1024
"""Some 600 transforms; decoding them blocks the loop for 6 ms."""

_TF_BYTES_HZ = 1e6
"""A tenth of the loop's time. Ten people at 100 Hz need a sixth of that."""

TICK_NS = NS_PER_S
"""Interval of ticks, wall time: the site's clock runs on in between."""

FIRST_NS = NS_PER_S // 4
"""Wall time after which the speed is known well enough for the first tick."""

JUMP_NS = NS_PER_S // 2
"""Simulated time beyond the fastest clock's progress that counts as a step and is published at once."""

SLOWEST = 0.01
"""Least speed. A stopped clock creeps on: the site's time never stops."""
FASTEST = 100.0
"""Largest speed."""


def inward() -> tuple[InboundRoute, ...]:
    """Return the routes, with new converters."""
    wrist = RosWrist()
    poses = Poses()
    button = Button()
    return (
        # People
        InboundRoute(
            name="imu_in",
            ros="/{user}/imu_in",
            type="sensor_msgs/msg/Imu",
            qos=SENSOR,
            into=(topics.WRIST,),
            by=wrist.imu,
            rate_hz=200.0,
            context="how a person's arm is turned: the arm's frame, x to the finger, in theirs",
        ),
        InboundRoute(
            name="mocap_pose",
            ros="/{user}/mocap_pose",
            type="geometry_msgs/msg/PoseStamped",
            qos=SENSOR,
            into=(topics.POSE,),
            by=poses.mocap,
            rate_hz=30.0,
            context="where a person stands: their frame in the world",
        ),
        InboundRoute(
            name="mocap_forearm",
            ros="/{user}/mocap_forearm",
            type="geometry_msgs/msg/PoseStamped",
            qos=SENSOR,
            into=(),
            by=poses.forearm,
            rate_hz=200.0,
            context="marker body on the forearm with the IMU, which gives the yaw of their frame",
        ),
        InboundRoute(
            name="tf_in",
            ros="/tf",
            type="tf2_msgs/msg/TFMessage",
            qos=_MANY,
            into=(topics.POSE,),
            by=poses.tf,
            max_bytes=_TF_BYTES,
            bytes_hz=_TF_BYTES_HZ,
            people=people_in,
            context="the same from a publisher of the person's frame as a child of the world's",
        ),
        InboundRoute(
            name="tf_static_in",
            ros="/tf_static",
            type="tf2_msgs/msg/TFMessage",
            qos=Qos(depth=100, latched=True),
            into=(topics.SET_POSE, topics.POSE),
            by=poses.tf_static,
            on_presence=poses.on_presence,
            max_bytes=_TF_BYTES,
            context="where a person stands, told once",
        ),
        # The site's time
        InboundRoute(
            name="clock_in",
            ros="/clock",
            type="rosgraph_msgs/msg/Clock",
            qos=Qos(depth=1, reliable=False),
            into=(topics.CLOCK,),
            by=SimTimeInput(),
            enabled=False,
            context="a simulator's time for the whole site; off, as it moves everything",
        ),
        # People again, by the ROS toolkit's nodes
        InboundRoute(
            name="rotation_in",
            ros="/{user}/metawear_ros/rotation",
            type="geometry_msgs/msg/QuaternionStamped",
            qos=SENSOR,
            into=(topics.WRIST,),
            by=wrist.rotation,
            rate_hz=200.0,
            context="as imu_in, from the ROS toolkit's driver",
        ),
        InboundRoute(
            name="button_in",
            ros="/{user}/metawear_ros/button",
            type="std_msgs/msg/Bool",
            qos=_STREAM,
            into=(topics.BUTTON,),
            by=button,
            forgets=button.forget,
            context="a person's button: pressed when it becomes true",
        ),
        InboundRoute(
            name="pointing_ray_in",
            ros="/{user}/pointing_ray",
            type="geometry_msgs/msg/PoseStamped",
            qos=SENSOR,
            into=(topics.RAY,),
            by=ray,
            rate_hz=200.0,
            frame=PERSON,
            of_ros_users=True,
            context="ray of a user with ROS nodes only: from the eyes along x",
        ),
        InboundRoute(
            name="subscription_in",
            ros="/PUI_subscription",
            type="conveyor_msgs/msg/PUISubscription",
            qos=_STREAM,
            into=(topics.INTERACTION, topics.PROFILE),
            by=Subscriptions(),
            of_ros_users=True,
            context="cursor of a ROS-only user: on or off, and its colour",
        ),
        # Conveyor
        InboundRoute(
            name="belt_cmd",
            ros="/belt_cmd",
            type="conveyor_msgs/msg/BeltCommand",
            qos=_STREAM,
            into=(topics.SET_SPEED,),
            by=conveyor.belt_command,
            context='speeds of belts, "*": of all',
        ),
        InboundRoute(
            name="feed",
            ros="/feed",
            type="std_msgs/msg/Bool",
            qos=_STREAM,
            into=(topics.SET_FEEDING,),
            by=conveyor.feed,
            rate_hz=10.0,
            context="whether the feeders give packages; belts run on",
        ),
        InboundRoute(
            name="add_package",
            ros="/add_package",
            type="std_msgs/msg/UInt8",
            qos=_STREAM,
            into=(topics.ADD_PACKAGE,),
            by=conveyor.add_package,
            context="put an object of that kind on the first belt",
        ),
    )


def served() -> tuple[ServiceRoute, ...]:
    """Return the services, with new converters."""
    add_pack = conveyor.AddPack()
    return (
        # Conveyor
        ServiceRoute(
            name="add_pack",
            ros="/add_pack",
            type="conveyor_msgs/srv/AddPack",
            request=topics.ADD_PACKAGE,
            asks=add_pack.asks,
            answers=add_pack.answers,
            has_result=True,
            context="put an object on a belt, under a number of the caller's",
        ),
        ServiceRoute(
            name="set_belt_speed",
            ros="/set_belt_speed",
            type="conveyor_msgs/srv/SetBeltSpeed",
            request=topics.SET_SPEED,
            asks=conveyor.set_belt_speed,
            context="speed of all belts",
        ),
        ServiceRoute(
            name="reset_pack_sim",
            ros="/reset_pack_sim",
            type="std_srvs/srv/Empty",
            request=topics.RESET_CONVEYOR,
            asks=conveyor.reset,
            context="empty the conveyor",
        ),
        # People and lights
        ServiceRoute(
            name="set_yaw_origin",
            ros="/{user}/metawear_ros/set_yaw_origin",
            type="std_srvs/srv/Empty",
            request=topics.SET_YAW_ORIGIN,
            asks=conveyor.set_yaw_origin,
            context="the arm points ahead now",
        ),
        ServiceRoute(
            name="set_brightness",
            ros="/set_brightness",
            type="led_strip_msgs/srv/SetBrightness",
            request=topics.SET_BRIGHTNESS,
            asks=conveyor.set_brightness,
            context="dim all strips, or those of some channels",
        ),
    )


class _Sample(NamedTuple):
    wall_ns: int
    sim_ns: int


class SimTimeInput:
    """Publishes the time and speed of a simulation to the site."""

    def __init__(self) -> None:
        self._last: _Sample | None = None
        self._last_sample = _Sample(0, 0)
        self._speed = 1.0
        self._wait_ns = FIRST_NS

    def __call__(self, value: Any, context: ConversionContext) -> Taken:
        """Convert a rosgraph_msgs/Clock."""
        clock_ns = int(value.clock.sec) * NS_PER_S + int(value.clock.nanosec)
        sample = _Sample(context.wall_ns, clock_ns)
        if sample.sim_ns < 0:
            clock_s = sample.sim_ns / NS_PER_S
            sentence = f"/clock says {clock_s:.1f} s: times before 0 are left out"
            return (ConversionWarning(sentence),)
        last = self._last
        self._last = sample
        if last is None or _has_jumped(last, sample):
            self._wait_ns = FIRST_NS
            return self._tick(sample)

        # In between the site's clock runs on at the last speed
        passed_ns = sample.wall_ns - self._last_sample.wall_ns
        if passed_ns < self._wait_ns:
            return ()
        self._wait_ns = TICK_NS
        simulated_ns = sample.sim_ns - self._last_sample.sim_ns
        self._speed = min(max(simulated_ns / passed_ns, SLOWEST), FASTEST)
        return self._tick(sample)

    def _tick(self, sample: _Sample) -> Taken:
        self._last_sample = sample
        tick = ClockTick(stamp_ns=sample.wall_ns, sim_ns=sample.sim_ns, speed=self._speed)
        return (BusOutput(CLOCK, "", tick),)


def _has_jumped(last: _Sample, sample: _Sample) -> bool:
    """Return True if the simulated clock was stepped, or the wall clock was set back."""
    passed_ns = sample.wall_ns - last.wall_ns
    ran_ns = sample.sim_ns - last.sim_ns
    return not 0 <= ran_ns <= JUMP_NS + passed_ns * FASTEST
