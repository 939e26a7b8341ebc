"""Homes that simulated people set up, with what goes wrong: are the stated standard deviations true?

Each seed is a room of lamps and a person of `user-sim`: their own bias, and an error for every reach. They do
what the cards say, by the rules of the session, and one thing goes wrong. The right direction to a lamp is
that in which this person points at it: their mean error is in the map and in their pointing alike. It is
compared with the map's from both places and from the middle of the walk, with the yaw of their device there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pointit.bridges.home_assistant.setup.press_rays import PressRays
from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.bridges.home_assistant.setup.stored_setup import ChosenLamp
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.scan.paced_model import FIRST, MAX_DIRECTION_SIGMA_RAD, SECOND
from pointit.schemas import PointingRay
from pointit.services.user_sim.body import OpenLoopError
from pointit.services.user_sim.config import AimConfig
from pointit_lab.evaluation.pointing.two_places import angles
from pointit_lab.evaluation.things.things import Share

Mistake = Literal[
    "none",
    "double press",
    "moving arm",
    "small base line",
    "lamps exchanged",
    "lamp behind",
    "changed zero",
]
MISTAKES: tuple[Mistake, ...] = get_args(Mistake)

LAMPS = (3, 8)
"""Least and largest number of lamps."""
EYES_M = 1.6
"""Assumed height of the eyes, m."""
EYES_SIGMA_M = 0.04
WALK_M = 2.0
WALK_SIGMA_M = 0.4
WALK_AZIMUTH_SIGMA_RAD = 0.35
SMALL_WALK_M = (0.1, 0.6)
"""What they walk instead, uniformly."""
DRIFT_SIGMA_RAD = math.radians(2.0)
"""Drift of the yaw of the device on the walk."""
SECTOR_RAD = math.radians(70.0)
BEHIND_RAD = math.radians(180.0)
MIN_APART_RAD = math.radians(12.0)
"""Least angle between two lamps as seen from the first place."""
DISTANCES_M = (1.5, 4.5)
HEIGHTS_M = (0.3, 2.4)
TREMOR_RAD = math.radians(0.4)
RATE_HZ = 50.0
RAYS = 30
"""Number of rays of a press."""
MOVING_RADPS = (math.radians(5.0), math.radians(90.0))
"""Speeds of an arm that still turns, uniformly."""
DOUBLE_SIGMA_RAD = math.radians(0.7)
"""How far an arm moves between two presses of which one is an accident, per axis."""
MAX_ACTS = 400
"""Number of acts after which a set-up has no end."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlacedError:
    """A lamp that was placed: the worst of its errors from both places and between, in what is stated.

    Attributes:
        error_rad: angle between the stated and the right direction.
        sigma_rad: stated standard deviation of that angle, the worst of the three.
        is_unsure: the card marks the lamp as unsure.
    """

    error_rad: float
    sigma_rad: float
    is_unsure: bool


@dataclass
class HomeResult:
    """One home."""

    mistake: Mistake
    placed: list[PlacedError] = field(default_factory=list)
    left_out: int = 0
    presses: int = 0
    questions: int = 0
    """How often the person was asked whether a lamp is beside another one."""
    refusals: int = 0
    """How often the arm moved."""
    is_walk_noticed: bool = False
    """The card has said that this was less than a step."""


class SimulatedHome:
    """A room, a person, and the progress of their cards."""

    def __init__(self, seed: int, mistake: Mistake) -> None:
        """Draw the room and the person."""
        self._rng = np.random.default_rng(seed)
        rng = self._rng
        self.result = HomeResult(mistake)
        self._mistake = mistake
        self._error = OpenLoopError(AimConfig(), float(rng.random()), rng)
        self._eyes_m = EYES_M + EYES_SIGMA_M * float(rng.standard_normal())
        self._lamps_m = self._room()
        self._second_m = self._walk(is_small=mistake == "small base line")
        self._drift_rad = DRIFT_SIGMA_RAD * float(rng.standard_normal())
        self._yaw_rad = 0.0
        """Yaw of the device beside that at the first place, by drift."""
        self._zero_rad = 0.0
        """Turn of the device's zero."""
        self._previous = np.zeros(2)
        self._time_s = 0.0
        self._rays = PressRays()
        self._meant: dict[tuple[str, str], bool] = {}
        """Whether the newest press at each lamp from each place was meant for it."""

        lamps = tuple(ChosenLamp(id=f"light.{index}") for index in range(len(self._lamps_m)))
        self.progress = SetupProgress()
        self.progress.choose(lamps, ())
        self.progress.take_hand("phone", "person")
        self.progress.on_epoch(1)

        # When and where it goes wrong: at one of the presses, or at two of one place
        count = len(lamps)
        self._wrong_press = int(rng.integers(2, 2 * count))
        self._wrong_place = FIRST if rng.random() < 0.5 else SECOND
        pair = rng.permutation(count)[:2].tolist()
        self._exchanged = {f"light.{pair[0]}": pair[1], f"light.{pair[1]}": pair[0]}

    def _room(self) -> Array:
        """Return the places of lamps, of which one may be behind the person."""
        rng = self._rng
        count = int(rng.integers(LAMPS[0], LAMPS[1] + 1))
        lamps: list[list[float]] = []
        while len(lamps) < count:
            azimuth = float(rng.uniform(-SECTOR_RAD, SECTOR_RAD))
            if self._mistake == "lamp behind" and not lamps:
                azimuth += BEHIND_RAD
            distance_m = float(rng.uniform(*DISTANCES_M))
            lamp = [distance_m * math.cos(azimuth), distance_m * math.sin(azimuth)]
            lamp.append(float(rng.uniform(*HEIGHTS_M)))
            seen = angles(np.array([*lamps, lamp]), (0.0, 0.0, EYES_M))
            if all(np.hypot(*(other - seen[-1])) > MIN_APART_RAD for other in seen[:-1]):
                lamps.append(lamp)
        return np.array(lamps)

    def _walk(self, *, is_small: bool) -> tuple[float, float]:
        rng = self._rng
        length_m = max(WALK_M + WALK_SIGMA_M * float(rng.standard_normal()), 1.2)
        if is_small:
            length_m = float(rng.uniform(*SMALL_WALK_M))
        azimuth_rad = math.pi / 2.0 + WALK_AZIMUTH_SIGMA_RAD * float(rng.standard_normal())
        return (length_m * math.cos(azimuth_rad), length_m * math.sin(azimuth_rad))

    def set_up(self) -> HomeResult:
        """Do what the cards say until all lamps are placed, and return the result."""
        progress = self.progress
        for _ in range(MAX_ACTS):
            if progress.state.step != "place":
                break
            if progress.state.is_short_walk:
                # The person walks as they were asked to
                self.result.is_walk_noticed = True
                self._second_m = self._walk(is_small=False)
                progress.walk()
            elif progress.is_complete:
                progress.on_room(progress.fit())
            elif progress.may_walk:
                progress.walk()
                self._yaw_rad = self._drift_rad
                self._previous = np.zeros(2)
            else:
                self._press_target()
        self._judge()
        return self.result

    def _press_target(self) -> None:
        """Press at the lamp of the card, or at another one by mistake."""
        progress = self.progress
        target = progress.target
        if target is None:
            return
        self.result.presses += 1
        number = self.result.presses
        if self._mistake == "changed zero" and number == self._wrong_press:
            self._zero_rad = float(self._rng.uniform(-math.pi, math.pi))
            progress.on_epoch(2)
            target = progress.target or target
        lamp = int(target[0].partition(".")[2])
        is_exchanged = self._mistake == "lamps exchanged" and progress.state.place == self._wrong_place
        if is_exchanged and not progress.is_aligning:
            lamp = self._exchanged.pop(target[0], lamp)  # once
        # A zero that is lost on the walk is found at the first place
        place_m = self._second_m if progress.place == SECOND else (0.0, 0.0)
        self._yaw_rad = self._drift_rad if progress.place == SECOND else self._yaw_rad
        seen = angles(self._lamps_m, (*place_m, self._eyes_m))[lamp]
        self._error.draw(float(np.hypot(*(seen - self._previous))))
        aim = seen + np.array(self._error.now_rad)
        self._previous = seen
        speed_radps = 0.0
        if self._mistake == "moving arm" and number == self._wrong_press:
            speed_radps = float(self._rng.uniform(*MOVING_RADPS))
        self._press(aim, speed_radps, is_meant=lamp == int(target[0].partition(".")[2]))
        if self._mistake == "double press" and number == self._wrong_press and progress.target is not None:
            self._press(aim + DOUBLE_SIGMA_RAD * self._rng.standard_normal(2), 0.0, is_meant=False)

    def _press(self, aim: Array, speed_radps: float, *, is_meant: bool) -> None:
        """Press while the arm points at `aim` (azimuth, elevation), or will at the end of its movement."""
        azimuth = float(aim[0]) + self._yaw_rad + self._zero_rad
        for index in range(RAYS):
            self._time_s += 1.0 / RATE_HZ
            remaining_rad = speed_radps * (RAYS - 1 - index) / RATE_HZ
            shaken = np.array([azimuth - remaining_rad, aim[1]]) + TREMOR_RAD * self._rng.standard_normal(2)
            ray = PointingRay(stamp_ns=0, origin_m=(0.0, 0.0, EYES_M), direction=_direction(shaken))
            self._rays.add(self._time_s, ray)
            self.progress.on_arm(ray.direction)
        try:
            press = self._rays.direction_at(self._time_s, "person")
        except RefusedError:
            self.result.refusals += 1
            return
        progress = self.progress
        target = progress.target
        was_aligning = progress.is_aligning
        progress.press(press.azimuth_rad, press.elevation_rad, press.eyes_m, press.spread_rad)
        self._time_s += 1.0
        if target is None or was_aligning:
            return
        place = progress.state.place
        if progress.beside:
            self.result.questions += 1
            self._answer(is_meant=is_meant)
        if not progress.beside:
            self._meant[target[0], place] = is_meant

    def _answer(self, *, is_meant: bool) -> None:
        """Answer whether the lamp is beside another one, as somebody who knows what they have done."""
        progress = self.progress
        if not is_meant:
            progress.take_back()
        elif self._meant[progress.beside, progress.state.place]:
            progress.confirm()
        else:
            progress.replace_beside()

    def _judge(self) -> None:
        state = self.progress.state
        self.result.left_out = len(self._lamps_m) - len(state.placed)
        bias = np.array([0.0, self._error.bias_rad])
        shares = (0.0, 1.0, 0.5) if len(state.places_m) > 1 else (0.0,)
        for placed in state.placed:
            lamp = int(placed.lamp.partition(".")[2])
            worst_rad = 0.0
            for share in shares:
                x, y = share * self._second_m[0], share * self._second_m[1]
                right = angles(self._lamps_m[lamp : lamp + 1], (x, y, self._eyes_m))[0] + bias
                right[0] += share * self._drift_rad
                mapped_m = np.array([placed.position_m])
                from_m = (0.0, 0.0)
                if len(state.places_m) > 1:
                    from_m = (share * state.places_m[1][0], share * state.places_m[1][1])
                mapped = angles(mapped_m, (*from_m, EYES_M))[0]
                mapped[0] += share * state.drift_rad
                cosine = float(np.dot(_direction(right), _direction(mapped)))
                worst_rad = max(worst_rad, math.acos(min(max(cosine, -1.0), 1.0)))
            is_unsure = placed.is_unsure or placed.direction_sigma_rad > MAX_DIRECTION_SIGMA_RAD
            self.result.placed.append(PlacedError(worst_rad, placed.direction_sigma_rad, is_unsure))


def _direction(angles_rad: Sequence[float] | Array) -> Vec3:
    azimuth, elevation = angles_rad
    level = math.cos(elevation)
    return (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))


def simulate_home(trial: tuple[int, Mistake]) -> HomeResult:
    """Return the result of a seed and what goes wrong there."""
    seed, mistake = trial
    return SimulatedHome(seed, mistake).set_up()


@dataclass(frozen=True)
class HomeRow:
    """All homes in which the same went wrong.

    Attributes:
        within: share of the lamps that are stated as sure with an error of at most twice the stated value.
        beyond: number of those with more than three times that.
        unsure: share of the placed lamps that are marked as unsure.
        error_deg, sigma_deg: medians of those that are sure.
        noticed: share of the homes in which the card has asked or refused something.
    """

    mistake: Mistake | Literal["all"]
    homes: int
    lamps: int
    left_out: int
    presses: float
    within: Share
    beyond: int
    unsure: Share
    error_deg: float
    sigma_deg: float
    noticed: Share


def row_of(mistake: Mistake | Literal["all"], results: Sequence[HomeResult]) -> HomeRow:
    """Return the row of `results`, of homes with the same mistake or of all."""
    placed: list[PlacedError] = []
    for result in results:
        placed += result.placed
    sure = [lamp for lamp in placed if not lamp.is_unsure]
    noticed = 0
    for result in results:
        is_noticed = result.questions or result.refusals or result.is_walk_noticed or result.left_out
        noticed += bool(is_noticed)
    within = sum(lamp.error_rad <= 2.0 * lamp.sigma_rad for lamp in sure)
    return HomeRow(
        mistake=mistake,
        homes=len(results),
        lamps=len(placed),
        left_out=sum(result.left_out for result in results),
        presses=float(np.mean([result.presses for result in results])),
        within=Share(within, len(sure)),
        beyond=sum(lamp.error_rad > 3.0 * lamp.sigma_rad for lamp in sure),
        unsure=Share(len(placed) - len(sure), len(placed)),
        error_deg=math.degrees(float(np.median([lamp.error_rad for lamp in sure]))),
        sigma_deg=math.degrees(float(np.median([lamp.sigma_rad for lamp in sure]))),
        noticed=Share(noticed, len(results)),
    )
