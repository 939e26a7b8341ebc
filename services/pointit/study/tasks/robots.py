"""Tasks with a robot that follows the participant's pointing, or by which they are localized."""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from pointit.errors import ConfigError
from pointit.geometry.vector import Vec3
from pointit.schemas import Environment
from pointit.study.tasks.scene import StudyScene, StudyTrial, TaskConfig, pick

Robot = Annotated[str, Field(description="quadrotor of the scenario")]


class Steer(TaskConfig):
    """Bring a quadrotor that follows the pointing to a marked place; land it there, or stay (`follow`).

    The participant takes the robot by a press while they point at it. It stands for the cursor: a hover is
    that of the robot over the place, and so is the error.
    """

    kind: Literal["land", "follow"]
    places: dict[str, Vec3] = Field(
        default={"A": (3.0, 3.0, 0.0), "B": (1.6, 2.4, 0.0), "C": (4.3, 2.4, 0.0)},
        min_length=1,
        description="marked places on the floor by name, {W}, m",
    )
    width_m: float = Field(default=0.5, gt=0, le=5, description="extent of a place, m")
    robot: Robot = "quad"
    stay_s: float = Field(default=0.5, ge=0, le=10, description="time over the place that ends `follow`, s")

    def scene(self, trial: StudyTrial, room: Environment, before: StudyScene | None) -> StudyScene:
        """Return the scene of `trial`: any place but the last one."""
        del room
        names = [name for name in self.places if before is None or name != before.name] or list(self.places)
        name = pick(names, np.random.default_rng(trial.seed))
        does = "Land" if self.kind == "land" else "Keep"
        return StudyScene(
            target=name,
            name=name,
            width_m=self.width_m,
            target_m=self.places[name],
            robot=self.robot,
            stay_s=None if self.kind == "land" else self.stay_s,
            say=f"{does} {self.robot} {'at' if self.kind == 'land' else 'over'} {name}.",
        )

    def simulated(self, scenes: Sequence[StudyScene]) -> dict[str, object]:
        """Return the way of the robot."""
        return {"user-sim.spots_m": [scene.target_m for scene in scenes]}


class Localize(TaskConfig):
    """Localize the participant, who stands at a marked position, by a robot that they follow, or by lamps.

    The error is the distance from the marked position to the estimated one. A refused localization, or an
    error above half the width, counts as wrong.
    """

    kind: Literal["localize"]
    method: Literal["moving_target", "static_targets"] = Field(
        default="moving_target", description="moving_target: by a robot; static_targets: by lamps"
    )
    place_m: Vec3 = Field(default=(3.0, 0.0, 0.0), description="position of the participant, {W}, m")
    width_m: float = Field(default=1.0, gt=0, le=20, description="twice the error that is accepted, m")

    def scene(self, trial: StudyTrial, room: Environment, before: StudyScene | None) -> StudyScene:
        """Return the scene of `trial`. Raises: ConfigError: If the map has no lamps for `static_targets`."""
        del trial, before
        if self.method == "static_targets" and not room.lamps:
            raise ConfigError("the map has no lamps to localize by; use task.method moving_target")
        say = "Follow the robot." if self.method == "moving_target" else "Point at each lamp that is lit."
        width_m, target_m = self.width_m, self.place_m
        return StudyScene(
            target="pose", name="position", width_m=width_m, target_m=target_m, localize=self.method, say=say
        )

    def simulated(self, scenes: Sequence[StudyScene]) -> dict[str, object]:
        """Return that the robot is not taken."""
        del scenes
        return {"user-sim.behaviour": "rest"}
