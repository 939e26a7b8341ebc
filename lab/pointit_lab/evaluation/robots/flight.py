"""One flight in virtual time: the services' own cores with a simulated person and robot, without a bus.

Person → pointing → cursor → steering → pilot and safety → robot → the person's eyes.
"""

import math
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Feedback, Interaction, Plane, Steering, UserPose
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.robot_steering import Output, RobotSteering
from pointit.services.pointing.pointer import Pointer
from pointit.services.pointing.service import PointingConfig
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.surfaces import Surfaces
from pointit.services.pui.workspace import WorkspaceStart
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.drivers.quadrotor import STEP_S
from pointit.services.robot.drivers.sim_driver import OrderedRobot, SimConfig
from pointit.services.robot.robot_driver import Land, ReportItem, RobotSpec, TakeOff
from pointit.services.robot.robot_messages import RobotMessages
from pointit.services.robot.robot_pilot import RobotPilot
from pointit.services.robot.safety.safety import Safety
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.person import SimulatedPerson
from pointit_lab.evaluation.robots.flight_setup import HEIGHT_M, PLANE_M, RANGE_M, Flight

START_NS = 1_000 * NS_PER_S
STEP_NS = round(STEP_S * NS_PER_S)
ROBOT_STEPS = 2
"""Steps of the robot per sample of the wristband: 50 Hz."""
LIMIT_S = 60.0
"""Time after which a flight has failed."""

MAX_SPEED_MPS, MAX_ACCELERATION_MPS2 = 1.6, 2.0
"""Limits of the robot; recorded speeds reach 1.6 m/s."""
RADIUS_M = 0.1
NEAR_PEOPLE = {"keep_out_m": 0.0, "max_approach_mps": MAX_SPEED_MPS}
"""Parameters of a robot that passes people as in the recordings."""

PERSON, ROBOT = "person", "quadrotor"
FEET_M: Vec3 = (0.0, 0.0, 0.0)
ROOM = Environment(
    stamp_ns=0, name="room", planes=(Plane(id="floor", center_m=FEET_M, normal=(0.0, 0.0, 1.0)),)
)


@dataclass(frozen=True, kw_only=True)
class FlightScore:
    """Result of one flight."""

    simulated_s: float
    error_m: float | None = None
    """Distance from the spot: horizontally where the robot has landed; in space at the person's press. None,
    as the others, if the flight failed."""
    ordered_error_m: float | None = None
    """The same when the landing is ordered."""
    taking_s: float | None = None
    """Time until the person has the robot."""
    time_s: float | None = None
    """Time from then to the end of the steering: the order to land, or the press."""
    detour: float | None = None
    """Flown way, divided by the distance of start and spot; horizontally if it lands."""


def fly(flight: Flight) -> FlightScore:
    """Run `flight` and return its score."""
    world = _World(flight)
    while not world.is_over:
        world.step()
    return world.score()


class _World:
    """A room with a person and a hovering quadrotor."""

    def __init__(self, flight: Flight) -> None:
        person_seed, robot_seed = np.random.SeedSequence(flight.entropy).spawn(2)
        config = UserSimConfig(
            behaviour="fly", spots_m=(flight.spot_m,), position_m=FEET_M, yaw_deg=None, think_s=0.0
        )
        self.now_ns = START_NS
        self._flight = flight
        self._person = SimulatedPerson(config, PERSON, np.random.default_rng(person_seed))
        self._pointer = Pointer(
            stale_after_s=PointingConfig().stale_after_s, one_euro=PointingConfig().smoothing()
        )
        self._cursors = PersonCursor(Surfaces(ROOM, ("plane",)), start=_workspace(flight))
        self._steering = RobotSteering(GoalConfig(steer="robots"), PERSON)
        self._robot = _hovering(flight, int(robot_seed.generate_state(1)[0]))
        self._place_m = flight.start_m
        self._is_flying = True
        self._samples = 0
        self._taken_ns: int | None = None
        self._ended_ns: int | None = None
        self._ordered_error_m: float | None = None
        self._way_m = 0.0
        robot_config = _robot_config(flight)
        self._safety = Safety(robot_config, ROBOT)
        self._pilot = RobotPilot(robot_config, ROBOT, self._safety)
        self._messages = RobotMessages(robot_config, ROBOT, self._pilot)
        self._begin(self._pose())

    @property
    def is_over(self) -> bool:
        """Return True if it has landed, has reached its place in the air, or took too long."""
        return self._has_ended or self.now_ns - START_NS > LIMIT_S * NS_PER_S

    def step(self) -> None:
        """Advance by one sample of the wristband."""
        self.now_ns += ROBOT_STEPS * STEP_NS
        self._move()
        sample, press = self._person.step(self.now_ns)
        ray = None if sample is None else self._pointer.ray(sample, self.now_ns)
        cursor = None if ray is None else self._cursors.cursor(ray)
        if ray is not None:
            self._steering.on_ray(ray)
        if cursor is not None:
            self._pilot.on_cursor(PERSON, cursor)
            self._route(self._steering.on_cursor(cursor, self.now_ns))
        if press is not None:
            if self._is_in_air and self._taken_ns is not None:
                self._end()
            self._route(self._steering.on_button(press, self.now_ns))
        self._pilot_step()

    def score(self) -> FlightScore:
        """Return the score at the end."""
        ended_ns, taken_ns = self._ended_ns, self._taken_ns
        if not self._has_ended or ended_ns is None or taken_ns is None:
            return FlightScore(simulated_s=(self.now_ns - START_NS) / NS_PER_S)
        return FlightScore(
            error_m=self._error_m,
            ordered_error_m=self._ordered_error_m,
            taking_s=(taken_ns - START_NS) / NS_PER_S,
            time_s=(ended_ns - taken_ns) / NS_PER_S,
            detour=self._way_m / self._distance_m(self._flight.start_m),
            simulated_s=(self.now_ns - START_NS) / NS_PER_S,
        )

    @property
    def _is_in_air(self) -> bool:
        return self._flight.condition.workspace is not None

    @property
    def _has_ended(self) -> bool:
        return self._ended_ns is not None and (self._is_in_air or not self._is_flying)

    @property
    def _error_m(self) -> float:
        return self._distance_m(self._place_m)

    def _distance_m(self, place_m: Vec3) -> float:
        gap = vector.subtract(place_m, self._flight.spot_m)
        return vector.norm(gap if self._is_in_air else (gap[0], gap[1], 0.0))

    def _begin(self, pose: UserPose) -> None:
        now_ns = self.now_ns
        interaction = Interaction(stamp_ns=now_ns, state="pointing")
        self._person.see(now_ns, ROOM)
        self._person.see(now_ns, Feedback(stamp_ns=now_ns, cue="started"), PERSON)
        self._pointer.set_yaw(pose.yaw_rad)
        self._cursors.set_pose(pose)
        self._pilot.on_map(ROOM)
        self._pilot.on_presence(PERSON, present=True)
        self._safety.on_pose(PERSON, pose)
        self._safety.on_interaction(PERSON, interaction)
        self._steering.on_map(ROOM)
        self._steering.on_pose(PERSON, pose)
        self._route(self._steering.on_interaction(interaction, now_ns))

    def _move(self) -> None:
        """Move the robot, and report its pose."""
        before_m = self._place_m
        for _ in range(ROBOT_STEPS):
            self._robot.step()
        report = self._robot.report(self.now_ns)
        self._place_m, self._is_flying = report.position_m, report.is_flying
        if self._taken_ns is not None and self._ended_ns is None:
            step = vector.subtract(self._place_m, before_m)
            self._way_m += vector.norm(step if self._is_in_air else (step[0], step[1], 0.0))
        items: list[ReportItem] = [*self._robot.take_statuses(), report]
        for item in items:
            self._pilot.on_item(item, self.now_ns)

    def _pilot_step(self) -> None:
        command = self._pilot.step(self.now_ns)
        if command is not None:
            self._robot.command(command)
        if self._pilot.user and self._taken_ns is None:
            self._taken_ns = self.now_ns
        if isinstance(command, Land):
            self._end()
        state = self._messages.state(self.now_ns)
        if state is not None:
            self._person.see(self.now_ns, state, ROBOT)
            self._route(self._steering.on_robot(ROBOT, state, self.now_ns))

    def _route(self, outputs: list[Output]) -> None:
        """Deliver what the steering says; its goals are for ground robots."""
        for output in outputs:
            if isinstance(output, Feedback):
                self._person.see(self.now_ns, output, PERSON)
            elif isinstance(output, Steering):
                self._pilot.on_steering(PERSON, output)

    def _end(self) -> None:
        if self._ended_ns is None:
            self._ended_ns = self.now_ns
            self._ordered_error_m = self._error_m

    def _pose(self) -> UserPose:
        """Return the pose by which the rays are placed, with its stated errors."""
        condition = self._flight.condition
        x_m, y_m, turn_rad = self._flight.pose_off
        variance_m2, variance_rad2 = condition.position_sigma_m**2, math.radians(condition.yaw_sigma_deg) ** 2
        return UserPose(
            stamp_ns=START_NS,
            position_m=(FEET_M[0] + x_m, FEET_M[1] + y_m, FEET_M[2]),
            yaw_rad=self._person.yaw_rad + turn_rad,
            covariance=(variance_m2, 0.0, 0.0, 0.0, variance_m2, 0.0, 0.0, 0.0, variance_rad2),
        )


def _robot_config(flight: Flight) -> RobotConfig:
    config = RobotConfig(
        kind="quadrotor",
        start_m=(flight.start_m[0], flight.start_m[1], 0.0),
        radius_m=RADIUS_M,
        hover_m=flight.condition.hover_m or HEIGHT_M,
        max_speed_mps=MAX_SPEED_MPS,
        max_acceleration_mps2=MAX_ACCELERATION_MPS2,
    )
    return config if flight.condition.keeps_away else config.model_copy(update=NEAR_PEOPLE)


def _hovering(flight: Flight, seed: int) -> OrderedRobot:
    """Return a quadrotor that hovers at the start of `flight`."""
    config = _robot_config(flight)
    spec = RobotSpec(
        name=ROBOT,
        kind=config.kind,
        start_m=config.start_m,
        start_yaw_rad=0.0,
        radius_m=config.radius_m,
        hover_m=config.hover_m,
        max_speed_mps=config.max_speed_mps,
        max_acceleration_mps2=config.max_acceleration_mps2,
    )
    robot = OrderedRobot(SimConfig(seed=seed), spec)
    robot.command(TakeOff(0, flight.start_m[2]))
    while not any(status.state == "done" for status in robot.take_statuses()):
        robot.step()
    return robot


def _workspace(flight: Flight) -> WorkspaceStart:
    return WorkspaceStart(kind=flight.condition.workspace, height_m=PLANE_M, distance_m=RANGE_M)
