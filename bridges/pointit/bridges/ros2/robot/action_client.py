"""Client of a ROS action: three services and two topics under the action's name."""

from collections.abc import Callable
from typing import Any

import numpy as np

from pointit.bridges.ros2.graph.backend import Backend, Closable, Qos
from pointit.bridges.ros2.types.types import Types

CANCEL = "action_msgs/srv/CancelGoal"
STATUS = "action_msgs/msg/GoalStatusArray"
STATUS_QOS = Qos(depth=1, latched=True)
FEEDBACK_QOS = Qos(depth=10)

ANSWER_S = 5.0
"""Time in which a server accepts or refuses."""
CANCEL_S = 1.0

EVERY_GOAL = bytes(16)
"""Id that stands for all goals in a cancellation without a time, also those of other clients."""
UNKNOWN_GOAL, TERMINATED = 2, 3
"""Constants of action_msgs/CancelGoal: it has no such goal; it has ended."""

Feedback = Callable[[bytes, Any], None]
Statuses = Callable[[list[tuple[bytes, int]]], None]


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
        self._backend, self._types, self._kind = backend, types, kind
        self._topics = f"{action}/_action"
        self._on_feedback, self._on_status, self._on_problem = on_feedback, on_status, on_problem
        feedback = f"{kind}_FeedbackMessage"
        types.prepare(feedback, STATUS, CANCEL, f"{kind}_SendGoal", f"{kind}_GetResult")
        self._ends: tuple[Closable, ...] = (
            backend.subscribe(
                f"{self._topics}/feedback", types.kind(feedback), FEEDBACK_QOS, self._take_feedback
            ),
            backend.subscribe(f"{self._topics}/status", types.kind(STATUS), STATUS_QOS, self._take_status),
        )

    async def send(self, goal: bytes, value: Any) -> bool:
        """Return True if the server accepts the goal `value` (a value of the type `…_Goal`).

        Raises:
            TimeoutError: If none is there, or it does not answer.
        """
        answer = await self._call("send_goal", f"{self._kind}_SendGoal", ANSWER_S, goal, goal=value)
        return bool(answer.accepted)

    async def result(self, goal: bytes, timeout_s: float) -> tuple[int, Any]:
        """Return the status and the result of an accepted goal, when it has ended.

        Raises:
            TimeoutError: If the server has gone, or that takes longer.
        """
        answer = await self._call("get_result", f"{self._kind}_GetResult", timeout_s, goal)
        return int(answer.status), answer.result

    async def cancel(self, goal: bytes) -> int:
        """Ask the server to cancel `goal`, or all goals for `EVERY_GOAL`; return its code: 0 if it does.

        Raises:
            TimeoutError: If it does not answer.
        """
        types = self._types
        info = types.make("action_msgs/msg/GoalInfo", goal_id=self._id(goal))
        request = types.make(types.request_of(CANCEL), goal_info=info)
        return int((await self._asked("cancel_goal", CANCEL, CANCEL_S, request)).return_code)

    def close(self) -> None:
        """Unsubscribe."""
        for end in self._ends:
            end.close()

    async def _call(self, name: str, service: str, timeout_s: float, identity: bytes, **fields: Any) -> Any:
        request = self._types.make(self._types.request_of(service), goal_id=self._id(identity), **fields)
        return await self._asked(name, service, timeout_s, request)

    async def _asked(self, name: str, service: str, timeout_s: float, request: Any) -> Any:
        types = self._types
        cdr = types.encode(types.request_of(service), request)
        full = f"{self._topics}/{name}"
        answer = await self._backend.call(full, types.kind(service), cdr, timeout_s=timeout_s)
        try:
            return types.decode(types.response_of(service), answer)
        except ValueError as error:
            raise TimeoutError(f"ROS service {full}: its answer was dropped: {error}") from error

    def _id(self, goal: bytes) -> Any:
        return self._types.make("unique_identifier_msgs/msg/UUID", uuid=goal)

    def _take_feedback(self, cdr: bytes) -> None:
        value = self._read(f"{self._kind}_FeedbackMessage", cdr, "feedback")
        if value is not None:
            self._on_feedback(_bytes(value.goal_id), value.feedback)

    def _take_status(self, cdr: bytes) -> None:
        value = self._read(STATUS, cdr, "status")
        if value is not None:
            self._on_status(
                [(_bytes(each.goal_info.goal_id), int(each.status)) for each in value.status_list]
            )

    def _read(self, name: str, cdr: bytes, topic: str) -> Any | None:
        try:
            return self._types.decode(name, cdr)
        except ValueError as error:
            self._on_problem(f"what came from {self._topics}/{topic} was dropped: {error}")
            return None


def _bytes(uuid: Any) -> bytes:
    return np.asarray(uuid.uuid, dtype=np.uint8).tobytes()
