"""Steering of robots by one person: choose one, take it, let it follow or send it, land it, let it go.

The robot decides whom it obeys (`RobotState.user`). A person asks for at most one robot at a time.
"""

from collections import deque
from typing import Literal, NamedTuple

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import RefusedError
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    Cursor,
    Environment,
    Feedback,
    Goal,
    Interaction,
    PointingRay,
    RobotState,
    Steering,
    UserPose,
)
from pointit.schemas.cues import Cue
from pointit.schemas.expiring_dict import ExpiringDict
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.goal_checker import GoalChecker, floor_distance_m
from pointit.services.goal.goal_confirmation import MAX_PRESS_S, CueFactory, is_late
from pointit.services.goal.robot_choice import ChosenRobot, RobotChoice
from pointit.services.goal.stay_detector import StayDetector, cursor_order

Output = Goal | Feedback | Steering

ANSWER_NS = 3 * NS_PER_S
"""Time within which a robot answers a request, or a goal."""
DECIDED_NS = NS_PER_S // 2
"""Time after a request from which a reason given by the robot is its answer."""
REPORTED_NS = 2 * NS_PER_S
"""Minimum time between two reasons that the person receives: numbers in them change."""
ARRIVED_M = 0.3
"""Distance from a goal within which a robot has arrived."""

HOW: dict[str, str] = {
    "quadrotor": "it takes off and follows where you point; press to land it there",
    "ground": "stay at places to set way-points, then press to send it",
}
MAX_ROBOT_AGE_NS = 2 * NS_PER_S
"""Time without a report of a robot's process after which its user loses it and no user can choose it, s."""
TICK_NS = NS_PER_S // 5
"""Time between two checks for missing answers."""
LAND_BEFORE_S = (0.6, 0.1)
"""Part of the past before a press whose mean cursor is the landing place: pressing moves the arm."""
MAX_WAYPOINTS = 32
"""Largest number of way-points of one path."""


class RobotCue(NamedTuple):
    """A cue for the person."""

    cue: Cue
    text: str
    ends: bool = False
    """True if the person has the robot no longer."""
    sign_of: Cue | None = None
    place_m: Vec3 | None = None


class TakenRobot:
    """Follows the states of one robot for one person."""

    def __init__(self, name: str, user: str, now_ns: int) -> None:
        """Start with the request of `user` for `name` at `now_ns`."""
        self.name = name
        self.is_owner = False
        """True once the robot has accepted the person."""
        self.checked_ns = now_ns
        self._user = user
        self._since_ns = now_ns
        self._reason = ""
        """Reason that was reported last, or that the robot had when it accepted the person."""
        self._untold_since_ns: int | None = None
        """Time of the acceptance while `_reason` was not reported, or None."""
        self._reported_ns = 0
        self._goal: Goal | None = None
        """Goal that was sent and has no result yet."""
        self._sent_ns = 0
        self._is_going = False

    def on_goal(self, goal: Goal, now_ns: int) -> None:
        """Wait for the result of `goal`, which replaces the previous one."""
        self._goal = goal
        self._sent_ns = now_ns
        self._is_going = False

    def on_state(
        self, state: RobotState, mode: Literal["none", "follow", "goals", "land"], now_ns: int
    ) -> RobotCue | None:
        """Return the cue for a state of the robot while the person wants `mode` of it, if there is any."""
        # Its answer, or the end of the person's control: a quadrotor that has landed is let go
        if not self.is_owner:
            return self._answer(state, now_ns)
        has_landed = state.phase == "landed" and mode == "land"
        if has_landed:
            return RobotCue("selected", f"{self.name} has landed", True, "localized", state.position_m)
        if state.user != self._user:
            reason = state.reason
            if not reason:
                reason = "somebody stopped it, or you were not heard of; point at it and take it again"
            return RobotCue("deselected", f"{self.name} is no longer yours: {reason}", ends=True)

        # A new reason why it does not do what the person wants, a first one that lasts, or its arrival
        is_new = state.reason != self._reason
        if is_new:
            self._untold_since_ns = None
        lasts = self._untold_since_ns is not None and now_ns - self._untold_since_ns >= REPORTED_NS
        is_due = is_new or lasts
        if state.reason and is_due:
            if now_ns - self._reported_ns < REPORTED_NS:
                return None
            self._reason = state.reason
            self._untold_since_ns = None
            self._reported_ns = now_ns
            if state.phase != "moving":
                self._goal = None
            return RobotCue("refused", f"{self.name}: {state.reason}", place_m=state.target_m)
        self._reason = state.reason
        return self._arrival(state)

    def tick(self, now_ns: int, *, is_silent: bool) -> RobotCue | None:
        """Return the cue for a missing answer, if one is overdue."""
        if is_silent:
            text = f"{self.name} is lost: it reports nothing; see that its process runs"
            return RobotCue("deselected" if self.is_owner else "refused", text, ends=True)
        if not self.is_owner and now_ns - self._since_ns > ANSWER_NS:
            text = f"{self.name} does not answer: see that it runs, and take it again"
            return RobotCue("refused", text, ends=True)
        is_goal_pending = self._goal is not None and not self._is_going
        if is_goal_pending and now_ns - self._sent_ns > ANSWER_NS:
            self._goal = None
            return RobotCue("refused", f"{self.name} has not taken the goal: set its way-points again")
        return None

    def _answer(self, state: RobotState, now_ns: int) -> RobotCue | None:
        """Return the cue for the robot's answer to the request of the person, or None before it."""
        if state.user == self._user:
            self.is_owner = True
            # What it is waiting for as it accepts, such as an arm that still points at it, may pass at once
            self._reason = state.reason
            self._untold_since_ns = now_ns if state.reason else None
            return RobotCue("selected", f"{self.name} is yours: {HOW[state.kind]}", place_m=state.position_m)
        if state.user:
            text = f"{self.name} is steered by {state.user}: wait until it is free, or point at another robot"
            return RobotCue("refused", text, ends=True)
        if state.reason and now_ns - self._since_ns > DECIDED_NS:
            return RobotCue("refused", f"{self.name}: {state.reason}", ends=True)
        return None

    def _arrival(self, state: RobotState) -> RobotCue | None:
        """Return the cue for the end of the robot's way to its goal, or None before it."""
        goal = self._goal
        if goal is None:
            return None
        is_on_its_way = state.goal_ns == goal.stamp_ns
        if is_on_its_way:
            self._is_going = True
        if not self._is_going:
            return None
        if is_on_its_way and state.phase != "idle":
            return None
        remaining_m = floor_distance_m(state.position_m, goal.position_m)
        self._goal = None
        if remaining_m <= ARRIVED_M:
            return RobotCue(
                "selected", f"{self.name} has arrived", sign_of="localized", place_m=state.position_m
            )
        return RobotCue("refused", f"{self.name} stopped {remaining_m:.1f} m before its goal: send it again")


class RobotSteering:
    """Turns the pointing and the button of one person into steering, goals and cues."""

    def __init__(self, config: GoalConfig, user: str) -> None:
        self._config = config
        self._user = user
        self._checker = GoalChecker(config, user)
        self._choice = RobotChoice(config.take, config.dwell_s)
        self._stays = StayDetector(config.radius_m, config.dwell_s)
        self._robots = ExpiringDict[str, RobotState](MAX_ROBOT_AGE_NS)
        """Newest state of each robot."""
        self._taken: TakenRobot | None = None
        self._mode: Literal["none", "follow", "goals", "land"] = "none"
        self._landing_m: Vec3 | None = None
        self._waypoints: list[Vec3] = []
        self._requested_m: Vec3 | None = None
        """Place to which the robot is sent as soon as it obeys the person, or None."""
        self._places: deque[tuple[int, Vec3, str]] = deque()
        """Stamp, place and surface of the cursors from `LAND_BEFORE_S` before the longest press on."""
        self._cursor: Cursor | None = None
        self._pointing_since_ns = 0
        self._published: Steering | None = None
        self._cues = CueFactory()
        self._goals = 0

    @property
    def robot(self) -> str:
        """Return the robot that the person has, or has asked for, or `""`."""
        return "" if self._taken is None else self._taken.name

    @property
    def deadline_ns(self) -> int | None:
        """Return the latest time for the next `tick`, or None if no robot has to answer."""
        return None if self._taken is None else self._taken.checked_ns + TICK_NS

    def on_map(self, environment: Environment) -> None:
        """Update the map."""
        self._checker.on_map(environment)

    def on_pose(self, user: str, pose: UserPose) -> None:
        """Update the pose of `user`, who may be any person."""
        self._checker.on_pose(user, pose)
        if user == self._user:
            self._choice.on_pose(pose)

    def on_ray(self, ray: PointingRay) -> None:
        """Process a ray of the person."""
        self._choice.on_ray(ray)

    def on_interaction(self, interaction: Interaction, now_ns: int) -> list[Output]:
        """Update the person's interaction. The end of pointing lets robots go, a lamp only quadrotors."""
        was_pointing = self._checker.is_pointing
        self._checker.on_interaction(interaction)
        if self._checker.is_pointing:
            if not was_pointing:
                self._pointing_since_ns = interaction.stamp_ns
            return self._with_steering([], now_ns)
        if interaction.state == "localizing" and self._mode == "goals":
            return self._with_steering([], now_ns)
        cues: list[Output] = []
        if self._taken is not None and self._taken.is_owner:
            text = f"{self._taken.name} is let go, as you stopped pointing: it stays where it is"
            cues = [self._cues.make("deselected", text, now_ns)]
        self._release()
        self._choice.reset()
        return self._with_steering(cues, now_ns)

    def on_robot(self, name: str, state: RobotState, now_ns: int) -> list[Output]:
        """Process the state of a robot."""
        self._robots.put(name, state, now_ns)
        self._choice.on_robot(name, state)
        if self._taken is None or self._taken.name != name:
            return []
        has_just_begun = abs(now_ns - self._pointing_since_ns) <= DECIDED_NS
        if has_just_begun or not self._checker.is_pointing:  # its reason is that of an earlier pointing
            return []
        cue = self._taken.on_state(state, self._mode, now_ns)
        outputs = self._on_robot_cue(cue, now_ns)
        if self._requested_m is not None and self._is_owner:
            outputs += self._with_steering(self._send_requested(now_ns), now_ns)
        return outputs

    def on_cursor(self, cursor: Cursor, now_ns: int) -> list[Output]:
        """Process a cursor. Cursors out of order are ignored."""
        outputs = self.tick(now_ns)
        order = cursor_order(self._cursor, cursor)
        if order == "late":
            return outputs
        if order == "gap":
            self._stays.interrupt()
            self._places.clear()
        self._cursor = cursor

        # Places for the landing by a press that is reported later
        place_m = self._checker.place(cursor)
        if place_m is None:
            self._places.clear()
        else:
            self._places.append((cursor.stamp_ns, place_m, cursor.surface_id))
            oldest_ns = cursor.stamp_ns - (MAX_PRESS_S + LAND_BEFORE_S[0]) * NS_PER_S
            while self._places[0][0] < oldest_ns:
                self._places.popleft()
        mean_m = self._stays.on_cursor(place_m, cursor.surface_id, cursor.stamp_ns)

        # Without a robot the person chooses one, with one they set way-points
        if self._taken is None and self._checker.is_pointing:
            choice = self._choice.step(now_ns)
            if choice is not None:
                outputs += self._on_choice(choice, now_ns)
        elif mean_m is not None and self._mode == "goals" and self._is_owner:
            outputs += self._add_waypoint(mean_m, cursor, now_ns)
        return self._with_steering(outputs, now_ns)

    def on_button(self, event: ButtonEvent, now_ns: int) -> list[Output]:
        """Process a gesture: a press takes a robot, lands it or sends it. Others are the supervisor's."""
        outputs = self.tick(now_ns)
        is_ours = event.gesture == "press" and self._checker.is_pointing
        if not is_ours or event.stamp_ns <= self._pointing_since_ns:  # that press began the pointing
            return outputs
        if is_late(event, now_ns, self._config.max_age_s):
            late = "your press came late, or by another clock: point there and press once more"
            outputs.append(self._cues.make("refused", late, now_ns))
        elif self._taken is None:
            outputs += self._on_choice(self._choice.press(now_ns), now_ns)
        elif not self._is_owner or self._mode == "land":
            pass  # the robot has yet to answer
        elif self._mode == "follow":
            outputs += self._land(event.stamp_ns, now_ns)
        elif self._waypoints:
            outputs += self._send_goal(now_ns)
        else:
            outputs += self._change_robot(now_ns)
        return self._with_steering(outputs, now_ns)

    def send(self, robot: str, place_m: Vec3, now_ns: int) -> list[Output]:
        """Send `robot`, or the one that the person has, to a place as they ask, with all checks.

        One that they do not have is taken first, and sent once it obeys them.

        Raises:
            RefusedError: If a check fails. Gives the reason.
        """
        # A robot that can be sent there
        name = robot or self.robot
        if name not in self._robots:
            hint = "no robot reports its place"
            if self._robots:
                hint = nearest(name, sorted(self._robots))
            problem = f"there is no robot {name!r}" if name else "say which robot"
            raise RefusedError(f"{problem}; {hint}")
        state = self._robots[name]
        if state.kind == "quadrotor":
            raise RefusedError(f"{name} is not sent: take it by pointing, it follows where you point")
        reason = self._request_problem(name, place_m, now_ns)
        if reason:
            raise RefusedError(reason)

        # At once if it obeys the person, else it is taken first
        if name == self.robot and self._is_owner:
            self._waypoints = [place_m]
            return self._with_steering(self._send_goal(now_ns), now_ns)
        self._release()
        outputs = self._take_robot(name, now_ns)
        if self._taken is None:
            texts = [output.text for output in outputs if isinstance(output, Feedback)]
            raise RefusedError("".join(texts))
        self._requested_m = place_m
        return self._with_steering(outputs, now_ns)

    def _request_problem(self, name: str, place_m: Vec3, now_ns: int) -> str:
        """Return the reason not to send the robot `name` to a place, or `""`."""
        other = self._robot_at(place_m)
        if other and other != name:
            return f"{other} stands there: choose another place"
        return self._checker.request_problem(place_m, self._cursor, now_ns)

    def _send_requested(self, now_ns: int) -> list[Output]:
        """Send the robot to the place requested before it obeyed the person, checked once more."""
        place_m = self._requested_m
        self._requested_m = None
        if place_m is None:
            return []
        reason = self._request_problem(self.robot, place_m, now_ns)
        if reason:
            return [self._cues.make("refused", reason, now_ns, place_m)]
        self._waypoints = [place_m]
        return self._send_goal(now_ns)

    def tick(self, now_ns: int) -> list[Output]:
        """Advance to `now_ns`: robots that fall silent are not waited for."""
        for name in self._robots.expire(now_ns):
            self._choice.forget(name)
        if self._taken is None:
            return self._with_steering([], now_ns)
        self._taken.checked_ns = now_ns
        is_silent = self._taken.name not in self._robots
        cue = self._taken.tick(now_ns, is_silent=is_silent)
        return self._on_robot_cue(cue, now_ns)

    @property
    def _is_owner(self) -> bool:
        """Return True if the person points, and a robot obeys them."""
        if self._taken is None or not self._checker.is_pointing:
            return False
        return self._taken.is_owner

    def _on_choice(self, choice: ChosenRobot, now_ns: int) -> list[Output]:
        """Request the robot that is meant, or return a cue if that is unclear."""
        if choice.robot:
            return self._take_robot(choice.robot, now_ns)
        return [self._cues.make("refused", choice.problem, now_ns)]

    def _change_robot(self, now_ns: int) -> list[Output]:
        """Choose another robot instead of one without a path, if the person clearly points at one."""
        choice = self._choice.press(now_ns)
        self._choice.reset()
        if choice.robot and choice.robot != self.robot:
            self._release()
            return self._take_robot(choice.robot, now_ns)
        text = (
            f"{self.robot} has no way-point yet: stay at a place for {self._config.dwell_s:g} s, then press"
        )
        return [self._cues.make("refused", text, now_ns)]

    def _take_robot(self, name: str, now_ns: int) -> list[Output]:
        """Request a robot for the person. Return a cue if it cannot be requested now."""
        state = self._robots[name]
        text = self._checker.unsure_reason
        if not text and state.user not in ("", self._user):
            text = f"{name} is steered by {state.user}: wait until it is free, or point at another robot"
        if text:
            return [self._cues.make("refused", text, now_ns, state.position_m)]
        self._taken = TakenRobot(name, self._user, now_ns)
        self._mode = "follow" if state.kind == "quadrotor" else "goals"
        self._choice.reset()
        self._bar_stays()
        return []

    def _on_robot_cue(self, robot_cue: RobotCue | None, now_ns: int) -> list[Output]:
        """Release the robot if a cue ends its steering. Return the cue with its number."""
        if robot_cue is None:
            return self._with_steering([], now_ns)
        if robot_cue.ends:
            self._release()
        elif self._mode == "land" and robot_cue.cue == "refused":
            # so that another place can be pointed at
            self._mode = "follow"
            self._landing_m = None
        cue = self._cues.make(
            robot_cue.cue, robot_cue.text, now_ns, robot_cue.place_m, sign_of=robot_cue.sign_of
        )
        return self._with_steering([cue], now_ns)

    def _land(self, pressed_ns: int, now_ns: int) -> list[Output]:
        """Land the quadrotor at the mean place just before a press, or at all later ones if there is none."""
        cursor = self._cursor
        first_ns, last_ns = (pressed_ns - round(before_s * NS_PER_S) for before_s in LAND_BEFORE_S)
        places_m: list[Vec3] = []
        places_before_m: list[Vec3] = []
        for stamp_ns, place_m, surface_id in self._places:
            if cursor is None or stamp_ns < first_ns:
                continue
            if surface_id != cursor.surface_id:
                continue
            places_m.append(place_m)
            if stamp_ns <= last_ns:
                places_before_m.append(place_m)
        if cursor is None or not places_m:
            text = "no robot lands there: point at the floor as you press"
            return [self._cues.make("refused", text, now_ns)]

        # The same checks as of any goal
        landing_m = _mean(places_before_m or places_m)
        reason = self._checker.rejection_reason(landing_m, cursor, now_ns)
        if reason:
            return [self._cues.make("refused", reason, now_ns, landing_m)]
        self._mode = "land"
        self._landing_m = landing_m
        return [self._cues.make("selected", f"{self.robot} lands there", now_ns, landing_m)]

    def _add_waypoint(self, place_m: Vec3, cursor: Cursor, now_ns: int) -> list[Output]:
        other = self._robot_at(place_m)
        reason = self._checker.rejection_reason(place_m, cursor, now_ns)
        if not reason and other:
            reason = f"{other} stands there: press to take it instead, or stay at another place"
        if not reason and len(self._waypoints) >= MAX_WAYPOINTS:
            reason = f"the path has {MAX_WAYPOINTS} way-points already: press to send {self.robot}"
        if reason:
            return [self._cues.make("refused", reason, now_ns, place_m)]
        self._waypoints.append(place_m)
        text = f"way-point {len(self._waypoints)}: press to send {self.robot}, or stay at the next place"
        return [self._cues.make("selected", text, now_ns, place_m)]

    def _robot_at(self, place_m: Vec3) -> str:
        """Return the robot, other than the person's, that stands at a place, or `""`."""
        for name, state in self._robots.items():
            if name == self.robot:
                continue
            distance_m = floor_distance_m(state.position_m, place_m)
            if distance_m <= self._config.radius_m + state.radius_m:
                return name
        return ""

    def _send_goal(self, now_ns: int) -> list[Output]:
        """Send the robot to its last way-point, by the others. It keeps them if that is refused."""
        cursor = self._cursor
        place_m = self._waypoints[-1]
        if cursor is None:
            return [self._cues.make("refused", "point while you press", now_ns, place_m)]
        reason = self._checker.rejection_reason(place_m, cursor, now_ns)
        if reason:
            return [self._cues.make("refused", reason, now_ns, place_m)]

        # The way-points are used up, and the robot has to report its way to the goal
        via_m = tuple(self._waypoints[:-1])
        self._waypoints = []
        self._goals += 1
        goal = self._checker.goal(
            place_m,
            cursor,
            now_ns,
            seq=self._goals,
            via_m=via_m,
            robot=self.robot,
            surface_id=cursor.surface_id,
            proposed_ns=cursor.stamp_ns,
            confirmed_by="press",
        )
        if self._taken is not None:
            self._taken.on_goal(goal, now_ns)
        sent = self._cues.make("selected", f"{self.robot} goes there", now_ns, place_m)
        return [goal, sent]

    def _release(self) -> None:
        self._taken = None
        self._mode = "none"
        self._landing_m = None
        self._requested_m = None
        self._waypoints.clear()

    def _bar_stays(self) -> None:
        """Count no stay until the person has turned from the robot to a place."""
        if self._places:
            _, place_m, surface_id = self._places[-1]
            self._stays.bar(surface_id, place_m)

    def _with_steering(self, outputs: list[Output], now_ns: int) -> list[Output]:
        """Return `outputs`, followed by the steering if that has changed since it was published."""
        steering = Steering(
            stamp_ns=now_ns,
            robot=self.robot,
            mode=self._mode,
            target_m=self._landing_m,
            waypoints_m=tuple(self._waypoints),
            candidates=self._choice.candidates if self._taken is None else (),
        )
        previous = self._published
        if previous is not None:
            same_time = steering.model_copy(update={"stamp_ns": previous.stamp_ns})
            if same_time == previous:
                return outputs
        self._published = steering
        return [*outputs, steering]


def _mean(places_m: list[Vec3]) -> Vec3:
    total = (0.0, 0.0, 0.0)
    for place_m in places_m:
        total = vector.add(total, place_m)
    return vector.scale(total, 1.0 / len(places_m))
