"""A simulated person who says one or two deictic words and points meanwhile, with recorded errors of aim."""

import math
from dataclasses import dataclass

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Cursor
from pointit.services.listener.referents import Target
from pointit_lab.evaluation.things.reach import RATE_HZ, ArmReach
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
WIDEST_DEG = 80.0
"""Width of a row of five things; of wider ones there are three."""
NOTHING = "nothing"


@dataclass(frozen=True, kw_only=True)
class SpokenScene:
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
        count = 5 if 4 * self.apart_deg <= WIDEST_DEG else 3
        angles = [math.radians(self.apart_deg) * (index - (count - 1) / 2.0) for index in range(count)]
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
    """Words of a person with their true referents and the recorded cursors."""

    goals: tuple[str, ...]
    words_ns: tuple[int, ...]
    """Middle of each word as the recogniser tells it."""
    presses_ns: tuple[int, ...]
    """A press for each word, of the same person without speech."""
    cursors: tuple[Cursor, ...]


def speak(scene: SpokenScene, seed: int) -> Utterance:
    """Return the words and gestures of one person, whose seed is `seed`.

    Who says two words waits with the second one until the arm can be there.
    """
    key = [seed, round(10 * scene.apart_deg), scene.words, int(scene.is_nothing)]
    rng = np.random.default_rng(key)
    places_m = {target.name: target.center_m for target in scene.targets()}
    goals = [str(name) for name in rng.permutation(list(places_m))[: scene.words]]
    if scene.is_nothing:
        places_m[NOTHING] = _beside(list(places_m.values()), rng)
        goals = [NOTHING] * scene.words
    places_m["rest"] = vector.add(EYES_M, vector.direction(rng.uniform(-0.5, 0.5), -0.6))
    reach = ArmReach(EYES_M, places_m, "rest", rng)
    cursors: list[Cursor] = []
    words_s: list[float] = []
    presses_s: list[float] = []
    now_s, ready_s, word_s = 0.0, 1.5, 2.5
    for index, goal in enumerate(goals):
        next_reach = ArmReach(EYES_M, places_m, goal, np.random.default_rng([*key, index]), reach)
        lag_s = float(rng.normal(*LAG_S))
        leaves_s = max(word_s + lag_s - next_reach.took_s, ready_s)
        now_s = _move(reach, now_s, leaves_s, cursors)
        reach = ArmReach(EYES_M, places_m, goal, np.random.default_rng([*key, index]), reach)
        arrived_s = now_s + reach.took_s
        words_s.append(arrived_s - lag_s)
        presses_s.append(arrived_s + float(rng.normal(*PRESS_S)))
        ready_s = arrived_s + float(rng.uniform(*HOLD_S))
        word_s = words_s[-1] + float(rng.uniform(*NEXT_S))
    now_s = _move(reach, now_s, ready_s, cursors)
    _move(ArmReach(EYES_M, places_m, "rest", rng, reach), now_s, now_s + 1.5, cursors)
    recognised_s = [each + float(rng.normal(0.0, RECOGNISER_S)) for each in words_s]
    return Utterance(
        goals=tuple(goals),
        words_ns=tuple(_ns(each) for each in recognised_s),
        presses_ns=tuple(_ns(each) for each in presses_s),
        cursors=tuple(cursors),
    )


def _move(reach: ArmReach, from_s: float, to_s: float, cursors: list[Cursor]) -> float:
    """Add the cursors of `reach`, which began at `from_s`, until `to_s`. Return the time of the end."""
    steps = max(round((to_s - from_s) * RATE_HZ), 0)
    for step in range(steps):
        direction = reach.direction(step / RATE_HZ)
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
