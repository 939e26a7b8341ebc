"""Commands to a robot for the person who owns it, and its actions as a table. Pure."""

from collections.abc import Mapping
from typing import Literal

from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor, Goal, Steering
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.current_order import CurrentOrder
from pointit.services.robot.robot_driver import Command, Follow, FollowPath, Land, RobotReport, Stop, TakeOff
from pointit.services.robot.safety.safety import Safety
from pointit.services.robot.stop_reason import Hindrance, StopReason, hindrance_of

Stage = Literal["landed", "taking_off", "landing", "following", "on_path", "resting"]
"""Activity. `landed`: a quadrotor on the ground; `resting`: it has no order, or one to stop."""

Mode = Literal["none", "follow", "goals", "land"]
"""Wish of its person, as in `Steering`."""

Action = Literal["wait", "take off", "follow", "go", "land", "stay", "stop", "let go"]
"""`go`: drive to the pending goal, if any. `stay`: stop. `let go`: release the robot."""
Hold = Literal["none", "kept", "passing", "freed"]
"""Reason to stand. Its user keeps it, or it has no user until the reason ends or a user chooses it."""

Verdict = Literal["safe", "hold", "free", "other_master"]
"""Result of the safety checks."""

Change = Literal["-", "resume", "end", "note", "halt", "release"]
"""`end` ends the order. `note` ends it and stores the new reason. `halt` does both and stops the robot.
`release` stops the robot and takes it from its user: all who want it must name it again."""

NOTHING = Steering(stamp_ns=0)
ACTIONS: Mapping[Stage, Mapping[Mode, Action]] = {
    "landed": {"none": "wait", "follow": "take off", "goals": "take off", "land": "let go"},
    "taking_off": {"none": "wait", "follow": "wait", "goals": "wait", "land": "wait"},
    "landing": {"none": "stop", "follow": "stop", "goals": "stop", "land": "land"},
    "following": {"none": "stay", "follow": "follow", "goals": "stay", "land": "land"},
    "on_path": {"none": "stay", "follow": "follow", "goals": "go", "land": "land"},
    "resting": {"none": "wait", "follow": "follow", "goals": "go", "land": "land"},
}
HOLDS: Mapping[Hold, Mapping[Verdict, Change]] = {
    "none": {"safe": "-", "hold": "halt", "free": "release", "other_master": "release"},
    "kept": {"safe": "resume", "hold": "note", "free": "release", "other_master": "release"},
    "passing": {"safe": "resume", "hold": "note", "free": "note", "other_master": "note"},
    "freed": {"safe": "-", "hold": "end", "free": "end", "other_master": "note"},
}

PASSING = ("report", "other_master")  # kinds of stops that free the robot and pass by themselves

ANSWER_S = 3.0
"""Time without an answer to an order after which a robot is reported as silent, s."""

MAX_GOAL_AGE_S = 2.0
"""Maximum age of a goal, and maximum lead of its stamp, s."""

UNREACHABLE = "the robot cannot go where you point: point at the floor"

WORKSPACE = "workspace/"
"""Beginning of the ids of surfaces about a person."""

MAX_STEP_M = 0.3
"""Height over or under a ground robot up to which a place is on its floor: ramps are, tables are not, m."""


class RobotOwnership:
    """The one person who steers a robot, and those who want to."""

    def __init__(self, robot: str) -> None:
        self.user = ""
        """Person who steers it, or `""`."""
        self._robot = robot
        self._steerings: dict[str, Steering] = {}
        self._claims: dict[str, int] = {}
        """People who name the robot, the first one first, since when, ns; 0: they must name it again."""
        self._present: set[str] = set()

    @property
    def steering(self) -> Steering:
        """Return the wish of the person who steers it."""
        return self._steerings.get(self.user, NOTHING)

    def on_steering(self, user: str, steering: Steering) -> None:
        """Update what a person wants."""
        self._steerings[user] = steering
        if steering.robot == self._robot:
            self._claims.setdefault(user, steering.stamp_ns)
        else:
            self._claims.pop(user, None)

    def on_presence(self, user: str, *, present: bool) -> None:
        """Update whether a person is there. Who leaves has let go of the robot."""
        if present:
            self._present.add(user)
        else:
            self._present.discard(user)
            self._claims.pop(user, None)
            self._steerings.pop(user, None)

    def is_let_go(self) -> bool:
        """Return True if the person who steers it wants that no longer, or is gone."""
        if not self.user:
            return False
        return self.user not in self._claims or self.user not in self._present

    def candidate(self, first_ns: int, last_ns: int) -> str:
        """Return the first person who has begun to name it between these times, or `""`."""
        for user in self._requesting_users():
            if first_ns <= self._claims[user] <= last_ns:
                return user
        return ""

    def late(self, first_ns: int, last_ns: int) -> str:
        """Return a person whose request was not granted, and is not between these times, or `""`."""
        for user in self._requesting_users():
            if not first_ns <= self._claims[user] <= last_ns:
                return user
        return ""

    def free(self) -> None:
        """Release the robot from its user, who must choose it again."""
        if self.user in self._claims:
            self._claims[self.user] = 0
        self.user = ""

    def free_of_all(self) -> None:
        """Release the robot from its user. All requesting users must choose it again."""
        self._claims = dict.fromkeys(self._claims, 0)
        self.user = ""

    def _requesting_users(self) -> list[str]:
        users: list[str] = []
        for user, since_ns in self._claims.items():
            if since_ns and user in self._present:
                users.append(user)
        return users


def stage_of(command: Command | None, *, is_down: bool) -> Stage:
    """Return the stage of a robot with this order; `is_down`: it is a quadrotor on the ground."""
    match command:
        case TakeOff():
            return "taking_off"
        case Land():
            return "landing"
        case _ if is_down:
            return "landed"
        case Follow():
            return "following"
        case FollowPath():
            return "on_path"
        case _:
            return "resting"


def hold_of(stop: StopReason | None, user: str) -> Hold:
    """Return the effect of `stop` on a robot that `user` has, or nobody, `""`."""
    if stop is None:
        return "none"
    if not stop.is_freeing:
        return "kept" if user else "passing"
    return "passing" if stop.kind in PASSING else "freed"


def verdict_of(stop: StopReason | None) -> Verdict:
    """Return the result of safety checks with the reason `stop`."""
    if stop is None:
        return "safe"
    if stop.kind == "other_master":
        return "other_master"
    return "free" if stop.is_freeing else "hold"


class CommandPlanner:
    """Makes the commands of the table of actions, as far as safety permits."""

    def __init__(
        self, config: RobotConfig, safety: Safety, owners: RobotOwnership, order: CurrentOrder
    ) -> None:
        self._config = config
        self._safety = safety
        self._owners = owners
        self._order = order
        self._is_flying_kind = config.kind == "quadrotor"
        self._goal_ns: dict[str, int] = {}
        """Stamps of the last goals by person."""
        self._goal: Goal | None = None
        """Goal that waits until the robot can go."""
        self._refused: tuple[str, Vec3 | None] | None = None
        """Mode and place of steering that the robot refused: it is not asked again."""
        self.hindrance = Hindrance()
        """Reason not to do what it is asked for."""

    def on_goal(self, user: str, goal: Goal, now_ns: int) -> None:
        """Accept a goal of the person who steers the robot. Repeated and late goals are ignored."""
        if goal.stamp_ns <= self._goal_ns.get(user, 0):
            return
        age_s = (now_ns - goal.stamp_ns) / NS_PER_S
        if age_s < -MAX_GOAL_AGE_S:
            text = f"the goal is {-age_s:.1f} s ahead of the robot's clock: synchronize the clocks"
            self.hindrance = Hindrance("goal_early", text)
            return
        self._goal_ns[user] = goal.stamp_ns
        if age_s > MAX_GOAL_AGE_S:
            text = f"the goal came {age_s:.1f} s late: point there again, and look for a slow link"
            self.hindrance = Hindrance("goal_late", text)
        else:
            self._goal = goal

    def on_failure(self, command: Command, state: str, reason: str) -> None:
        """Record that the robot has not executed `command`."""
        explanation = f": {reason}" if reason else ""
        text = f"the robot has {state} its order{explanation}; point there again, or elsewhere"
        self.hindrance = Hindrance("refused", text)
        if not isinstance(command, FollowPath):
            steering = self._owners.steering
            self._refused = (steering.mode, steering.target_m)

    def interrupt(self) -> None:
        """End the order, and forget the goal."""
        self._goal = None
        self._order.drop()

    def forget(self) -> None:
        """End the order and all that was wanted."""
        self.interrupt()
        self._refused = None
        self.hindrance = Hindrance()

    def step(self, stage: Stage, report: RobotReport, cursor: Cursor | None, now_ns: int) -> Command | None:
        """Return the command that starts or continues the request of the robot's user."""
        silent_s = self._order.unanswered_s(now_ns)
        if silent_s > ANSWER_S:
            text = f"the robot has not answered its order for {silent_s:.0f} s: look at its driver"
            self.hindrance = Hindrance("unanswered", text)
        command = self._next_command(stage, report, cursor, now_ns)
        if command is not None:
            goal_ns = 0
            if isinstance(command, FollowPath):
                goal_ns = self._goal_ns.get(self._owners.user, 0)
            self._order.give(command, now_ns, goal_ns)
        return command

    def _next_command(
        self, stage: Stage, report: RobotReport, cursor: Cursor | None, now_ns: int
    ) -> Command | None:
        steering = self._owners.steering
        action = ACTIONS[stage][steering.mode]
        self._forget_outdated(stage, steering)

        # To land a ground robot is to let go of it
        if action == "land" and self._config.kind == "ground":
            action = "let go"
        if action == "let go":
            self._owners.free()
            self.forget()
            action = "stop"

        # An order to stop is given whatever it has refused
        if action == "stop":
            return Stop(self._order.next())
        if self._refused is not None or action == "wait":
            return None
        match action:
            case "take off":
                return TakeOff(self._order.next(), self._config.hover_m)
            case "follow":
                return self._follow_cursor(report, cursor, now_ns)
            case "go":
                return self._go_to_goal(report, now_ns)
            case "land":
                return self._land_at(steering.target_m, report)
            case _:
                return self._stay(Hindrance())

    def _forget_outdated(self, stage: Stage, steering: Steering) -> None:
        """Forget the refusal of another request, and a goal, which waits for the take-off only."""
        if self._refused != (steering.mode, steering.target_m):
            self._refused = None
        if steering.mode != "goals" and stage != "taking_off":
            self._goal = None

    def _stay(self, reason: Hindrance) -> Command | None:
        """Return the command by which it stays where it is, if it does not already."""
        self.hindrance = reason
        command = self._order.command
        if command is None or isinstance(command, Stop):
            return None
        return Stop(self._order.next())

    def _follow_cursor(self, report: RobotReport, cursor: Cursor | None, now_ns: int) -> Command | None:
        target = None if cursor is None else self._target(cursor, report.position_m)
        if target is None:
            return self._stay(Hindrance("unreachable", UNREACHABLE))
        set_point = self._safety.set_point(self._owners.user, target, now_ns)
        self.hindrance = hindrance_of("limited", set_point.problem)
        return Follow(self._order.next(), set_point.position_m, None, set_point.max_speed_mps)

    def _go_to_goal(self, report: RobotReport, now_ns: int) -> Command | None:
        """Return the command to the pending goal, if it is permitted. It is tried once."""
        goal = self._goal
        self._goal = None
        if goal is None:
            return None
        here_m = report.position_m
        goal_points = (*goal.via_m, goal.position_m)
        if not all(self._is_reachable(point, here_m) for point in goal_points):
            self.hindrance = Hindrance("unreachable", UNREACHABLE)
            return None
        points = tuple(self._above(point, here_m) for point in goal_points)
        user = self._owners.user
        problem = self._safety.target_problem(user, points, now_ns, sigma_m=goal.position_sigma_m)
        self.hindrance = hindrance_of("limited", problem)
        if problem:
            return None
        speed_mps = self._safety.speed_limit_mps((here_m, *points))
        return FollowPath(self._order.next(), points, goal.yaw_rad, speed_mps)

    def _land_at(self, place_m: Vec3 | None, report: RobotReport) -> Command | None:
        """Return the command to land at `place_m`, or where it is, if it does not land there already."""
        command = self._order.command
        if isinstance(command, Land) and command.position_m == place_m:
            return None

        # Only the way is checked, not the arm: one that is lowered ends no landing
        speed_mps = None
        if place_m is not None:
            way = (self._above(place_m, report.position_m), place_m)
            problem = self._safety.way_problem(way)
            if problem:
                self._refused = ("land", place_m)
                return self._stay(Hindrance("limited", problem))
            speed_mps = self._safety.speed_limit_mps(way)
        self.hindrance = Hindrance()
        return Land(self._order.next(), place_m, speed_mps)

    def _target(self, cursor: Cursor, here_m: Vec3) -> Vec3 | None:
        """Return where the robot, now at `here_m`, is to go, or None if it cannot go where `cursor` is.

        A quadrotor hovers above level places, a ground robot goes to no others.
        """
        point = cursor.point_m
        if point is None or not self._is_reachable(point, here_m):
            return None
        is_in_workspace = cursor.surface_id.startswith(WORKSPACE)
        if not self._safety.people.is_on_level(cursor):
            return point if self._is_flying_kind and is_in_workspace else None

        # A level place above the eyes is a ceiling
        is_below_eyes = cursor.origin_m is None or point[2] < cursor.origin_m[2]
        if not is_below_eyes and not is_in_workspace:
            return None
        return self._above(point, here_m)

    def _is_reachable(self, point_m: Vec3, here_m: Vec3) -> bool:
        """Return True unless a ground robot at `here_m` cannot get up or down to `point_m`."""
        return self._is_flying_kind or abs(point_m[2] - here_m[2]) <= MAX_STEP_M

    def _above(self, point_m: Vec3, here_m: Vec3) -> Vec3:
        """Return where the robot is to be for a place on the ground. A ground robot stays at its height."""
        height_m = here_m[2]
        if self._is_flying_kind:
            height_m = point_m[2] + self._config.hover_m
        return (point_m[0], point_m[1], height_m)
