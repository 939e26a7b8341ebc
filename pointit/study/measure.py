"""One attempt at a trial, measured: messages and the time go in, the outcome and the measures come out."""

import importlib.util
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pointit.errors import ConfigError
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Announced,
    ButtonEvent,
    Cursor,
    Hover,
    Localization,
    RobotState,
    SelectionEvent,
    Step,
)
from pointit.study.table_file import REPEATED, SPOKEN, Outcome, utc

STEP_RAD = math.radians(0.5)
"""Step of the ray that counts as way: smaller ones are tremor and noise."""
SILENT_S = 2.0
"""Time without a ray after which the wrist counts as lost, s."""
PRESS_S = 0.5
"""Time after a press within which a selection is its effect, s."""


@dataclass(slots=True, kw_only=True)
class Attempt:
    """The measures of one attempt. Times are stamps of the site, ns."""

    began_ns: int
    target: str
    target_m: Vec3
    """Centre of the target, {W}; kept up to date while it moves."""
    width_m: float
    end: str
    """`selection`, `press` or `timeout`; any other: `end_rule` ends it."""
    timeout_s: float
    end_rule: Callable[["Attempt"], str | None] | None = None
    """Called with each cursor; `hit` or `wrong` ends the attempt."""
    before_m: Vec3 | None = None
    """Centre of the last target, the start of the way to this one, or None for the first cursor."""
    stay_s: float | None = None
    """Time over the target for which a robot stays, s. None: it lands."""
    reached_m: Vec3 | None = None
    """Position of the robot, or the one that was found: it stands for the cursor."""
    outcome: Outcome | None = None
    reason: str = ""
    is_repeated: bool = False
    """True if its trial is done again."""
    first_hover_s: float | None = None
    selection_s: float | None = None
    corrections: int = 0
    names: Counter[str] | None = None
    """Numbers of the columns `SPOKEN`. None if names are not spoken to the participant."""
    path_rad: float = 0.0
    passed_s: float = 0.0
    """Time from the beginning to the last cursor, s."""
    hovered: str = ""
    """Id of the object under the cursor, or `""`."""
    cursor: Cursor | None = None
    """The last cursor."""
    clock_apart_s: float = 0.0
    """Largest difference between the site's time and the stamp of a cursor, s."""
    _first: Cursor | None = None
    _first_m: Vec3 | None = None
    """Centre of the target at that time."""
    _received_ns: int = 0
    _step_start: Vec3 | None = None
    _pressed_ns: int | None = None
    _over_ns: int | None = None
    """Time since which the robot is over the target."""
    _has_flown: bool = False

    def on_cursor(self, cursor: Cursor, now_ns: int) -> None:
        """Process a cursor that has arrived at `now_ns`."""
        if self.outcome is not None:
            return
        self._received_ns = now_ns
        self.clock_apart_s = max(self.clock_apart_s, abs(now_ns - cursor.stamp_ns) / NS_PER_S)
        if cursor.direction is None:
            return
        if self._first is None:
            self._first = cursor
            self._first_m = self.target_m
        self.cursor = cursor

        # The path is summed in steps, so that noise adds nothing.
        if self._step_start is None:
            self._step_start = cursor.direction
        step_rad = vector.angle_between(self._step_start, cursor.direction)
        if step_rad >= STEP_RAD:
            self.path_rad += step_rad
            self._step_start = cursor.direction

        self.passed_s = self._passed_s(now_ns)
        if self.end_rule is None:
            return
        verdict = self._verdict(self.end_rule)
        if verdict is not None:
            self._finish(verdict, "", now_ns)

    def _verdict(self, end: "Callable[[Attempt], str | None]") -> Literal["hit", "wrong"] | None:
        try:
            verdict = end(self)
        except Exception as error:
            raise ConfigError(f"end: the study's function fails ({type(error).__name__}: {error})") from error
        match verdict:
            case None:
                return None
            case "hit":
                return "hit"
            case "wrong":
                return "wrong"
            case _:
                raise ConfigError(
                    f"end: the study's function returns {verdict!r}; return 'hit', 'wrong' or None"
                )

    def on_hover(self, hover: Hover, now_ns: int) -> None:
        """Process a hover that has arrived at `now_ns`."""
        if self.outcome is not None or hover.object_id == self.hovered:
            return
        if hover.object_id == self.target and self.first_hover_s is None:
            self.first_hover_s = self._passed_s(now_ns)
        self.corrections += self.hovered == self.target
        self.hovered = hover.object_id

    def on_selection(self, event: SelectionEvent, now_ns: int) -> None:
        """Process what happened to an object."""
        if self.outcome is not None:
            return
        if event.event in ("selected", "deselected") and event.cause == "button":
            self._count("confirmed")
        if event.event == "selected" and self.end in ("selection", "press"):
            if event.object_id == self.target:
                self._finish("hit", "", now_ns)
            else:
                self._finish("wrong", f"selected {event.object_id}", now_ns)
        elif event.event in ("left", "dispatched") and event.object_id == self.target:
            self._finish("timeout", "the target has left", None)

    def on_announced(self, announced: Announced, now_ns: int) -> None:
        """Process the name of an object that is spoken to the participant."""
        del now_ns
        if self.outcome is None:
            self.names = Counter() if self.names is None else self.names
            self.names["announced"] += bool(announced.object_id)

    def on_step(self, step: Step, now_ns: int) -> None:
        """Process a step of the participant to the object beside the announced one."""
        del step, now_ns
        if self.outcome is None:
            self._count("stepped")

    def _count(self, column: str) -> None:
        if self.names is not None:
            self.names[column] += 1

    def on_press(self, event: ButtonEvent, now_ns: int) -> None:
        """Process a press of the person's button."""
        if self.end == "press" and event.gesture == "press" and self._pressed_ns is None:
            self._pressed_ns = now_ns

    def on_robot(self, robot: RobotState, now_ns: int) -> None:
        """Process the state of the robot that stands for the cursor; end when it lands, or has stayed."""
        if self.outcome is not None:
            return
        self.reached_m = (*robot.position_m[:2], self.target_m[2])  # below it
        is_over = self._is_near(self.reached_m)
        self.on_hover(Hover(stamp_ns=now_ns, object_id=self.target if is_over else ""), now_ns)
        if not is_over:
            self._over_ns = None
        elif not self._over_ns:
            self._over_ns = now_ns

        has_landed = robot.phase == "landed" and self._has_flown
        if self.stay_s is None and has_landed:
            if is_over:
                self._finish("hit", "", now_ns)
            else:
                self._finish("wrong", "landed beside", now_ns)
        elif self.stay_s is not None and self._over_ns:
            if now_ns - self._over_ns >= self.stay_s * NS_PER_S:
                self._finish("hit", "", now_ns)
        self._has_flown |= robot.phase not in ("landed", "lost")

    def on_localization(self, state: Localization, position_m: Vec3 | None, now_ns: int) -> None:
        """Process the progress of a localization, and the last found position; end with it."""
        self._received_ns = now_ns
        if self.outcome is not None or state.since_ns < self.began_ns:
            return
        if state.phase == "solved" and position_m is not None:
            self.reached_m = position_m
            if self._is_near(position_m):
                self._finish("hit", "", now_ns)
            else:
                self._finish("wrong", "too far off", now_ns)
        elif state.phase in ("refused", "cancelled"):
            self._finish("wrong", state.reason or state.phase, None)

    def _is_near(self, point_m: Vec3) -> bool:
        return math.dist(point_m[:2], self.target_m[:2]) <= self.width_m / 2.0

    def tick(self, now_ns: int) -> None:
        """End the attempt if it is time, or if the wrist is lost."""
        if self.outcome is not None:
            return
        if now_ns - max(self._received_ns, self.began_ns) > SILENT_S * NS_PER_S:
            self.repeat(f"no ray for {SILENT_S:g} s, the wrist is lost")
        elif self._pressed_ns is not None and now_ns - self._pressed_ns > PRESS_S * NS_PER_S:
            self._finish("wrong", "pressed beside", self._pressed_ns)
        elif self._passed_s(now_ns) >= self.timeout_s:
            is_on = self.end == "timeout" and self.hovered == self.target
            self._finish("hit" if is_on else "timeout", "", None)

    def abandon(self, reason: str) -> None:
        """End it without a result."""
        if self.outcome is None:
            self.outcome = "skipped"
            self.reason = reason

    def repeat(self, reason: str) -> None:
        """End it without a result: its trial is done again."""
        if self.outcome is None:
            self.is_repeated = True
            self.abandon(f"{REPEATED}: {reason}")

    def columns(self) -> dict[str, str | float | int | None]:
        """Return outcome and measures by their columns."""
        first = self._first
        last = self.cursor

        # The selected point: what a robot or localization reached, else the cursor.
        point_m = self.reached_m
        if point_m is None and last is not None:
            point_m = last.point_m or _nearest(last, self.target_m)

        # The start: the target before, else the first cursor.
        first_target_m = self._first_m or self.target_m
        start_m = self.before_m
        if start_m is None and first is not None:
            start_m = first.point_m

        width_deg: float | None = None
        if last is not None and last.origin_m is not None:
            eyes_to_target_m = math.dist(last.origin_m, self.target_m)
            if eyes_to_target_m:
                half_width_rad = math.atan2(self.width_m / 2.0, eyes_to_target_m)
                width_deg = math.degrees(2.0 * half_width_rad)

        error_m = None if point_m is None else math.dist(point_m, self.target_m)
        distance_m = None if start_m is None else math.dist(start_m, first_target_m)
        columns: dict[str, str | float | int | None] = {
            "outcome": self.outcome,
            "reason": self.reason,
            "began_utc": utc(self.began_ns),
            "first_hover_s": self.first_hover_s,
            "selection_s": self.selection_s,
            "corrections": self.corrections,
            "path_length_deg": math.degrees(self.path_rad),
            "error_m": error_m,
            "error_deg": _angle_deg(last, self.target_m),
            "target_distance_m": distance_m,
            "target_width_m": self.width_m,
            "target_distance_deg": _angle_deg(first, first_target_m, self.before_m),
            "target_width_deg": width_deg,
        }
        for name in SPOKEN:
            columns[name] = None if self.names is None else self.names[name]
        for index, axis in enumerate("xyz"):
            columns[f"target_{axis}_m"] = self.target_m[index]
            columns[f"selected_{axis}_m"] = None if point_m is None else point_m[index]
        return columns

    def _finish(self, outcome: Outcome, reason: str, selected_ns: int | None) -> None:
        self.outcome = outcome
        self.reason = reason
        self.selection_s = None if selected_ns is None else self._passed_s(selected_ns)

    def _passed_s(self, now_ns: int) -> float:
        return (now_ns - self.began_ns) / NS_PER_S


def _nearest(cursor: Cursor, target_m: Vec3) -> Vec3 | None:
    """Return the point of the ray nearest to the target, which stands for a cursor where no surface is."""
    if cursor.direction is None or cursor.origin_m is None:
        return None
    along_m = vector.dot(vector.subtract(target_m, cursor.origin_m), cursor.direction)
    if along_m <= 0:  # behind the person
        return None
    return vector.add(cursor.origin_m, vector.scale(cursor.direction, along_m))


def _angle_deg(cursor: Cursor | None, target_m: Vec3, from_m: Vec3 | None = None) -> float | None:
    """Return the angle at the eyes from the ray, or from the point `from_m`, to `target_m`, deg."""
    if cursor is None or cursor.direction is None or cursor.origin_m is None:
        return None
    to_target = vector.subtract(target_m, cursor.origin_m)
    start = cursor.direction if from_m is None else vector.subtract(from_m, cursor.origin_m)
    has_directions = vector.norm(to_target) * vector.norm(start) != 0.0
    return math.degrees(vector.angle_between(start, to_target)) if has_directions else None


def load_end_rule(end: str, folder: Path) -> Callable[[Attempt], str | None] | None:
    """Return the function that ends a trial, or None if none does.

    Raises: ConfigError: If there is no such file or function, or the file fails.
    """
    name, _, function = end.partition(".py:")
    if not function:
        return None
    path = folder / f"{name}.py"
    spec = importlib.util.spec_from_file_location(Path(name).name, path)
    if spec is None or spec.loader is None or not path.exists():
        raise ConfigError(f"end: there is no file {path}")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        found: Callable[[Attempt], str | None] = getattr(module, function)
    except (Exception, SystemExit) as error:
        raise ConfigError(f"end: {path} cannot be used ({type(error).__name__}: {error})") from error
    return found
