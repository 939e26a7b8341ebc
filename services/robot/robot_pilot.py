"""Orders of a robot from its owner, its permitted positions and its stop conditions. Pure."""

import math
from dataclasses import replace

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Environment, Goal, Localization, RobotPhase, Steering, UserPose
from pointit.services.robot.command_planner import (
    HOLDS,
    CommandPlanner,
    RobotOwnership,
    Stage,
    hold_of,
    stage_of,
    verdict_of,
)
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.current_order import CurrentOrder, ProgressMonitor, StandstillMonitor
from pointit.services.robot.figure_flight import FigureFlight
from pointit.services.robot.robot_driver import (
    Command,
    Follow,
    FollowPath,
    Land,
    LinkLost,
    OrderStatus,
    ReportItem,
    RobotReport,
    Stop,
    TakeOff,
    report_fault,
)
from pointit.services.robot.safety.safety import Safety
from pointit.services.robot.stop_reason import Hindrance, StopReason, hindrance_of

MAX_CLAIM_AGE_S = 2.0
"""Maximum age of a user's choice of the robot, and maximum lead of its stamp, s."""
MOVING_MPS = 0.05
"""A slower robot counts as standing, m/s."""
NEAR_M = 0.1
"""A robot that follows is there, and a point of its way is passed, at this distance, m."""


class RobotPilot:
    """Turns what people want of a robot into commands to its driver, as far as safety permits."""

    def __init__(self, config: RobotConfig, name: str, safety: Safety) -> None:
        """Start without any report. The robot gets an order to stop when it reports first."""
        # People's requests, and the commands that they become
        self._config = config
        self._name = name
        self._safety = safety
        self._owners = RobotOwnership(name)
        self._order = CurrentOrder()
        self._planner = CommandPlanner(config, safety, self._owners, self._order)
        self._figure = FigureFlight(config, name)
        self._standstill = StandstillMonitor(config, name)
        self._progress = ProgressMonitor()

        # What the robot has reported
        self.report: RobotReport | None = None
        """Last report that was used, in {W}."""
        self._lost = "nothing has been heard of the robot yet: look whether its driver is connected"
        self._is_expected = True
        """True until the robot has been heard of, or should have been."""
        self._started_ns: int | None = None
        self._since_ns = 0
        """Time of the first report after the last loss. Earlier requests of users are ignored."""

        # What keeps it from moving
        self._cursors: dict[str, Cursor] = {}
        self._stop: StopReason | None = None
        """Reason to stand still; a stop that freed it counts until somebody takes it."""
        self._kind = ""
        self._halts = False
        """True if the driver has to get an order to stop."""
        self._wait = ""
        """That it does not go on along its path, which it has not given up, or `""`."""

    @property
    def user(self) -> str:
        """Return the person who steers it, or `""`."""
        return self._owners.user

    @property
    def reason(self) -> str:
        """Return the reason not to move as asked, or `""`."""
        return self.hindrance.text

    @property
    def hindrance(self) -> Hindrance:
        """Return the reason not to move as asked, with its kind."""
        if self._lost:
            return Hindrance() if self._is_expected else Hindrance("lost", self._lost)
        if self._standstill.problem:
            return Hindrance("moved_away", self._standstill.problem)
        request_problem = self._planner.hindrance
        if request_problem.text and not self.user:  # who asks hears why not, not why others lost it
            return request_problem
        if self._stop is not None:
            return Hindrance(self._stop.kind, self._stop.text)
        if request_problem.text:
            return request_problem
        if self._wait:
            return Hindrance("waiting", self._wait)
        return hindrance_of("no_figure", self._figure.problem)

    @property
    def has_other_master(self) -> bool:
        """Return True while somebody else than PointIt steers it."""
        if self._lost or self._stop is None:
            return False
        return self._stop.kind == "other_master"

    @property
    def goal_ns(self) -> int:
        """Return the stamp of the goal that it carries out, or 0."""
        return self._order.goal_ns

    @property
    def way_m(self) -> tuple[Vec3, ...]:
        """Return the rest of its way from where it is, or nothing."""
        return () if self.report is None else self._order.way_m(self.report.position_m)

    @property
    def phase(self) -> RobotPhase:
        """Return its phase."""
        report = self.report
        command = self._order.command
        stage = self._stage
        if self._lost or self._kind == "report" or report is None:
            return "lost"
        if self._stop is not None and not self.has_other_master:
            return "landed" if stage == "landed" else "stopped"
        if stage in ("landing", "taking_off", "landed"):
            return stage

        # Otherwise it moves on a path, until it is where it follows to, and while it reports a speed
        if stage == "on_path":
            return "moving"
        if isinstance(command, Follow) and math.dist(command.position_m, report.position_m) > NEAR_M:
            return "moving"
        speed_mps = math.hypot(*report.velocity_mps)
        return "moving" if speed_mps > MOVING_MPS else "idle"

    @property
    def _stage(self) -> Stage:
        is_down = False
        if self._config.kind == "quadrotor" and self.report is not None:
            is_down = not self.report.is_flying
        return stage_of(self._order.command, is_down=is_down)

    def on_map(self, environment: Environment) -> None:
        """Update the map."""
        self._safety.on_map(environment)

    def on_presence(self, user: str, *, present: bool) -> None:
        """Update whether a person's services run."""
        self._owners.on_presence(user, present=present)
        self._safety.people.on_presence(user, is_present=present)
        if not present:
            self._cursors.pop(user, None)
            self._figure.on_gone(user)

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update the pose of any person."""
        self._safety.people.on_pose(user, pose)
        self._figure.on_pose(user, pose)

    def on_localizer_end(self, user: str) -> None:
        """Record that a person has no localizer any more."""
        self._figure.on_gone(user)

    def on_localization(self, user: str, localization: Localization) -> None:
        """Update whether a person is localized by following the robot."""
        self._figure.on_localization(user, localization)

    def on_steering(self, user: str, steering: Steering) -> None:
        """Update what a person wants."""
        self._owners.on_steering(user, steering)

    def on_cursor(self, user: str, cursor: Cursor) -> None:
        """Update a person's cursor."""
        self._cursors[user] = cursor
        self._safety.people.on_cursor(user, cursor)

    def on_goal(self, user: str, goal: Goal, now_ns: int) -> None:
        """Accept a goal of the person who steers the robot. Repeated and late goals are ignored."""
        if user == self.user and goal.robot in ("", self._name):
            self._planner.on_goal(user, goal, now_ns)

    def on_item(self, item: ReportItem, now_ns: int) -> str:
        """Store a report of the driver. Return the reason if it is unusable, else `""`."""
        match item:
            case RobotReport():
                return self._on_report(item, now_ns)
            case LinkLost(reason=reason):
                self._lost = reason
                self._is_expected = False
                self._planner.interrupt()
                self._safety.on_link_lost(reason)
            case OrderStatus():
                self._on_status(item)
        return ""

    def on_stop_request(self, reason: str) -> None:
        """Stop it; nobody steers it any longer."""
        self._release(StopReason("person", reason, is_freeing=True))

    def step(self, now_ns: int) -> Command | None:
        """Return the next command to the driver, or None."""
        if self._is_expected:
            if self._started_ns is None:
                self._started_ns = now_ns
            self._is_expected = now_ns - self._started_ns <= self._config.report_timeout_s * NS_PER_S

        # Reasons to halt: a user who lets go, an unsafe place, a robot that moves on, one that does not move
        self._change_owner(now_ns)
        self._apply_safety(now_ns)
        self._halts |= self._moves_without_order(now_ns)
        self._check_progress(now_ns)
        if self._halts:
            self._halts = False
            self._order.drop()
            return Stop(self._order.next())

        # While it is stopped it gets no command
        report = self.report
        is_freed = self._stop is not None and self._stop.is_freeing
        if self._lost or is_freed:
            self._figure.forget()  # of a stop that passes by itself, a quadrotor still has to land
        if self._stop is not None or self._lost or report is None:
            return None

        # A figure if nobody has it, else what its user wants
        if not self.user:
            return self._figure_command(report, now_ns)
        self._figure.forget()
        return self._planner.step(self._stage, report, self._cursors.get(self.user), now_ns)

    def _check_progress(self, now_ns: int) -> None:
        """Release a robot that does not take off or land. One that is held up on a path only waits."""
        command = self._order.command
        problem = self._progress.problem(command, self.report, now_ns)
        is_on_path = isinstance(command, FollowPath)
        self._wait = problem if is_on_path else ""
        if problem and not is_on_path:
            self._release(StopReason("stuck", problem, is_freeing=True))

    def _moves_without_order(self, now_ns: int) -> bool:
        """Return True if it needs another order to stop. A landed quadrotor may be carried."""
        report = self.report
        is_unknown = bool(self._lost) or self._kind in ("report", "jump", "other_master")
        if report is None or is_unknown or self._stage != "resting":
            self._standstill.forget()
            return False
        return self._standstill.is_left(report, now_ns)

    def _figure_command(self, report: RobotReport, now_ns: int) -> Command | None:
        """Return the command to the robot, which nobody steers, for a person who is localized by it."""
        command = self._figure.command(report, self._order, self._safety, now_ns)
        if isinstance(command, Stop):
            self._order.drop()
        elif command is not None:
            self._order.give(command, now_ns)
        return command

    def _apply_safety(self, now_ns: int) -> None:
        stop = self._safety.stop(self.user, self._owners.steering.mode, now_ns)
        self._kind = "" if stop is None else stop.kind
        hold = hold_of(self._stop, self.user)
        change = HOLDS[hold][verdict_of(stop)]
        if change == "release" and stop is not None:
            self._release(stop)
        if change in ("resume", "note", "halt"):
            self._stop = stop
        if change in ("end", "note", "halt"):
            self._planner.interrupt()
        self._halts |= change == "halt"

    def _change_owner(self, now_ns: int) -> None:
        """Release the robot if its user does not want it. Assign it to the first user that may have it."""
        # A user who is localized by it cannot steer it meanwhile
        is_followed = self._kind == "not_pointing" and self.user in self._figure.followers
        if is_followed or self._owners.is_let_go():
            self._free()
        if self.user:
            return

        # Requests count for a short time, and none from before the robot's first report after a loss
        age_ns = round(MAX_CLAIM_AGE_S * NS_PER_S)
        first_ns = max(self._since_ns, now_ns - age_ns)
        last_ns = now_ns + age_ns
        candidate = self._owners.candidate(first_ns, last_ns)
        problem = ""
        if candidate:
            problem = self._lost or self._figure.take_problem(candidate, now_ns)
            problem = problem or self._safety.take_problem(candidate, now_ns)
        else:
            late = self._owners.late(first_ns, last_ns)
            if late:
                problem = f"{late} asked for the robot too long ago, or by another clock: take it again"
        self._planner.hindrance = hindrance_of("not_free", problem)
        if candidate and not problem:
            self._owners.user = candidate
            self._stop = None

    def _free(self) -> None:
        self._owners.free()
        self._end_steering()

    def _release(self, stop: StopReason) -> None:
        """Stop the robot and release it from its user. Only users that choose it again can get it."""
        self._owners.free_of_all()
        self._end_steering()
        self._stop = stop

    def _end_steering(self) -> None:
        self._halts = True
        self._planner.forget()

    def _on_report(self, report: RobotReport, now_ns: int) -> str:
        fault = report_fault(report)
        if fault:
            self._safety.on_link_lost(fault)
            return fault
        problem = self._safety.on_report(report, now_ns)
        if problem:
            return problem
        if self._lost:
            self._since_ns = now_ns
            self._halts = True  # it may still execute an earlier order
        self.report = report
        self._lost = ""
        self._is_expected = False
        passing_m = max(NEAR_M, self._config.radius_m)
        self._order.pass_points(report.position_m, passing_m)
        return ""

    def _on_status(self, status: OrderStatus) -> None:
        """Update the status of the present order. Reports about earlier orders are ignored."""
        command = self._order.end(status)
        if command is None:
            return
        if status.state != "done":
            self._planner.on_failure(command, status.state, status.reason)
        elif isinstance(command, Land):
            self._free()
        elif isinstance(command, TakeOff) and self.report is not None:
            self.report = replace(self.report, is_flying=True)
