"""A trial of a plan, and its scene in the room."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from pointit.geometry.vector import Vec3
from pointit.runtime.config.config import Config
from pointit.schemas import TrackedObject

T = TypeVar("T")


def pick(items: Sequence[T], rng: np.random.Generator) -> T:
    """Return a random one of `items`."""
    return items[int(rng.integers(len(items)))]


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyTrial:
    """One trial of a plan."""

    number: int
    """In the plan of the participant, from 1."""
    block: int
    """From 1."""
    place: int
    """In its block, from 0."""
    practice: bool
    cell: dict[str, str]
    """Level by factor, of all factors."""
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenePackage:
    """A package to be put on a lane."""

    kind: str
    lane: str
    length_m: float
    position: float
    """0 to 1 of the lane's length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyScene:
    """Target of a trial, and the distractors beside it."""

    target: str
    """Id of the target's object; of packages known only when it is there."""
    name: str
    """In the table and to the participant."""
    width_m: float
    target_m: Vec3 | None = None
    """Centre, or None for that of the first of `packages`."""
    objects: tuple[TrackedObject, ...] = ()
    packages: tuple[ScenePackage, ...] = ()
    lamp: str = ""
    """To be lit."""
    say: str = ""
    """Spoken instruction for the participant if no light shows the target."""
    robot: str = ""
    """Robot that stands for the cursor."""
    stay_s: float | None = None
    """Time over the target for which the robot stays, s. None: it lands."""
    localize: Literal["", "static_targets", "moving_target"] = ""
    """Method by which the participant is to be localized."""
    along: tuple[str, float] | None = None
    """Strip and arc length on it, m."""


class TaskConfig(Config):
    """Base of the parameters of a task."""

    def simulated(self, scenes: Sequence[StudyScene]) -> dict[str, object]:
        """Return parameters with which a simulated participant does `scenes`, the rest of a block."""
        del scenes
        return {}
