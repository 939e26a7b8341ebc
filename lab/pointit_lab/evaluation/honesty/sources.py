"""Recorded and simulated people for the table of honesty."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pointit_lab.evaluation.datasets import motion_relloc, proximity_waypoints, vr_arm_pointing
from pointit_lab.evaluation.honesty import simulated_people
from pointit_lab.evaluation.localization.trial import FollowRecording, LocalizationTrial, TrialReading

FOLLOWED = {module.NAME: module.read for module in (motion_relloc, proximity_waypoints)}
RECORDED = (*FOLLOWED, vr_arm_pointing.NAME)
SIMULATED = (simulated_people.SET, simulated_people.LAMPS_SET)
SETS = (*RECORDED, *SIMULATED)


@dataclass(frozen=True, kw_only=True)
class Size:
    """Amount of trials."""

    people: int
    """Simulated people of each kind."""
    rooms: int
    """Passes through all targets of each person of `vr_arm_pointing`, with an act of each."""
    windows: int | None
    """Windows of each recording and duration, evenly taken. None if all are."""
    taken: int = 0
    """Simulated people with a taken pose that a row should have: more are drawn until it has."""


FULL = Size(people=100, rooms=12, windows=None, taken=300)
QUICK = Size(people=16, rooms=4, windows=4)


@dataclass
class SimulatedPeople:
    """People of all sets."""

    followed: list[FollowRecording] = field(default_factory=list[FollowRecording])
    rooms: list[LocalizationTrial] = field(default_factory=list[LocalizationTrial])
    notes: list[str] = field(default_factory=list[str])
    """Messages about skipped data."""


def people(recordings: Path | None, sets: Sequence[str], size: Size, seed: int = 0) -> SimulatedPeople:
    """Return the people of `sets` (empty: all).

    Args:
        recordings: folder with one folder per set. None if only simulated people are wanted.
        sets: some of `SETS`.
        size: how many.
        seed: of the first simulated person, incremented for each.

    Raises:
        ConfigError: If a file is damaged.
    """
    selected_sets = tuple(sets) or SETS
    reading = TrialReading()
    for name in RECORDED:
        if recordings is None or name not in selected_sets:
            continue
        if not (recordings / name).is_dir():
            reading.skip(recordings / name, "there is no such folder")
        elif name in FOLLOWED:
            FOLLOWED[name](recordings / name, reading)
    # windows of following are drawn later, under each condition: only rooms count as trials here
    reading.trials.clear()
    if recordings is not None and vr_arm_pointing.NAME in selected_sets:
        folder = recordings / vr_arm_pointing.NAME
        everything = (vr_arm_pointing.ALL_TARGETS,)
        vr_arm_pointing.read(folder, reading, counts=everything, subsets=size.rooms)
    people = SimulatedPeople(followed=reading.followed, rooms=list(reading.trials), notes=reading.notes)

    seeds = range(seed, seed + size.people)
    if simulated_people.SET in selected_sets:
        people.followed += simulated_people.followers(seeds)
    if simulated_people.LAMPS_SET in selected_sets:
        people.rooms += simulated_people.rooms(seeds)
    return people
