"""Ready tasks: the target of each trial and its position, also with a robot that follows."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, sin
from typing import Annotated, Literal, TypeVar

import numpy as np
from pydantic import Field

from pointit.errors import ConfigError
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.runtime.config.config import Config
from pointit.schemas import Environment, TrackedObject

T = TypeVar("T")
Width = Annotated[float, Field(gt=0, le=5, description="extent of a target, m")]
Robot = Annotated[str, Field(description="quadrotor of the scenario")]

TARGET = "red"
"""Kind of the target, whose colour strips, pages and simulated people know."""
OTHER = "blue"
"""Kind of all others."""
GAP_M = 0.6
"""Distance between two packages, m."""
START = 0.1
"""Position of the hindmost package, share of the lane."""


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


class TargetReach(TaskConfig):
    """Reach a target on an LED strip, `distance_m` along it from the last one where that fits."""

    kind: Literal["reach"]
    strips: tuple[str, ...] = Field(default=(), description="ids; all strips of the map if empty")
    width_m: Width = 0.2
    distance_m: float = Field(default=1.0, gt=0, le=100, description="between two targets, m")
    others: int = Field(default=0, ge=0, le=20, description="number of targets beside that are wrong")

    def scene(self, trial: StudyTrial, room: Environment, before: StudyScene | None) -> StudyScene:
        """Return the scene of `trial`, after the one `before` of its block.

        Raises: ConfigError: If the map has no such strip, or the target does not fit.
        """
        rng = np.random.default_rng(trial.seed)
        lines = _lines(room, self.strips)
        half_m = self.width_m / 2.0
        strip, last_m = (
            before.along if before is not None and before.along else (pick(list(lines), rng), None)
        )
        ends = (half_m, lines[strip].length_m - half_m)
        if ends[1] - ends[0] < self.distance_m:
            raise ConfigError(
                f"strip {strip} is {lines[strip].length_m:g} m long: no two targets {self.width_m:g} m wide "
                f"are {self.distance_m:g} m apart on it; make task.distance_m smaller"
            )
        if last_m is None:
            at_m = float(rng.uniform(*ends))
        else:
            fits = [
                p for p in (last_m - self.distance_m, last_m + self.distance_m) if ends[0] <= p <= ends[1]
            ]
            at_m = pick(fits, rng) if fits else max(ends, key=lambda end: abs(end - last_m))
        free = [
            p for p in np.arange(ends[0], ends[1], 2.0 * self.width_m) if abs(p - at_m) >= 2.0 * self.width_m
        ]
        others = sorted(rng.permutation(len(free))[: self.others].tolist())
        places = [at_m, *(float(free[each]) for each in others)]
        objects = tuple(
            _on_strip(
                f"t{trial.number}-{n}", OTHER if n else TARGET, (strip, place), lines[strip], self.width_m
            )
            for n, place in enumerate(places)
        )
        return StudyScene(
            target=objects[0].id,
            name=f"strip {strip} at {at_m:.2f} m",
            width_m=self.width_m,
            target_m=objects[0].position_m,
            objects=objects,
            along=(strip, at_m),
        )


class Tapping(TaskConfig):
    """Tapping of ISO 9241-411: to and fro between `targets` on a circle, or between two places of a strip.

    Widths and distances are also measured as angles at the eyes, by which pointing from afar is described
    (Kopper et al. 2010).
    """

    kind: Literal["tapping"]
    width_m: Width = 0.2
    distance_m: float = Field(default=1.0, gt=0, le=20, description="diameter of the circle, m")
    strip: str = Field(default="", description="strip for tapping in one dimension, about its middle")
    targets: int = Field(default=11, ge=3, le=51, description="number of targets on the circle, odd")
    center_m: Vec3 = Field(default=(3.0, 0.0, 1.4), description="centre of the circle, {W}, m")

    def scene(self, trial: StudyTrial, room: Environment, before: StudyScene | None) -> StudyScene:
        """Return the scene of `trial`; the next target is across the circle, one further each time.

        Raises: ConfigError: If the map has no such strip, or it is too short.
        """
        del before
        if self.strip:
            line = _lines(room, (self.strip,))[self.strip]
            sides = [line.length_m / 2.0 + sign * self.distance_m / 2.0 for sign in (-1.0, 1.0)]
            if sides[0] < self.width_m / 2.0:
                raise ConfigError(f"strip {self.strip} is too short for task.distance_m {self.distance_m:g}")
            now = trial.place % 2
            objects = [
                _on_strip(
                    f"t{trial.number}-{n}",
                    TARGET if n == now else OTHER,
                    (self.strip, at_m),
                    line,
                    self.width_m,
                )
                for n, at_m in enumerate(sides)
            ]
        else:
            count = self.targets - 1 + self.targets % 2
            step = (count + 1) // 2
            now, last = (place * step % count for place in (trial.place, trial.place - 1))
            objects = [
                TrackedObject(
                    id=f"t{trial.number}-{n}",
                    kind=TARGET if n == now else OTHER,
                    position_m=self._on_circle(2.0 * pi * n / count),
                    length_m=self.width_m,
                )
                for n in range(count)
                if n != last  # where the ray rests, which would be selected first
            ]
        target = next(each for each in objects if each.kind == TARGET)
        return StudyScene(
            target=target.id,
            name=f"place {now + 1}",
            width_m=self.width_m,
            target_m=target.position_m,
            objects=tuple(objects),
        )

    def _on_circle(self, angle_rad: float) -> Vec3:
        radius_m, (x, y, z) = self.distance_m / 2.0, self.center_m
        return (x, y + radius_m * cos(angle_rad), z + radius_m * sin(angle_rad))


class TargetPackages(TaskConfig):
    """Choose the red one of some packages that move on a lane of the simulated conveyor."""

    kind: Literal["packages"]
    lane: str = Field(default="", description="belt; the longest of the map if empty")
    width_m: Width = 0.4
    others: int = Field(default=2, ge=0, le=20, description="number of blue packages")

    def scene(self, trial: StudyTrial, room: Environment, before: StudyScene | None) -> StudyScene:
        """Return the scene of `trial`.

        Raises: ConfigError: If the map has no such lane, or it is too short.
        """
        del before
        lengths = {belt.id: Polyline(belt.line_m).length_m for belt in room.belts}
        lane = self.lane or max(lengths, key=lengths.__getitem__, default="")
        if lane not in lengths:
            raise ConfigError(f"the map has no belt {lane or 'at all'} for task packages")
        step = (self.width_m + GAP_M) / lengths[lane]
        if START + self.others * step > 1.0:
            raise ConfigError(
                f"{self.others + 1} packages do not fit on belt {lane}; make task.others smaller"
            )
        now = int(np.random.default_rng(trial.seed).integers(self.others + 1))
        queue = [
            ScenePackage(
                kind=TARGET if n == now else OTHER,
                lane=lane,
                length_m=self.width_m,
                position=START + n * step,
            )
            for n in range(self.others + 1)
        ]
        queue.insert(0, queue.pop(now))
        return StudyScene(target="", name="red package", width_m=self.width_m, packages=tuple(queue))


class TargetPlaces(TaskConfig):
    """Point at marked places of the room, its lamps, which are lit, or its things, one after the other."""

    kind: Literal["places"]
    places: dict[str, Vec3] = Field(default={}, description="positions by name, {W}, m")
    lamps: tuple[str, ...] = Field(default=(), description="ids of lamps of the map")
    things: tuple[str, ...] = Field(default=(), description="ids of things of the map that are buttons")
    width_m: Width = 0.3

    def scene(self, trial: StudyTrial, room: Environment, before: StudyScene | None) -> StudyScene:
        """Return the scene of `trial`: any place but the last one.

        Raises: ConfigError: If there is no place, or the map has no such lamp or button.
        """
        lamps = {lamp.id: lamp.position_m for lamp in room.lamps}
        things = {thing.id: thing for thing in room.fixed_things if thing.mode == "button"}
        for kind, wanted, known in (("lamp", self.lamps, lamps), ("button", self.things, things)):
            if unknown := set(wanted) - known.keys():
                raise ConfigError(
                    f"the map has no {kind} {min(unknown)}; it has {', '.join(known) or 'none'}"
                )
        places = {**self.places, **{lamp: lamps[lamp] for lamp in self.lamps}}
        places |= {name: things[name].center_m for name in self.things}
        names = [name for name in places if before is None or name != before.name] or list(places)
        if not names:
            raise ConfigError("task places needs places, lamps or things")
        name = pick(names, np.random.default_rng(trial.seed))
        thing = things[name] if name in self.things else None
        target = TrackedObject(
            id=f"t{trial.number}-0", kind=TARGET, position_m=places[name], length_m=self.width_m
        )
        return StudyScene(
            target=thing.id if thing else target.id,
            name=name,
            width_m=max(thing.size_m[:2]) if thing else self.width_m,
            target_m=places[name],
            objects=() if thing else (target,),  # the map's own tracker lists things
            lamp=name if name in self.lamps else "",
            say=f"Point at {thing.label or thing.id}." if thing else "",
        )


def _lines(room: Environment, wanted: Sequence[str]) -> dict[str, Polyline]:
    lines = {strip.id: Polyline(strip.line_m) for strip in room.strips}
    if unknown := set(wanted) - lines.keys():
        raise ConfigError(f"the map has no strip {min(unknown)}; it has {', '.join(lines) or 'none'}")
    if not lines:
        raise ConfigError("the map has no strips for this task")
    return {name: lines[name] for name in wanted or lines}


def _on_strip(
    name: str, kind: str, along: tuple[str, float], line: Polyline, width_m: float
) -> TrackedObject:
    strip, at_m = along
    return TrackedObject(
        id=name,
        kind=kind,
        position_m=line.point_at(at_m),
        length_m=width_m,
        surface="strip",
        surface_id=strip,
        surface_position_m=at_m,
    )


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
        width_m = self.width_m
        target_m = self.place_m
        return StudyScene(
            target="pose", name="position", width_m=width_m, target_m=target_m, localize=self.method, say=say
        )

    def simulated(self, scenes: Sequence[StudyScene]) -> dict[str, object]:
        """Return that the robot is not taken."""
        del scenes
        return {"user-sim.behaviour": "rest"}
