"""Places of lamps: as the presses say, side by side for a trial, or exchanged."""

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

from pointit.bridges.home_assistant.setup.lamp_presses import target_key
from pointit.bridges.home_assistant.setup.stored_setup import End, LampPress, PlacedLamp, StoredSetup
from pointit.scan.paced_model import MIN_HEIGHT_M, USUAL_M, PacedRoom

L = TypeVar("L", LampPress, PlacedLamp)

ROW_LAMPS = 8
"""Number of lamps side by side for a trial: more are told apart in several rows."""
ROW_STEP_M = 0.7
"""Difference of the heights of two rows."""
TRIAL_SPREAD_RAD = math.radians(60.0)
TRIAL_HEIGHT_M = 1.4
"""Azimuth of the outermost lamps, and height of all, if nobody points at them: for a trial with the mouse."""


def placed_in(room: PacedRoom, targets: Sequence[tuple[str, End]]) -> tuple[PlacedLamp, ...]:
    """Return the targets as they were located."""
    placed: list[PlacedLamp] = []
    for lamp, end in targets:
        target = room.targets[target_key(lamp, end)]
        x, y, z = target.position_m
        placed.append(
            PlacedLamp(
                lamp=lamp,
                end=end,
                position_m=(x, y, max(z, MIN_HEIGHT_M)),  # the limit is soft in the fit
                direction_sigma_rad=max(target.direction_sigmas_rad),
                is_unsure=target.is_unsure,
            )
        )
    return tuple(placed)


def placed_for_trial(targets: Sequence[tuple[str, End]]) -> tuple[PlacedLamp, ...]:
    """Return the targets side by side in rows, with nothing measured."""
    rows = math.ceil(len(targets) / ROW_LAMPS)
    placed: list[PlacedLamp] = []
    for row in range(rows):
        own = targets[row * len(targets) // rows : (row + 1) * len(targets) // rows]
        height_m = TRIAL_HEIGHT_M + ROW_STEP_M * ((rows - 1) / 2.0 - row)
        for index, (lamp, end) in enumerate(own):
            share = 0.5 if len(own) == 1 else index / (len(own) - 1)
            azimuth_rad = TRIAL_SPREAD_RAD * (1.0 - 2.0 * share)
            x_m = USUAL_M * math.cos(azimuth_rad)
            y_m = USUAL_M * math.sin(azimuth_rad)
            position_m = (x_m, y_m, max(height_m, MIN_HEIGHT_M))
            placed.append(PlacedLamp(lamp=lamp, end=end, position_m=position_m, direction_sigma_rad=0.0))
    return tuple(placed)


def exchanged(lamp: L, other: Mapping[str, str]) -> L:
    """Return a press or a placed lamp with the name of the other lamp, if it has one."""
    return lamp.model_copy(update={"lamp": other.get(lamp.lamp, lamp.lamp)})


def tried_lamp(state: StoredSetup) -> str:
    """Return the placed lamp that is to be tried next, unsure ones first, or `""`."""
    if state.step != "try":
        return ""
    done = {*state.met, *state.aside}
    unsure = {placed.lamp: placed.is_unsure for placed in state.placed}
    remaining = [lamp.id for lamp in state.lamps if lamp.id in unsure and lamp.id not in done]
    remaining.sort(key=lambda lamp: not unsure[lamp])
    return remaining[0] if remaining else ""
