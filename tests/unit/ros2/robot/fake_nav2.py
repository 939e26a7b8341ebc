"""A ROS graph with one action server, NavigateToPose, that does as the test says."""

import asyncio
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pointit.bridges.ros2.graph.backend import RosType
from pointit.bridges.ros2.robot.goal_book import GoalStatus
from pointit.bridges.ros2.robot.navigator import CANCEL, EVERY_GOAL, STATUS, UNKNOWN_GOAL
from pointit.bridges.ros2.types.definitions import NAVIGATE_TO_POSE
from pointit.geometry.vector import Vec3
from tests.unit.ros2.graph_of_one import FakeBackend
from tests.unit.ros2.scenes import jazzy

ACTION = "/navigate_to_pose/_action"
SEND = f"{NAVIGATE_TO_POSE}_SendGoal"
RESULT = f"{NAVIGATE_TO_POSE}_GetResult"


@dataclass
class FakeNav2(FakeBackend):
    """Accepts goals, and works on them until told otherwise."""

    accepts: bool = True
    is_silent: bool = False
    """It gets goals, and does not answer."""
    gate: asyncio.Event | None = None
    """Answers to goals wait for it."""
    goals: dict[bytes, Any] = field(default_factory=dict[bytes, Any])
    """Goals that came, by id."""
    ends: dict[bytes, asyncio.Future[bytes]] = field(default_factory=dict[bytes, asyncio.Future[bytes]])
    cancelled: list[bytes] = field(default_factory=list[bytes])
    clear_gate: asyncio.Event | None = None
    """Cancellations of all goals wait for it."""
    clear_failures: int = 0
    """Number of cancellations of all goals that are lost."""
    clears: int = 0
    """Number of cancellations of all goals."""

    @property
    def places_m(self) -> list[Vec3]:
        points = [goal.pose.pose.position for goal in self.goals.values()]
        return [(point.x, point.y, point.z) for point in points]

    async def call(self, service: str, kind: RosType, request: bytes, *, timeout_s: float) -> bytes:
        value = jazzy().decode(jazzy().request_of(kind.name), request)
        if service == f"{ACTION}/send_goal":
            return await self._on_goal(identity(value.goal_id), value.goal)
        if service == f"{ACTION}/get_result":
            return await self.ends[identity(value.goal_id)]
        assert service == f"{ACTION}/cancel_goal", timeout_s
        goal = identity(value.goal_info.goal_id)
        if goal == EVERY_GOAL:
            assert value.goal_info.stamp.sec == value.goal_info.stamp.nanosec == 0  # a time would limit it
            return await self._on_clear()
        self.cancelled.append(goal)
        known = goal in self.ends and not self.ends[goal].done()
        if known:
            self.end(goal, GoalStatus.CANCELED)
        return answer(CANCEL, return_code=0 if known else UNKNOWN_GOAL)

    def end(self, goal: bytes, status: GoalStatus, error_code: int = 0) -> None:
        """End a goal."""
        result = jazzy().make(f"{NAVIGATE_TO_POSE}_Result", error_code=error_code)
        self.ends[goal].set_result(answer(RESULT, status=status, result=result))

    def feedback(self, goal: bytes) -> None:
        """Publish feedback about a goal."""
        name = f"{NAVIGATE_TO_POSE}_FeedbackMessage"
        feedback = jazzy().make(f"{NAVIGATE_TO_POSE}_Feedback", distance_remaining=0.75)
        self.readers[f"{ACTION}/feedback"](
            jazzy().encode(name, jazzy().make(name, goal_id=uuid(goal), feedback=feedback))
        )

    def status(self, *statuses: tuple[bytes, GoalStatus]) -> None:
        """Publish the status of goals."""
        items = [
            jazzy().make(
                "action_msgs/msg/GoalStatus",
                goal_info=jazzy().make("action_msgs/msg/GoalInfo", goal_id=uuid(goal)),
                status=status,
            )
            for goal, status in statuses
        ]
        self.readers[f"{ACTION}/status"](jazzy().encode(STATUS, jazzy().make(STATUS, status_list=items)))

    async def _on_clear(self) -> bytes:
        self.clears += 1
        if self.clear_gate is not None:
            await self.clear_gate.wait()
        if self.clears <= self.clear_failures:
            raise TimeoutError(f"ROS service {ACTION}/cancel_goal: its server did not answer within 1 s")
        for goal, end in self.ends.items():
            if not end.done():
                self.end(goal, GoalStatus.CANCELED)
        return answer(CANCEL, return_code=0)

    async def _on_goal(self, goal: bytes, value: Any) -> bytes:
        self.goals[goal] = value
        if self.gate is not None:
            await self.gate.wait()
        if self.accepts:
            self.ends[goal] = asyncio.get_running_loop().create_future()
        if self.is_silent:
            raise TimeoutError(f"ROS service {ACTION}/send_goal: its server did not answer within 5 s")
        return answer(SEND, accepted=self.accepts)


def identity(value: Any) -> bytes:
    return np.asarray(value.uuid, dtype=np.uint8).tobytes()


def uuid(goal: bytes) -> Any:
    return jazzy().make("unique_identifier_msgs/msg/UUID", uuid=goal)


def answer(service: str, **fields: Any) -> bytes:
    name = jazzy().response_of(service)
    return jazzy().encode(name, jazzy().make(name, **fields))
