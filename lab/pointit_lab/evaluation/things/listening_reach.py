"""A simulated person who hears names and reacts: turns to the right thing, steps to it, presses.

No person was recorded: every figure of `ListenerModel` is an assumption.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit_lab.evaluation.things.reach import LOST_S, SEARCH_RAD, ArmReach

AnnounceWay = Literal["names", "names+step", "names+dwell"]
"""Names and a press; the same and steps to neighbours; names alone, staying selects."""


@dataclass(frozen=True, kw_only=True)
class ListenerModel:
    """Times, s, and shares of hearing, stepping and pressing."""

    speech_delay_s: float = 0.1
    word_s: float = 0.6
    word_spread: float = 0.2
    missed: float = 0.03
    confused: float = 0.005
    cut_s: float = 0.35
    """A name that another one cuts off before this time is not understood."""
    landing_s: float = 0.15
    """A wrong name that began earlier before the end of a movement counts only if no other one follows."""
    settled_s: float = 0.35
    """Time after the end of a movement in which another name follows."""
    hand_s: float = 0.1
    gain: float = 0.8
    """Share of the angle between the heard thing and the right one by which the arm moves."""
    gain_spread: float = 0.25
    first_step_s: float = 0.35
    step_s: float = 0.18
    slipped: float = 0.03
    press_s: float = 0.15
    """Time until a press is reported."""
    press_missed: float = 0.05
    press_again_s: float = 0.9
    jolt_rad: float = math.radians(1.5)
    jolt_s: float = 0.2
    false_presses_per_min: float = 0.5


class ListeningReach(ArmReach):
    """A reach whose person hears names instead of seeing lights."""

    def __init__(
        self,
        eyes_m: Vec3,
        targets_m: dict[str, Vec3],
        goal: str,
        rng: np.random.Generator,
        begin: ArmReach | None = None,
        *,
        way: AnnounceWay,
        model: ListenerModel,
        cells: Mapping[str, tuple[int, int]],
        bias_deg: float | None = None,
    ) -> None:
        """Begin as `ArmReach`. `cells`: row and column, from left, of each thing that can be heard."""
        super().__init__(eyes_m, targets_m, goal, rng, begin, bias_deg=bias_deg)
        self._way, self._model, self._cells = way, model, cells
        self._word: tuple[float, float, str] | None = None
        """Begin of the name that is being heard, the time at which it is understood, and the thing."""
        self._action_s = (0.0, self.took_s)
        """Begin and end of the last movement or steps: names from before do not count."""
        self._steps: list[tuple[float, int]] = []
        self._turn: tuple[float, str] | None = None
        """Time of the next correction by the arm, and the thing that was heard."""
        self._passed: tuple[float, str] | None = None
        """Time from which the name counts that was heard before a movement ended, and the thing."""
        self._press_s = math.inf
        self._reports: list[float] = []
        self._jolted_s = -math.inf
        self._jolt = np.zeros(2)
        self._announced_s = self.took_s
        self._false_s = self._next_false_s(0.0)

    def hear(self, time_s: float, name: str) -> None:
        """Begin to hear `name`. It cuts off the one before."""
        model, rng = self._model, self._rng
        if self._word is not None and time_s - self._word[0] < model.cut_s:
            self._word = None
        elif self._word is not None:
            self._understand(*self._word)
            self._word = None
        self._passed = None
        if rng.random() < model.missed:
            return
        others = sorted(set(self._cells) - {name})
        if others and rng.random() < model.confused:
            name = others[int(rng.integers(len(others)))]
        took_s = model.word_s * max(1.0 + model.word_spread * float(rng.standard_normal()), 0.2)
        self._word = (time_s, time_s + model.speech_delay_s + took_s, name)

    def act(self, time_s: float) -> tuple[list[int], bool]:
        """Return the steps that are made now, and True if a press is reported now."""
        if self._word is not None and time_s >= self._word[1]:
            word, self._word = self._word, None
            self._understand(*word)
        if self._passed is not None and time_s >= self._passed[0]:
            name, self._passed = self._passed[1], None
            self._react(time_s, name)
        if self._turn is not None and time_s >= self._turn[0]:
            self._turn_from(time_s, self._turn[1])
        elif self._goal in self._cells and self._is_lost(time_s):
            self._search(time_s)
        steps = [by for at_s, by in self._steps if at_s <= time_s]
        self._steps = [step for step in self._steps if step[0] > time_s]
        if time_s >= self._press_s:
            self._press(time_s)
        if time_s >= self._false_s:
            self._jolt_at(time_s)
            self._reports.append(time_s + self._model.press_s)
            self._false_s = self._next_false_s(time_s)
        is_pressed = any(report_s <= time_s for report_s in self._reports)
        self._reports = [report_s for report_s in self._reports if report_s > time_s]
        return steps, is_pressed

    def direction(self, time_s: float) -> Vec3:
        """Return the unit direction of the ray at `time_s`."""
        super().direction(time_s)
        share = (time_s - self._jolted_s) / self._model.jolt_s
        jolt = math.sin(math.pi * share) ** 2 * self._jolt if 0.0 <= share <= 1.0 else np.zeros(2)
        return vector.direction(float(self.now[0] + jolt[0]), float(self.now[1] + jolt[1]))

    def _understand(self, began_s: float, understood_s: float, name: str) -> None:
        if began_s < self._action_s[0]:
            return  # it is of before the arm or the crown has moved
        self._announced_s = understood_s
        if name != self._goal and began_s < self._action_s[1] - self._model.landing_s:
            # of what the arm passes, or on which it lands: then no other name follows
            self._passed = (max(understood_s, self._action_s[1] + self._model.settled_s), name)
            return
        self._react(understood_s, name)

    def _react(self, understood_s: float, name: str) -> None:
        if name == self._goal:
            if self._way != "names+dwell" and self._press_s == math.inf:
                self._press_s = understood_s + self._model.hand_s
            return
        self._press_s = math.inf
        here, there = self._cells[name], self._cells.get(self._goal)
        if there is not None and self._way == "names+step" and here[0] == there[0]:
            self._plan_steps(understood_s, there[1] - here[1])
        elif there is not None:
            self._turn = (understood_s + self._model.hand_s, name)
            self._action_s = (understood_s, self._turn[0] + self._aim.correction_s)

    def _plan_steps(self, time_s: float, count: int) -> None:
        model, by = self._model, 1 if count > 0 else -1
        at_s = time_s + model.first_step_s
        self._steps = []
        for _ in range(abs(count)):
            made = int(self._rng.integers(2)) * 2 if self._rng.random() < model.slipped else 1
            self._steps += [(at_s, by)] * made
            at_s += model.step_s
        last_s = at_s - model.step_s
        self._action_s = (last_s - 1e-6, last_s)  # the name of the last step counts
        self._announced_s = last_s

    def _is_lost(self, time_s: float) -> bool:
        silent_s = time_s - max(self._announced_s, self._action_s[1])
        return self._word is None and not self._steps and silent_s > LOST_S + self._model.word_s

    def _turn_from(self, time_s: float, name: str) -> None:
        self._turn = None
        gain = self._model.gain * (1.0 + self._model.gain_spread * float(self._rng.standard_normal()))
        self._corrected += gain * (self._at[self._goal] - self._at[name])
        self._move(time_s, self._aim.correction_s)

    def _search(self, time_s: float) -> None:
        beside = np.array(SEARCH_RAD[self._tries % len(SEARCH_RAD)])
        self._tries += 1
        self._corrected += beside
        self._move(time_s, self._aim.correction_s)
        self._corrected -= beside
        self._action_s = (time_s, time_s + self._aim.correction_s)

    def _press(self, time_s: float) -> None:
        self._press_s = time_s + self._model.press_again_s  # unless it works
        self._jolt_at(time_s)
        if self._rng.random() >= self._model.press_missed:
            self._reports.append(time_s + self._model.press_s)

    def _jolt_at(self, time_s: float) -> None:
        self._jolted_s = time_s
        turned = float(self._rng.uniform(0.0, math.tau))
        self._jolt = self._model.jolt_rad * np.array([math.cos(turned), math.sin(turned)])

    def _next_false_s(self, time_s: float) -> float:
        rate = self._model.false_presses_per_min / 60.0
        return time_s + float(self._rng.exponential(1.0 / rate)) if rate else math.inf
