"""Steering of robots by pointing: from a cursor, poses, robots and a map to steering, goals and cues."""

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import ClassVar

from pointit.runtime.clock import wait_until
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    ButtonEvent,
    Cursor,
    Done,
    Feedback,
    Goal,
    Interaction,
    RobotState,
    SendRobot,
    Steering,
)
from pointit.schemas.topics import (
    BUTTON,
    CURSOR,
    FEEDBACK,
    GOAL,
    INTERACTION,
    MAP,
    POSE,
    RAY,
    ROBOT_STATE,
    SEND_ROBOT,
    STEERING,
)
from pointit.services.goal.config import GoalConfig
from pointit.services.goal.goal_confirmation import GoalConfirmation
from pointit.services.goal.robot_steering import RobotSteering


class Goals(Service[GoalConfig]):
    """Turns one person's pointing at places, or at robots and places, into confirmed goals and steering."""

    NAME: ClassVar[str] = "goal"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = GoalConfig

    def __init__(self, config: GoalConfig, context: Context) -> None:
        super().__init__(config, context)
        self._steps: GoalConfirmation | RobotSteering
        self._has_new_deadline = asyncio.Event()
        self._goals = self.bus.publisher(GOAL, self.user)
        self._steering = self.bus.publisher(STEERING, self.user)
        if config.steer == "robots":
            robots = RobotSteering(config, self.user)
            self._steps = robots
            self.bus.subscribe(RAY, lambda ray, _user: robots.on_ray(ray), self.user)
            self.bus.subscribe(ROBOT_STATE, partial(self._on_robot, robots))
        else:
            self._steps = GoalConfirmation(config, self.user)
        self._feedback = self.bus.publisher(FEEDBACK, self.user)
        self.bus.serve(SEND_ROBOT, self._send, self.user)
        self.bus.subscribe(MAP, lambda environment, _name: self._steps.on_map(environment))
        self.bus.subscribe(POSE, lambda pose, user: self._steps.on_pose(user, pose))
        self.bus.subscribe(INTERACTION, self._on_interaction, self.user)
        self.bus.subscribe(CURSOR, self._on_cursor, self.user)
        self.bus.subscribe(BUTTON, self._on_button, self.user)

    async def run(self) -> None:
        """Withdraw proposals that are not confirmed in time, and requests that no robot answers."""
        while True:
            self._publish(self._steps.tick(self.clock.now_ns()))
            self._has_new_deadline.clear()
            await wait_until(self.clock, self._steps.deadline_ns, self._has_new_deadline)

    def _on_interaction(self, interaction: Interaction, _user: str) -> None:
        outputs = self._steps.on_interaction(interaction, self.clock.now_ns())
        self._publish(outputs)

    def _on_cursor(self, cursor: Cursor, _user: str) -> None:
        outputs = self._steps.on_cursor(cursor, self.clock.now_ns())
        self._publish(outputs)

    def _on_button(self, event: ButtonEvent, _user: str) -> None:
        outputs = self._steps.on_button(event, self.clock.now_ns())
        self._publish(outputs)

    def _on_robot(self, robots: RobotSteering, state: RobotState, name: str) -> None:
        outputs = robots.on_robot(name, state, self.clock.now_ns())
        self._publish(outputs)

    async def _send(self, query: SendRobot, _user: str) -> Done:
        """Send a robot as the person asks.

        Raises:
            RefusedError: If a check fails. The message gives the reason.
        """
        outputs = self._steps.send(query.robot, query.position_m, self.clock.now_ns())
        self._publish(outputs)
        name = query.robot or "the robot"
        return Done(message=f"{name} is sent there")

    def _publish(self, outputs: Sequence[Goal | Feedback | Steering]) -> None:
        """Publish `outputs`. They may have changed the time of the next tick."""
        for output in outputs:
            if isinstance(output, Goal):
                self._goals.put(output)
                self.bus.set_metric("goals", output.seq)
            elif isinstance(output, Steering):
                self._steering.put(output)
            else:
                self._feedback.put(output)
        if outputs:
            self._has_new_deadline.set()


SERVICE = Goals
