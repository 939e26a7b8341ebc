"""Commands to a robot with Nav2, as goals of its action NavigateToPose.

No core: it waits for a robot.
"""

import asyncio
import math
import uuid
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np

from pointit.bridges.ros2.graph.backend import Backend, BackendHandle, Qos
from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.robot.goal_book import RETRY_NS, GoalBook, Outcome
from pointit.bridges.ros2.robot.plugin import Ros2RobotConfig
from pointit.bridges.ros2.types.definitions import NAVIGATE_TO_POSE
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation, vector
from pointit.geometry.vector import Vec3
from pointit.plugins import NS_PER_S, Command, Follow, FollowPath, OrderStatus, Report, RobotReport, Stop

Feedback = Callable[[bytes, Any], None]
Statuses = Callable[[list[tuple[bytes, int]]], None]

CANCEL = "action_msgs/srv/CancelGoal"
STATUS = "action_msgs/msg/GoalStatusArray"
STATUS_QOS = Qos(depth=1, latched=True)
FEEDBACK_QOS = Qos(depth=10)

ANSWER_S = 5.0
"""Time in which a server accepts or refuses."""
CANCEL_S = 1.0

EVERY_GOAL = bytes(16)
"""Id that stands for all goals in a cancellation without a time, also those of other clients."""
UNKNOWN_GOAL = 2
"""Constant of action_msgs/CancelGoal: it has no such goal."""
TERMINATED = 3
"""Constant of action_msgs/CancelGoal: the goal has ended."""
AGAIN_M = 0.2
"""A place to follow that is nearer to the last goal is not a new goal."""
AGAIN_NS = NS_PER_S
"""Minimum interval of goals while the robot follows: Nav2 makes a plan for each."""
RESULT_S = 500.0
"""A result is requested again after this time: Zenoh drops requests that are open for 600 s."""
HALT_S = 0.8
"""Time in which goals are cancelled before the driver ends."""


class ActionClient:
    """Sends goals of one action; ids are 16 bytes. All handlers run in the event loop."""

    def __init__(
        self,
        backend: Backend,
        types: Types,
        action: str,
        kind: str,
        *,
        on_feedback: Feedback,
        on_status: Statuses,
        on_problem: Callable[[str], None],
    ) -> None:
        """Subscribe to feedback and status.

        Args:
            backend: the node.
            types: with the action's.
            action: its full name, `/navigate_to_pose`.
            kind: its type, `nav2_msgs/action/NavigateToPose`.
            on_feedback: called with a goal's id and its feedback.
            on_status: called with the ids of all goals of the server, and their status.
            on_problem: called with a sentence if a message cannot be read.
        """
        self._backend = backend
        self._types = types
        self._kind = kind
        self._topics = f"{action}/_action"
        self._on_feedback = on_feedback
        self._on_status = on_status
        self._on_problem = on_problem
        feedback = f"{kind}_FeedbackMessage"
        send_goal = f"{kind}_SendGoal"
        get_result = f"{kind}_GetResult"
        types.prepare(feedback, STATUS, CANCEL, send_goal, get_result)

        # Feedback says that the server works on a goal, status when one has ended
        feedback_end = backend.subscribe(
            f"{self._topics}/feedback", types.kind(feedback), FEEDBACK_QOS, self._process_feedback
        )
        status_end = backend.subscribe(
            f"{self._topics}/status", types.kind(STATUS), STATUS_QOS, self._process_status
        )
        self._ends: tuple[BackendHandle, ...] = (feedback_end, status_end)

    async def send(self, goal: bytes, value: Any) -> bool:
        """Send the goal `value` (of the type `…_Goal`). Return True if the server accepts it.

        Raises:
            TimeoutError: If there is no server, or it does not answer.
        """
        service = f"{self._kind}_SendGoal"
        answer = await self._call("send_goal", service, ANSWER_S, goal, goal=value)
        return bool(answer.accepted)

    async def result(self, goal: bytes, timeout_s: float) -> tuple[int, Any]:
        """Return the status and the result of an accepted goal, when it has ended.

        Raises:
            TimeoutError: If the server has gone, or that takes longer.
        """
        service = f"{self._kind}_GetResult"
        answer = await self._call("get_result", service, timeout_s, goal)
        return int(answer.status), answer.result

    async def cancel(self, goal: bytes) -> int:
        """Ask the server to cancel `goal`, or all goals for `EVERY_GOAL`; return its code: 0 if it does.

        Raises:
            TimeoutError: If it does not answer.
        """
        types = self._types
        info = types.make("action_msgs/msg/GoalInfo", goal_id=self._id(goal))
        request = types.make(types.request_of(CANCEL), goal_info=info)
        answer = await self._call_service("cancel_goal", CANCEL, CANCEL_S, request)
        return int(answer.return_code)

    def close(self) -> None:
        """Unsubscribe."""
        for end in self._ends:
            end.close()

    async def _call(self, name: str, service: str, timeout_s: float, identity: bytes, **fields: Any) -> Any:
        types = self._types
        request_type = types.request_of(service)
        request = types.make(request_type, goal_id=self._id(identity), **fields)
        return await self._call_service(name, service, timeout_s, request)

    async def _call_service(self, name: str, service: str, timeout_s: float, request: Any) -> Any:
        types = self._types
        cdr = types.encode(types.request_of(service), request)
        full = f"{self._topics}/{name}"
        kind = types.kind(service)
        answer = await self._backend.call(full, kind, cdr, timeout_s=timeout_s)
        try:
            return types.decode(types.response_of(service), answer)
        except ValueError as error:
            raise TimeoutError(f"ROS service {full}: its answer was dropped: {error}") from error

    def _id(self, goal: bytes) -> Any:
        return self._types.make("unique_identifier_msgs/msg/UUID", uuid=goal)

    def _process_feedback(self, cdr: bytes) -> None:
        value = self._read(f"{self._kind}_FeedbackMessage", cdr, "feedback")
        if value is not None:
            self._on_feedback(_bytes(value.goal_id), value.feedback)

    def _process_status(self, cdr: bytes) -> None:
        value = self._read(STATUS, cdr, "status")
        if value is None:
            return
        statuses: list[tuple[bytes, int]] = []
        for entry in value.status_list:
            goal = _bytes(entry.goal_info.goal_id)
            statuses.append((goal, int(entry.status)))
        self._on_status(statuses)

    def _read(self, name: str, cdr: bytes, topic: str) -> Any | None:
        try:
            return self._types.decode(name, cdr)
        except ValueError as error:
            topic_name = f"{self._topics}/{topic}"
            self._on_problem(f"what came from {topic_name} was dropped: {error}")
            return None


def _bytes(uuid: Any) -> bytes:
    return np.asarray(uuid.uuid, dtype=np.uint8).tobytes()


class Navigator:
    """Carries out commands, the newest first; `tick` is to be called at 10 Hz or more."""

    def __init__(
        self,
        backend: Backend,
        types: Types,
        config: Ros2RobotConfig,
        *,
        now_ns: Callable[[], int],
        report: Report,
        on_problem: Callable[[str], None],
        on_distance: Callable[[float], None],
    ) -> None:
        """Subscribe to the action's topics; `on_distance` gets the rest of the way, m, by Nav2's feedback."""
        self._types = types
        self._config = config
        self._now_ns = now_ns
        self._report = report
        self._on_distance = on_distance
        self._client = ActionClient(
            backend,
            types,
            config.action,
            NAVIGATE_TO_POSE,
            on_feedback=self._on_feedback,
            on_status=self._on_status,
            on_problem=on_problem,
        )
        self._book = GoalBook()

        # Requests to the server, which are open for as long as it works on a goal
        self._tasks: set[asyncio.Task[None]] = set()
        self._is_clear = True
        """False from a stop until the server has answered to the request to cancel all goals."""
        self._clearing: asyncio.Task[None] | None = None
        self._cleared_ns = 0
        """Time of the last request to cancel all goals."""

        # The command, and what of it is to be sent
        self._order = 0
        self._waypoints: list[tuple[Vec3, float | None]] = []
        """Places to go to, in order, each with a yaw, rad, or None: that of the way there."""
        self._follow: Follow | None = None
        """The newest place to follow, or None if the robot follows none."""
        self._last_m: Vec3 | None = None
        """The last goal while the robot follows."""
        self._sent_ns = 0
        self._at_m: Vec3 | None = None

    def on_report(self, report: RobotReport) -> RobotReport:
        """Store the robot's pose."""
        self._at_m = report.position_m
        return report

    def command(self, command: Command) -> None:
        """Carry out `command`."""
        if isinstance(command, Follow):
            self._order = command.order
            self._follow = command
            self._waypoints = []
            self.tick()
            return
        self._order = command.order
        self._follow = None
        self._last_m = None
        self._waypoints = []
        match command:
            case FollowPath(points_m=points_m, yaw_rad=yaw_rad):
                for point_m in points_m[:-1]:
                    self._waypoints.append((point_m, None))
                self._waypoints.append((points_m[-1], yaw_rad))  # the yaw is that at the end
                self._send_next()
            case Stop():
                self._book.drop()
                self._is_clear = False
                self._cleared_ns = 0
                self.tick()
            case _:
                self._report_outcome("refused", "a robot with Nav2 neither takes off nor lands")

    def tick(self) -> None:
        """Send the place to follow if it is time, and cancel what nobody wants."""
        now_ns = self._now_ns()
        reason = f"{self._config.action} gave up: see Nav2's log"
        self._on_outcome(self._book.overdue(now_ns), self._order, reason)

        # A place to follow becomes a new goal if it has moved, at most once a second
        follow = self._follow
        if follow is not None and now_ns - self._sent_ns >= AGAIN_NS:
            last_m = self._last_m
            is_new = last_m is None or _distance_m(follow.position_m, last_m) >= AGAIN_M
            if is_new:
                self._last_m = follow.position_m
                self._send(follow.position_m, follow.yaw_rad)

        # Only without a goal of ours all goals are cancelled
        for goal in self._book.to_cancel(now_ns):
            self._start(self._cancel(goal))
        if self._is_clear or self._book.wanted is not None:
            return
        if self._clearing is None and now_ns - self._cleared_ns >= RETRY_NS:
            self._cleared_ns = now_ns
            self._clearing = self._start(self._clear())

    async def close(self) -> None:
        """Cancel all goals and wait for that, `HALT_S` at most; then unsubscribe."""
        self._order = 0
        self._follow = None
        self._waypoints = []
        self._book.drop()
        try:
            async with asyncio.timeout(HALT_S):
                while self._book.has_unwanted:
                    self.tick()
                    await asyncio.sleep(0.02)  # answers come meanwhile
        except TimeoutError:
            pass
        finally:
            self._client.close()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    def _send_next(self) -> None:
        (point_m, yaw_rad), *self._waypoints = self._waypoints
        self._send(point_m, yaw_rad)

    def _send(self, position_m: Vec3, yaw_rad: float | None) -> None:
        self._sent_ns = self._now_ns()
        goal = uuid.uuid4().bytes
        self._book.begin(goal)
        value = self._goal(position_m, yaw_rad)
        self._start(self._send_goal(goal, self._order, value))

    def _goal(self, position_m: Vec3, yaw_rad: float | None) -> Any:
        if yaw_rad is None:
            yaw_rad = self._yaw_towards(position_m)
        types = self._types
        orientation = rotation.from_yaw(yaw_rad)
        pose = types.make(
            "geometry_msgs/msg/PoseStamped",
            header=values.header(types, self._now_ns(), self._config.frame),
            pose=values.pose(types, position_m, orientation),
        )
        return types.make(f"{NAVIGATE_TO_POSE}_Goal", pose=pose)

    def _yaw_towards(self, position_m: Vec3) -> float:
        """Return the azimuth from the robot to `position_m`, rad, or 0 if there is none."""
        if self._at_m is None:
            return 0.0
        step_m = vector.subtract(position_m, self._at_m)
        if math.hypot(step_m[0], step_m[1]) > 0.0:
            return vector.azimuth(step_m)
        return 0.0

    async def _send_goal(self, goal: bytes, order: int, value: Any) -> None:
        if self._clearing is not None:  # which would cancel it, too
            await asyncio.wait({self._clearing})
            if goal != self._book.wanted:
                self._book.on_response(goal, accepted=False, now_ns=self._now_ns())
                return

        # Accepted, refused or no answer: the book knows what that means for the person
        try:
            is_accepted = await self._client.send(goal, value)
        except TimeoutError as error:
            reason = f"{error}; check that Nav2 runs"
            self._on_outcome(self._book.on_silence(goal), order, reason)
            return
        outcome = self._book.on_response(goal, accepted=is_accepted, now_ns=self._now_ns())
        self._on_outcome(outcome, order, f"{self._config.action} refused the goal: see Nav2's log")
        self.tick()  # it may be unwanted by now
        if is_accepted:
            await self._await_end(goal, order)

    async def _await_end(self, goal: bytes, order: int) -> None:
        while True:
            try:
                status, result = await self._client.result(goal, RESULT_S)
            except TimeoutError as error:
                if self._book.is_reported(goal, self._now_ns()):
                    continue
                reason = f"{error}; check that Nav2 runs"
                self._on_outcome(self._book.on_silence(goal), order, reason)
                return
            outcome = self._book.on_end(goal, status)
            self._on_outcome(outcome, order, _failure_reason(result, status))
            return

    async def _cancel(self, goal: bytes) -> None:
        try:
            code = await self._client.cancel(goal)
        except TimeoutError:
            return  # it is tried again
        if code in {UNKNOWN_GOAL, TERMINATED}:
            self._book.on_unknown(goal)

    async def _clear(self) -> None:
        """Cancel all goals of the server: one of an earlier run, which has crashed, is not in the book."""
        self._is_clear = True  # unless another stop comes meanwhile
        try:
            await self._client.cancel(EVERY_GOAL)
        except TimeoutError:
            self._is_clear = False  # it is tried again
        finally:
            self._clearing = None

    def _on_feedback(self, goal: bytes, feedback: Any) -> None:
        remaining_m = feedback.distance_remaining
        if goal == self._book.wanted and math.isfinite(remaining_m):
            self._on_distance(float(remaining_m))
        outcome = self._book.on_feedback(goal, self._now_ns())
        self._on_outcome(outcome, self._order)

    def _on_status(self, statuses: list[tuple[bytes, int]]) -> None:
        for outcome in self._book.on_status(statuses, self._now_ns()):
            self._on_outcome(outcome, self._order)

    def _on_outcome(self, outcome: Outcome | None, order: int, reason: str = "") -> None:
        """Inform the person, and continue along the way.

        For a robot that follows, only failures are reported.
        """
        if outcome is None:
            return
        is_failure = outcome in {"refused", "failed"}
        is_of_interest = order == self._order
        if self._follow is not None:
            is_of_interest = is_failure
        if not is_of_interest:
            return
        if outcome == "done" and self._waypoints:
            self._send_next()
            return
        self._report_outcome(outcome, reason if is_failure else "")

    def _report_outcome(self, outcome: Outcome, reason: str) -> None:
        self._report(OrderStatus(order=self._order, state=outcome, reason=reason))

    def _start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task


def _distance_m(a_m: Vec3, b_m: Vec3) -> float:
    return vector.norm(vector.subtract(a_m, b_m))


def _failure_reason(result: Any, status: int) -> str:
    """Return the reason of a failure by Nav2's message, its error code, or the status."""
    text = getattr(result, "error_msg", "")
    code = int(getattr(result, "error_code", 0))
    if not text:
        text = f"error {code}" if code else f"status {status}"
    return f"Nav2 gave up: {text[:200]}"
