"""Ready tasks: the target of each trial and its position, also with a robot that follows."""

from collections.abc import Collection, Iterable, Sequence
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
        # The target is on the strip of the last one, or on any in the first trial of a block.
        rng = np.random.default_rng(trial.seed)
        lines = _lines(room, self.strips)
        last_m: float | None = None
        if before is not None and before.along:
            strip, last_m = before.along
        else:
            strip = pick(list(lines), rng)
        line = lines[strip]
        half_m = self.width_m / 2.0
        first_m = half_m
        end_m = line.length_m - half_m
        if end_m - first_m < self.distance_m:
            raise ConfigError(
                f"strip {strip} is {line.length_m:g} m long: no two targets {self.width_m:g} m wide "
                f"are {self.distance_m:g} m apart on it; make task.distance_m smaller"
            )
        at_m = self._next_place(last_m, first_m, end_m, rng)

        # Others are beside it, at places of a grid that leave a gap to the target and to each other.
        pitch_m = 2.0 * self.width_m
        places_m = np.arange(first_m, end_m, pitch_m)
        free = [place_m for place_m in places_m if abs(place_m - at_m) >= pitch_m]
        shuffled: list[int] = rng.permutation(len(free)).tolist()
        others = sorted(shuffled[: self.others])
        places = [at_m, *(float(free[index]) for index in others)]
        objects: list[TrackedObject] = []
        for number, place_m in enumerate(places):
            name = f"t{trial.number}-{number}"
            kind = OTHER if number else TARGET
            objects.append(_on_strip(name, kind, (strip, place_m), line, self.width_m))
        target = objects[0]
        return StudyScene(
            target=target.id,
            name=f"strip {strip} at {at_m:.2f} m",
            width_m=self.width_m,
            target_m=target.position_m,
            objects=tuple(objects),
            along=(strip, at_m),
        )

    def _next_place(
        self, last_m: float | None, first_m: float, end_m: float, rng: np.random.Generator
    ) -> float:
        """Return the place of a target on its strip, m.

        Args:
            last_m: the last place. None: any place will do.
            first_m: least place at which a target fits.
            end_m: largest such place.
            rng: chooses.
        """
        if last_m is None:
            return float(rng.uniform(first_m, end_m))
        both_sides = (last_m - self.distance_m, last_m + self.distance_m)
        fits = [place_m for place_m in both_sides if first_m <= place_m <= end_m]
        if fits:
            return pick(fits, rng)
        return max((first_m, end_m), key=lambda place_m: abs(place_m - last_m))


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
            place, objects = self._on_line(trial, room)
        else:
            place, objects = self._on_circle(trial)
        target = next(item for item in objects if item.kind == TARGET)
        return StudyScene(
            target=target.id,
            name=f"place {place + 1}",
            width_m=self.width_m,
            target_m=target.position_m,
            objects=tuple(objects),
        )

    def _on_line(self, trial: StudyTrial, room: Environment) -> tuple[int, list[TrackedObject]]:
        """Return the number of the target's place, 0 or 1, and both objects on the strip."""
        line = _lines(room, (self.strip,))[self.strip]
        middle_m = line.length_m / 2.0
        half_m = self.distance_m / 2.0
        places_m = [middle_m - half_m, middle_m + half_m]
        if places_m[0] < self.width_m / 2.0:
            raise ConfigError(f"strip {self.strip} is too short for task.distance_m {self.distance_m:g}")
        target_place = trial.place % 2
        objects: list[TrackedObject] = []
        for place, place_m in enumerate(places_m):
            name = f"t{trial.number}-{place}"
            kind = TARGET if place == target_place else OTHER
            position = (self.strip, place_m)
            objects.append(_on_strip(name, kind, position, line, self.width_m))
        return target_place, objects

    def _on_circle(self, trial: StudyTrial) -> tuple[int, list[TrackedObject]]:
        """Return the number of the target's place on the circle, and the objects on it."""
        count = self.targets - 1 + self.targets % 2  # an odd number
        step = (count + 1) // 2
        target_place = trial.place * step % count
        last_place = (trial.place - 1) * step % count
        objects: list[TrackedObject] = []
        for place in range(count):
            if place == last_place:  # where the ray rests, which would be selected first
                continue
            objects.append(
                TrackedObject(
                    id=f"t{trial.number}-{place}",
                    kind=TARGET if place == target_place else OTHER,
                    position_m=self._point_at(2.0 * pi * place / count),
                    length_m=self.width_m,
                )
            )
        return target_place, objects

    def _point_at(self, angle_rad: float) -> Vec3:
        radius_m = self.distance_m / 2.0
        x, y, z = self.center_m
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

        # The target is at any place of the queue, and first in the list.
        rng = np.random.default_rng(trial.seed)
        target_place = int(rng.integers(self.others + 1))
        queue: list[ScenePackage] = []
        for place in range(self.others + 1):
            kind = TARGET if place == target_place else OTHER
            position = START + place * step
            queue.append(ScenePackage(kind=kind, lane=lane, length_m=self.width_m, position=position))
        queue.insert(0, queue.pop(target_place))
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
        buttons = {thing.id: thing for thing in room.fixed_things if thing.mode == "button"}
        _check_known("lamp", self.lamps, lamps)
        _check_known("button", self.things, buttons)
        places = {**self.places, **{lamp: lamps[lamp] for lamp in self.lamps}}
        places |= {name: buttons[name].center_m for name in self.things}
        if not places:
            raise ConfigError("task places needs places, lamps or things")
        name = _next_name(trial, places, before)

        if name in self.things:
            thing = buttons[name]
            # The map's own tracker lists things: the scene adds no object.
            return StudyScene(
                target=thing.id,
                name=name,
                width_m=max(thing.size_m[:2]),
                target_m=places[name],
                lamp=name if name in self.lamps else "",
                say=f"Point at {thing.label or thing.id}.",
            )
        target = TrackedObject(
            id=f"t{trial.number}-0", kind=TARGET, position_m=places[name], length_m=self.width_m
        )
        return StudyScene(
            target=target.id,
            name=name,
            width_m=self.width_m,
            target_m=places[name],
            objects=(target,),
            lamp=name if name in self.lamps else "",
        )


def _next_name(trial: StudyTrial, names: Iterable[str], before: StudyScene | None) -> str:
    """Return the name of any place but the last one, or of this if there is no other."""
    all_names = list(names)
    last_name = None if before is None else before.name
    others = [name for name in all_names if name != last_name]
    return pick(others or all_names, np.random.default_rng(trial.seed))


def _check_known(kind: str, names: Iterable[str], known: Collection[str]) -> None:
    """Check that the map has what is wanted. Raises: ConfigError: If not."""
    unknown = set(names).difference(known)
    if unknown:
        raise ConfigError(f"the map has no {kind} {min(unknown)}; it has {', '.join(known) or 'none'}")


def _lines(room: Environment, wanted: Sequence[str]) -> dict[str, Polyline]:
    lines = {strip.id: Polyline(strip.line_m) for strip in room.strips}
    _check_known("strip", wanted, lines)
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
        name = _next_name(trial, self.places, before)
        say = f"Keep {self.robot} over {name}."
        stay_s: float | None = self.stay_s
        if self.kind == "land":
            say = f"Land {self.robot} at {name}."
            stay_s = None
        return StudyScene(
            target=name,
            name=name,
            width_m=self.width_m,
            target_m=self.places[name],
            robot=self.robot,
            stay_s=stay_s,
            say=say,
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
