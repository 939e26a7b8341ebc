"""A simulated person who says one or two deictic words and points meanwhile, with recorded errors of aim."""

import math
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor
from pointit.services.listener.surroundings import Target
from pointit_lab.evaluation.things.reach import RATE_HZ, Reach
from pointit_lab.evaluation.things.things import BESIDE_RAD, EYES_M, START_NS

LAG_S = (-0.1, 0.3)
"""Mean and standard deviation of the time from the middle of a word to the arrival of the arm, s."""
RECOGNISER_S = 0.2
"""Standard deviation of the error of the times that a recogniser tells, s."""
HOLD_S = (0.3, 1.2)
"""Range of the time for which the arm stays where it has arrived, s."""
NEXT_S = (0.8, 1.6)
"""Range of the time from one deictic word to the next, s."""
PRESS_S = (0.25, 0.1)
"""Mean and standard deviation of the time from the arrival to a press, s."""
WORD_S = 0.3
"""Length of a word, s."""
SIZE_M = 0.2
AWAY_M = 2.5
COUNT = 5
"""Number of things in a row."""
NOTHING = "nothing"


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Things before a person, at equal angles."""

    apart_deg: float
    words: int = 1
    is_nothing: bool = False
    """True if people mean nothing of what is there."""

    @property
    def name(self) -> str:
        """Return its name in the table."""
        words = "1 word" if self.words == 1 else f"{self.words} words"
        return f"{self.apart_deg:g}° apart, {'nothing meant' if self.is_nothing else words}"

    def targets(self) -> list[Target]:
        """Return the things."""
        angles = [math.radians(self.apart_deg) * (index - (COUNT - 1) / 2.0) for index in range(COUNT)]
        return [
            Target(
                kind="thing",
                name=f"t{index}",
                center_m=(AWAY_M * math.cos(angle), AWAY_M * math.sin(angle), 1.3),
                size_m=(SIZE_M, SIZE_M, SIZE_M),
            )
            for index, angle in enumerate(angles)
        ]


@dataclass(frozen=True, kw_only=True)
class Utterance:
    """What a person meant, and what was recorded of it."""

    goals: tuple[str, ...]
    words_ns: tuple[int, ...]
    """Middle of each word as the recogniser tells it."""
    presses_ns: tuple[int, ...]
    """A press for each word, of the same person without speech."""
    cursors: tuple[Cursor, ...]


def speak(scene: Scene, seed: int) -> Utterance:
    """Return what one person says and does; `seed` is that of the person."""
    rng = np.random.default_rng([seed, round(10 * scene.apart_deg), scene.words, int(scene.is_nothing)])
    places_m = {target.name: target.center_m for target in scene.targets()}
    names = list(places_m)
    goals = [str(name) for name in rng.permutation(names)[: scene.words]]
    if scene.is_nothing:
        places_m[NOTHING] = _beside(list(places_m.values()), rng)
        goals = [NOTHING] * scene.words
    words_s = np.cumsum([2.5, *(rng.uniform(*NEXT_S) for _ in goals[1:])])
    arrivals_s = words_s + rng.normal(*LAG_S, len(goals))
    places_m["rest"] = vector.add(EYES_M, vector.direction(rng.uniform(-0.5, 0.5), -0.6))
    arm = Reach(EYES_M, places_m, "rest", rng)
    cursors: list[Cursor] = []
    presses_s: list[float] = []
    now_s = 0.0
    for index, goal in enumerate(goals):
        reach_s, now_s = _until_reach(arm, places_m, goal, float(arrivals_s[index]), cursors, now_s, rng)
        arm = reach_s
        arrived_s = now_s + arm.took_s
        presses_s.append(arrived_s + float(rng.normal(*PRESS_S)))
        ends_s = arrived_s + float(rng.uniform(*HOLD_S))
        now_s = _move(arm, now_s, ends_s, cursors)
    arm = Reach(EYES_M, places_m, "rest", rng, arm)
    _move(arm, now_s, now_s + 1.5, cursors)
    told_s = words_s + rng.normal(0.0, RECOGNISER_S, len(goals))
    return Utterance(
        goals=tuple(goals),
        words_ns=tuple(_ns(float(each)) for each in told_s),
        presses_ns=tuple(_ns(each) for each in presses_s),
        cursors=tuple(cursors),
    )


def _until_reach(
    arm: Reach,
    places_m: dict[str, Vec3],
    goal: str,
    arrival_s: float,
    cursors: list[Cursor],
    now_s: float,
    rng: np.random.Generator,
) -> tuple[Reach, float]:
    """Keep the arm where it is until it has to leave for `goal`. Return the reach, and when it begins."""
    state = rng.bit_generator.state
    took_s = Reach(EYES_M, places_m, goal, rng, arm).took_s  # of the same reach, which begins where it is now
    rng.bit_generator.state = state
    now_s = _move(arm, now_s, max(arrival_s - took_s, now_s), cursors)
    rng.bit_generator.state = state
    return Reach(EYES_M, places_m, goal, rng, arm), now_s


def _move(arm: Reach, from_s: float, to_s: float, cursors: list[Cursor]) -> float:
    """Add the cursors of `arm`, which began at `from_s`, until `to_s`. Return the time of the end."""
    steps = max(round((to_s - from_s) * RATE_HZ), 0)
    for step in range(steps):
        direction = arm.direction(step / RATE_HZ)
        stamp_ns = _ns(from_s + step / RATE_HZ)
        cursors.append(Cursor(stamp_ns=stamp_ns, origin_m=EYES_M, direction=direction))
    return from_s + steps / RATE_HZ


def _beside(things_m: list[Vec3], rng: np.random.Generator) -> Vec3:
    """Return a point that is beside all things by more than people err."""
    while True:
        azimuth, elevation = rng.uniform(-1.2, 1.2), rng.uniform(-0.5, 0.5)
        point_m = vector.add(EYES_M, vector.scale(vector.direction(azimuth, elevation), AWAY_M))
        sight = vector.subtract(point_m, EYES_M)
        away = (vector.angle_between(sight, vector.subtract(each, EYES_M)) for each in things_m)
        if min(away) > BESIDE_RAD:
            return point_m


def _ns(time_s: float) -> int:
    return START_NS + round(time_s * NS_PER_S)
