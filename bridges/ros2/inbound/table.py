"""Routes from ROS, and services offered to ROS nodes."""

from typing import Any, NamedTuple

from pointit.bridges.ros2.graph.backend import SENSOR, Qos
from pointit.bridges.ros2.inbound import conveyor
from pointit.bridges.ros2.inbound.person import Button, Poses, Wrist, people_in
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

SLOWEST, FASTEST = 0.01, 100.0
"""Limits of the speed. A stopped clock creeps on: the site's time never stops."""


def inward() -> tuple[InboundRoute, ...]:
    """Return the routes, with new converters."""
    wrist = Wrist()
    poses = Poses()
    button = Button()
    return (
        InboundRoute(
            *("imu_in", "/{user}/imu_in", "sensor_msgs/msg/Imu"),
            *(SENSOR, (topics.WRIST,), wrist.imu),
            rate_hz=200.0,
            context="how a person's arm is turned: the arm's frame, x to the finger, in theirs",
        ),
        InboundRoute(
            *("mocap_pose", "/{user}/mocap_pose", "geometry_msgs/msg/PoseStamped"),
            *(SENSOR, (topics.POSE,), poses.mocap),
            rate_hz=30.0,
            context="where a person stands: their frame in the world",
        ),
        InboundRoute(
            *("mocap_forearm", "/{user}/mocap_forearm", "geometry_msgs/msg/PoseStamped"),
            *(SENSOR, (), poses.forearm),
            rate_hz=200.0,
            context="marker body on the forearm with the IMU, which gives the yaw of their frame",
        ),
        InboundRoute(
            *("tf_in", "/tf", "tf2_msgs/msg/TFMessage"),
            *(_MANY, (topics.POSE,), poses.tf),
            max_bytes=_TF_BYTES,
            bytes_hz=_TF_BYTES_HZ,
            people=people_in,
            context="the same from a publisher of the person's frame as a child of the world's",
        ),
        InboundRoute(
            *("tf_static_in", "/tf_static", "tf2_msgs/msg/TFMessage"),
            *(Qos(depth=100, latched=True), (topics.SET_POSE, topics.POSE), poses.tf_static),
            on_presence=poses.on_presence,
            max_bytes=_TF_BYTES,
            context="where a person stands, told once",
        ),
        InboundRoute(
            *("clock_in", "/clock", "rosgraph_msgs/msg/Clock"),
            *(Qos(depth=1, reliable=False), (topics.CLOCK,), SimTimeInput()),
            enabled=False,
            context="a simulator's time for the whole site; off, as it moves everything",
        ),
        InboundRoute(
            *("rotation_in", "/{user}/metawear_ros/rotation", "geometry_msgs/msg/QuaternionStamped"),
            *(SENSOR, (topics.WRIST,), wrist.rotation),
            rate_hz=200.0,
            context="as imu_in, from the ROS toolkit's driver",
        ),
        InboundRoute(
            *("button_in", "/{user}/metawear_ros/button", "std_msgs/msg/Bool"),
            *(_STREAM, (topics.BUTTON,), button),
            forgets=button.forget,
            context="a person's button: pressed when it becomes true",
        ),
        InboundRoute(
            *("pointing_ray_in", "/{user}/pointing_ray", "geometry_msgs/msg/PoseStamped"),
            *(SENSOR, (topics.RAY,), ray),
            rate_hz=200.0,
            frame=PERSON,
            of_ros_users=True,
            context="ray of a user with ROS nodes only: from the eyes along x",
        ),
        InboundRoute(
            *("subscription_in", "/PUI_subscription", "conveyor_msgs/msg/PUISubscription"),
            *(_STREAM, (topics.INTERACTION, topics.PROFILE), Subscriptions()),
            of_ros_users=True,
            context="cursor of a ROS-only user: on or off, and its colour",
        ),
        InboundRoute(
            *("belt_cmd", "/belt_cmd", "conveyor_msgs/msg/BeltCommand"),
            *(_STREAM, (topics.SET_SPEED,), conveyor.belt_command),
            context='speeds of belts, "*": of all',
        ),
        InboundRoute(
            *("feed", "/feed", "std_msgs/msg/Bool"),
            *(_STREAM, (topics.SET_FEEDING,), conveyor.feed),
            rate_hz=10.0,
            context="whether the feeders give packages; belts run on",
        ),
        InboundRoute(
            *("add_package", "/add_package", "std_msgs/msg/UInt8"),
            *(_STREAM, (topics.ADD_PACKAGE,), conveyor.add_package),
            context="put an object of that kind on the first belt",
        ),
    )


def served() -> tuple[ServiceRoute, ...]:
    """Return the services, with new converters."""
    add_pack = conveyor.AddPack()
    return (
        ServiceRoute(
            *("add_pack", "/add_pack", "conveyor_msgs/srv/AddPack"),
            *(topics.ADD_PACKAGE, add_pack.asks),
            answers=add_pack.answers,
            has_result=True,
            context="put an object on a belt, under a number of the caller's",
        ),
        ServiceRoute(
            *("set_belt_speed", "/set_belt_speed", "conveyor_msgs/srv/SetBeltSpeed"),
            *(topics.SET_SPEED, conveyor.set_belt_speed),
            context="speed of all belts",
        ),
        ServiceRoute(
            *("reset_pack_sim", "/reset_pack_sim", "std_srvs/srv/Empty"),
            *(topics.RESET_CONVEYOR, conveyor.reset),
            context="empty the conveyor",
        ),
        ServiceRoute(
            *("set_yaw_origin", "/{user}/metawear_ros/set_yaw_origin", "std_srvs/srv/Empty"),
            *(topics.SET_YAW_ORIGIN, conveyor.set_yaw_origin),
            context="the arm points ahead now",
        ),
        ServiceRoute(
            *("set_brightness", "/set_brightness", "led_strip_msgs/srv/SetBrightness"),
            *(topics.SET_BRIGHTNESS, conveyor.set_brightness),
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
        sample = _Sample(context.wall_ns, int(value.clock.sec) * NS_PER_S + int(value.clock.nanosec))
        if sample.sim_ns < 0:
            return (
                ConversionWarning(
                    f"/clock says {sample.sim_ns / NS_PER_S:.1f} s: times before 0 are left out"
                ),
            )
        last = self._last
        self._last = sample
        if last is None or _has_jumped(last, sample):
            self._wait_ns = FIRST_NS
            return self._tick(sample)
        passed_ns = sample.wall_ns - self._last_sample.wall_ns
        if passed_ns < self._wait_ns:
            return ()
        self._wait_ns = TICK_NS
        self._speed = min(max((sample.sim_ns - self._last_sample.sim_ns) / passed_ns, SLOWEST), FASTEST)
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
