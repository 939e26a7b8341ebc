"""Presses at lamps from the places of a home: which come once more, agree, or point at another lamp."""

import math
from collections.abc import Sequence

from pointit.bridges.home_assistant.setup.stored_setup import End, LampPress
from pointit.geometry import vector
from pointit.scan.paced_model import SECOND, PacedRay, paced_ray

MIN_AGAIN = 4
"""Number of lamps and ends from which wide movements of the arm are made up for by pressing once more."""
WIDE_REACH_RAD = math.radians(40.0)
"""Movement of the arm before a press, from which the lamp comes once more."""
JUDGED_AGAIN = 3
MAX_AGAIN_SPREAD_RAD = math.radians(3.0)
"""Rms of the differences of azimuths of lamps that came once more, up to which the others need not."""
BESIDE_RAD = math.radians(6.0)
"""Angle between the presses at two lamps, up to which the person is asked whether they are neighbours."""
AGREEING_RAD = math.radians(14.0)
"""Angle up to which two presses at one lamp from one place agree: three sigma after a wide reach."""


def target_key(lamp: str, end: End) -> str:
    """Return the name of a lamp or of an end of a strip in the fit."""
    return f"{lamp}|{end}"


def angle_between(press: LampPress, other: LampPress) -> float:
    """Return the angle between two presses, rad."""
    return vector.angle_between(press.direction, other.direction)


def presses_at(presses: Sequence[LampPress], target: tuple[str, End], place: str) -> list[LampPress]:
    """Return the presses at a target from a place, in order."""
    return [press for press in presses if press.target == target and press.place == place]


def exactest_press(presses: Sequence[LampPress], place: str) -> LampPress | None:
    """Return the press from a place before which the arm has moved least, or None if there is none."""
    own = [press for press in presses if press.place == place]
    return min(own, key=lambda press: press.reach_rad or math.pi, default=None)


def lamp_beside(presses: Sequence[LampPress], press: LampPress) -> str:
    """Return the lamp nearest to `press` among the others of its place, or `""` if none is so near."""
    nearest = ""
    nearest_rad = BESIDE_RAD
    for other in presses:
        if other.place != press.place or other.target == press.target:
            continue
        angle_rad = angle_between(other, press)
        if angle_rad < nearest_rad:
            nearest = other.lamp
            nearest_rad = angle_rad
    return nearest


def target_apart(presses: Sequence[LampPress], place: str) -> tuple[str, End] | None:
    """Return the target of the newest press if that agrees with none of the others at it from `place`."""
    if not presses or presses[-1].place != place:
        return None
    newest = presses[-1]
    others = presses_at(presses, newest.target, place)[:-1]
    is_alone = all(angle_between(newest, other) > AGREEING_RAD for other in others)
    return newest.target if others and is_alone else None


def targets_again(presses: Sequence[LampPress]) -> list[tuple[str, End]]:
    """Return the targets that come once more at the first place, as they stand around it.

    None does once the person has pointed from the second place: they have come back for one lamp.
    """
    if any(press.place == SECOND for press in presses):
        return []
    first: dict[tuple[str, End], LampPress] = {}
    differences_rad: dict[tuple[str, End], float] = {}
    for press in presses:
        if press.target in first:
            difference_rad = press.azimuth_rad - first[press.target].azimuth_rad
            differences_rad[press.target] = math.remainder(difference_rad, math.tau)
        first.setdefault(press.target, press)

    # Who points well has done enough
    spread_rad = math.hypot(*differences_rad.values()) / math.sqrt(max(len(differences_rad), 1))
    if len(differences_rad) >= JUDGED_AGAIN and spread_rad < MAX_AGAIN_SPREAD_RAD:
        return []
    again: list[tuple[str, End]] = []
    for target, press in first.items():
        is_wide = press.reach_rad is None or press.reach_rad > WIDE_REACH_RAD
        if is_wide and target not in differences_rad:
            again.append(target)
    return sorted(again, key=lambda target: first[target].azimuth_rad)


def rays_of(presses: Sequence[LampPress]) -> list[PacedRay]:
    """Return the rays of presses. Of those at one lamp, only those near the newest one count."""
    rays: list[PacedRay] = []
    for press in presses:
        newest = presses_at(presses, press.target, press.place)[-1]
        if angle_between(press, newest) > AGREEING_RAD:
            continue
        reach_rad = math.pi if press.reach_rad is None else press.reach_rad
        ray = paced_ray(
            target_key(press.lamp, press.end),
            press.place,
            (0.0, 0.0, press.eyes_m),
            press.direction,
            reach_rad,
            spread_rad=press.spread_rad,
            zero=press.zero,
        )
        rays.append(ray)
    return rays


def without_presses(presses: Sequence[LampPress], lamp: str, place: str) -> tuple[LampPress, ...]:
    """Return `presses` without those at a lamp from a place."""
    return tuple(press for press in presses if press.lamp != lamp or press.place != place)
