"""Routes from ROS, and services offered to ROS nodes."""

from typing import Any, NamedTuple

from pointit.bridges.ros2.graph.backend import SENSOR, SERVICE, Qos
from pointit.bridges.ros2.inbound import conveyor
from pointit.bridges.ros2.inbound.guest import Rays, Subscriptions
from pointit.bridges.ros2.inbound.person import Button, Poses, Wrist, people_in
from pointit.bridges.ros2.routing.frames import PERSON
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
    wrist, poses, button = Wrist(), Poses(), Button()
    return (
        InboundRoute(
            name="imu_in",
            ros="/{user}/imu_in",
            type="sensor_msgs/msg/Imu",
            into=(topics.WRIST,),
            by=wrist.imu,
            qos=SENSOR,
            rate_hz=200.0,
            about="how a person's arm is turned: the arm's frame, x to the finger, in theirs",
        ),
        InboundRoute(
            name="mocap_pose",
            ros="/{user}/mocap_pose",
            type="geometry_msgs/msg/PoseStamped",
            into=(topics.POSE,),
            by=poses.mocap,
            qos=SENSOR,
            rate_hz=30.0,
            about="where a person stands: their frame in the world",
        ),
        InboundRoute(
            name="tf_in",
            ros="/tf",
            type="tf2_msgs/msg/TFMessage",
            into=(topics.POSE,),
            by=poses.tf,
            qos=_MANY,
            max_bytes=_TF_BYTES,
            bytes_hz=_TF_BYTES_HZ,
            people=people_in,
            about="the same from who publishes the person's frame, straight in the world's",
        ),
        InboundRoute(
            name="tf_static_in",
            ros="/tf_static",
            type="tf2_msgs/msg/TFMessage",
            into=(topics.SET_POSE, topics.POSE),
            by=poses.tf_static,
            meets=poses.meet,
            qos=Qos(depth=100, latched=True),
            max_bytes=_TF_BYTES,
            about="where a person stands, told once",
        ),
        InboundRoute(
            name="clock_in",
            ros="/clock",
            type="rosgraph_msgs/msg/Clock",
            into=(topics.CLOCK,),
            by=SimTimeInput(),
            qos=Qos(depth=1, reliable=False),
            enabled=False,
            about="a simulator's time for the whole site; off, as it moves everything",
        ),
        InboundRoute(
            name="rotation_in",
            ros="/{user}/metawear_ros/rotation",
            type="geometry_msgs/msg/QuaternionStamped",
            into=(topics.WRIST,),
            by=wrist.rotation,
            qos=SENSOR,
            rate_hz=200.0,
            about="as imu_in, from the ROS toolkit's driver",
        ),
        InboundRoute(
            name="button_in",
            ros="/{user}/metawear_ros/button",
            type="std_msgs/msg/Bool",
            into=(topics.BUTTON,),
            by=button,
            forgets=button.forget,
            qos=_STREAM,
            about="a person's button: pressed when it becomes true",
        ),
        InboundRoute(
            name="pointing_ray_in",
            ros="/{user}/pointing_ray",
            type="geometry_msgs/msg/PoseStamped",
            into=(topics.RAY,),
            by=Rays(),
            qos=SENSOR,
            rate_hz=200.0,
            frame=PERSON,
            of_guests=True,
            about="the ray of who has ROS nodes only: from the eyes along x",
        ),
        InboundRoute(
            name="subscription_in",
            ros="/PUI_subscription",
            type="conveyor_msgs/msg/PUISubscription",
            into=(topics.INTERACTION, topics.PROFILE),
            by=Subscriptions(),
            qos=_STREAM,
            of_guests=True,
            about="who of them wants a cursor, and of what colour",
        ),
        InboundRoute(
            name="belt_cmd",
            ros="/belt_cmd",
            type="conveyor_msgs/msg/BeltCommand",
            into=(topics.SET_SPEED,),
            by=conveyor.belt_command,
            qos=_STREAM,
            about='speeds of belts, "*": of all',
        ),
        InboundRoute(
            name="feed",
            ros="/feed",
            type="std_msgs/msg/Bool",
            into=(topics.SET_FEEDING,),
            by=conveyor.feed,
            qos=_STREAM,
            rate_hz=10.0,
            about="whether the feeders give packages; belts run on",
        ),
        InboundRoute(
            name="add_package",
            ros="/add_package",
            type="std_msgs/msg/UInt8",
            into=(topics.ADD_PACKAGE,),
            by=conveyor.add_package,
            qos=_STREAM,
            about="put an object of that kind on the first belt",
        ),
    )


def served() -> tuple[ServiceRoute, ...]:
    """Return the services, with new converters."""
    add_pack = conveyor.AddPack()
    return (
        ServiceRoute(
            name="add_pack",
            ros="/add_pack",
            type="conveyor_msgs/srv/AddPack",
            request=topics.ADD_PACKAGE,
            asks=add_pack.asks,
            answers=add_pack.answers,
            qos=SERVICE,
            yields=True,
            has_result=True,
            about="put an object on a belt, under a number of the caller's",
        ),
        ServiceRoute(
            name="set_belt_speed",
            ros="/set_belt_speed",
            type="conveyor_msgs/srv/SetBeltSpeed",
            request=topics.SET_SPEED,
            asks=conveyor.set_belt_speed,
            answers=conveyor.empty("conveyor_msgs/srv/SetBeltSpeed_Response"),
            qos=SERVICE,
            yields=True,
            about="speed of all belts",
        ),
        ServiceRoute(
            name="reset_pack_sim",
            ros="/reset_pack_sim",
            type="std_srvs/srv/Empty",
            request=topics.RESET_CONVEYOR,
            asks=conveyor.reset,
            answers=conveyor.empty("std_srvs/srv/Empty_Response"),
            qos=SERVICE,
            yields=True,
            about="empty the conveyor",
        ),
        ServiceRoute(
            name="set_yaw_origin",
            ros="/{user}/metawear_ros/set_yaw_origin",
            type="std_srvs/srv/Empty",
            request=topics.SET_YAW_ORIGIN,
            asks=conveyor.set_yaw_origin,
            answers=conveyor.empty("std_srvs/srv/Empty_Response"),
            qos=SERVICE,
            yields=True,
            about="the arm points ahead now",
        ),
        ServiceRoute(
            name="set_brightness",
            ros="/set_brightness",
            type="led_strip_msgs/srv/SetBrightness",
            request=topics.SET_BRIGHTNESS,
            asks=conveyor.set_brightness,
            answers=conveyor.empty("led_strip_msgs/srv/SetBrightness_Response"),
            qos=SERVICE,
            yields=True,
            about="dim all strips, or those of some channels",
        ),
    )


class _Sample(NamedTuple):
    wall_ns: int
    sim_ns: int


class SimTimeInput:
    """Publishes the time and speed of a simulation to the site."""

    def __init__(self) -> None:
        self._last: _Sample | None = None
        self._told = _Sample(0, 0)
        self._speed = 1.0
        self._wait_ns = FIRST_NS
        self._count = 0

    def __call__(self, value: Any, about: ConversionContext) -> Taken:
        """Convert a rosgraph_msgs/Clock."""
        now = _Sample(about.wall_ns, int(value.clock.sec) * NS_PER_S + int(value.clock.nanosec))
        if now.sim_ns < 0:
            return (
                ConversionWarning(f"/clock says {now.sim_ns / NS_PER_S:.1f} s: times before 0 are left out"),
            )
        last, self._last = self._last, now
        if last is None or _has_jumped(last, now):
            self._wait_ns = FIRST_NS
            return self._tick(now)
        passed_ns = now.wall_ns - self._told.wall_ns
        if passed_ns < self._wait_ns:
            return ()
        self._wait_ns = TICK_NS
        self._speed = min(max((now.sim_ns - self._told.sim_ns) / passed_ns, SLOWEST), FASTEST)
        return self._tick(now)

    def _tick(self, now: _Sample) -> Taken:
        self._told = now
        self._count += 1
        tick = ClockTick(stamp_ns=now.wall_ns, seq=self._count, sim_ns=now.sim_ns, speed=self._speed)
        return (BusOutput(CLOCK, "", tick),)


def _has_jumped(last: _Sample, now: _Sample) -> bool:
    """Return True if the simulated clock was stepped, or the wall clock was set back."""
    passed_ns, ran_ns = now.wall_ns - last.wall_ns, now.sim_ns - last.sim_ns
    return not 0 <= ran_ns <= JUMP_NS + passed_ns * FASTEST
