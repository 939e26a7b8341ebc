"""Setup of a condition: map, moving objects, positions of people."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from pointit.geometry.polyline import Polyline
from pointit.maps.file import load_map
from pointit.schemas import BeltLink, Environment, UserProfile
from pointit.schemas.base import Rgb, Vec3
from pointit.services.conveyor_sim.config import ConveyorSimConfig, NamedFeederConfig
from pointit.services.conveyor_sim.plant import Plant
from pointit.services.pui.surfaces import Surfaces
from pointit.services.user_sim.config import AimConfig, DecisionConfig, UserSimConfig
from pointit_lab.evaluation.selection.carousel import OTHER, TARGET, Carousel
from pointit_lab.evaluation.selection.condition import LAB, RING_M, Condition
from pointit_lab.evaluation.selection.world import START_NS, ObjectMotion, TrialPerson

LAB_LENGTH_M = 0.5
"""Length of a package."""

LAB_MIN_M = 0.9
"""Minimum distance of packages, centre to centre."""

LAB_LIMIT_S = 60.0

LENGTH_M = 0.4
"""Length of a package on the conveyor."""

ENTRY = "part_e"

RIGHT_BAY = "1"
"""Bay where selected packages must leave the conveyor."""

PLACES_M = ((-1.3, -1.9, 0.0), (1.8, -1.9, 0.0), (-3.0, -1.9, 0.0), (0.0, -2.3, 0.0))
"""Positions of people at the conveyor, in order; as in scenario 4."""

REST_S = 10.0
"""Time to wait after the last package should have left."""

COLORS: tuple[Rgb, ...] = ((255, 255, 255), (0, 158, 115), (204, 121, 167), (86, 180, 233))
"""Cursor colours by person index."""

PATTERNS: tuple[Literal["solid", "dashed", "striped", "dotted"], ...] = (
    "solid",
    "dashed",
    "striped",
    "dotted",
)

YAW_DEG = 20.0
"""Azimuth of their bands' yaw origin."""


@dataclass(frozen=True, kw_only=True)
class TrialSetup:
    """A condition, ready for one trial."""

    environment: Environment
    movers: ObjectMotion
    people: Sequence[TrialPerson]
    surfaces: Surfaces
    packages: int
    limit_s: float
    """Time limit; targets not selected by then are missed."""
    target_kind: str = TARGET


def stage_of(condition: Condition, entropy: Sequence[int]) -> TrialSetup:
    """Return the setup of `condition` with packages and people drawn from `entropy`."""
    rng = np.random.default_rng([*entropy, 1])
    if condition.bench == LAB:
        return _lab(condition, rng)
    return _conveyor(condition, rng)


def kinds_of(condition: Condition, rng: np.random.Generator) -> list[str]:
    """Return the kinds of its packages, with targets at random positions."""
    others = condition.packages - condition.targets
    target_kinds = [TARGET] * condition.targets
    kinds = target_kinds + [OTHER] * others
    order = rng.permutation(len(kinds))
    return [kinds[index] for index in order]


@lru_cache(maxsize=4)
def room(name: str, kind: Literal["strip", "belt"]) -> tuple[Environment, Surfaces]:
    """Return the shipped map `name`, and its surfaces of `kind`."""
    environment = load_map(name, START_NS)
    return environment, Surfaces(environment, (kind,))


def _lab(condition: Condition, rng: np.random.Generator) -> TrialSetup:
    """Return packages spread over the ring as in the recordings: evenly, with random deviations."""
    environment, surfaces = room("lab", "strip")
    # people know that packages come back: the last strip leads to the first
    ids = [strip.id for strip in environment.strips]
    next_ids = [*ids[1:], ids[0]]
    neighbours = zip(ids, next_ids, strict=True)
    ring = tuple(BeltLink(source=strip, target=following) for strip, following in neighbours)
    environment = environment.model_copy(update={"links": ring})

    # deviations are such that neighbours stay `LAB_MIN_M` apart
    pitch_m = RING_M / condition.packages
    loose_m = (pitch_m - LAB_MIN_M) / 2.0
    even_m = (np.arange(condition.packages) + 0.5) * pitch_m
    deviations_m = rng.uniform(-loose_m, loose_m, condition.packages)
    carousel = Carousel(
        environment,
        even_m + deviations_m,
        kinds_of(condition, rng),
        length_m=LAB_LENGTH_M,
        speed_mps=condition.speed_mps,
        start_ns=START_NS,
    )
    return TrialSetup(
        environment=environment,
        movers=carousel,
        people=[person(0, (2.0, 0.5, 0.0), TARGET)],
        surfaces=surfaces,
        packages=condition.packages,
        limit_s=LAB_LIMIT_S,
    )


def _conveyor(condition: Condition, rng: np.random.Generator) -> TrialSetup:
    """Return the paper's demonstrator, fed at one entry; selected packages leave at bay 1."""
    environment, surfaces = room("conveyor", "belt")
    interval_s = condition.spacing_m / condition.speed_mps
    kinds = kinds_of(condition, rng)
    feeder = NamedFeederConfig(
        belt=ENTRY,
        sequence=tuple(kinds),
        min_interval_s=interval_s,
        max_interval_s=interval_s,
        length_m=LENGTH_M,
        count=condition.packages,
    )
    # time for the last package to be fed, and to leave after the longest way
    feeding_s = condition.packages * interval_s
    lengths_m = [Polyline(belt.line_m).length_m for belt in environment.belts]
    passage_s = sum(lengths_m) / condition.speed_mps
    people: list[TrialPerson] = []
    for index in range(condition.users):
        people.append(person(index, PLACES_M[index], TARGET))
    return TrialSetup(
        environment=environment,
        movers=_plant(environment, condition, {"entry": feeder}, rng),
        people=people,
        surfaces=surfaces,
        packages=condition.packages,
        limit_s=feeding_s + passage_s + REST_S,
    )


def _plant(
    environment: Environment,
    condition: Condition,
    feeders: dict[str, NamedFeederConfig],
    rng: np.random.Generator,
) -> Plant:
    config = ConveyorSimConfig(speed_mps=condition.speed_mps, feeders=feeders)
    seed = int(rng.integers(2**31))
    return Plant(environment, config, seed=seed, start_ns=START_NS)


@dataclass(frozen=True, kw_only=True)
class PersonModel:
    """Parameters in which a simulated person differs from the default."""

    skill: float
    search_per_item_s: float
    decide_per_bit_s: float
    lapse_share: float


PRACTISED = PersonModel(skill=0.7, search_per_item_s=0.005, decide_per_bit_s=0.05, lapse_share=0.04)
"""Practised people, as in the paper's group: fitted to the medians and wrong toggles of `belts_lab`.
Targets pop out by colour (Wolfe: 5 ms an item), choosing among two or three of them is habit (Hick's slope
flattens with practice); the rate of lapses is 0.04 (1 - skill), 1.2 % of choices."""


def person(index: int, position_m: Vec3, target_kind: str, model: PersonModel = PRACTISED) -> TrialPerson:
    """Return a person at `position_m` who selects packages of `target_kind`."""
    mind = DecisionConfig(
        search_per_item_s=model.search_per_item_s,
        decide_per_bit_s=model.decide_per_bit_s,
        lapse_share=model.lapse_share,
    )
    aim = AimConfig(skill=model.skill)
    config = UserSimConfig(
        position_m=position_m,
        yaw_deg=YAW_DEG,
        target_kinds=(target_kind,),
        think_s=0.0,
        aim=aim,
        mind=mind,
    )
    # cursors of several people differ
    color = COLORS[index % len(COLORS)]
    pattern = PATTERNS[index % len(PATTERNS)]
    profile = UserProfile(stamp_ns=0, cursor_color=color, pattern=pattern)
    name = f"person-{index + 1}"
    return TrialPerson(name=name, config=config, profile=profile)
