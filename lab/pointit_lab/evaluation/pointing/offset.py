"""Benefit of correcting a person's systematic error: errors of a new person before and after anchors.

Anchors are pointings without a cursor at different known targets, drawn `DRAWS` times, the same ones in each
run; the person's pointings at all other targets are scored. `first pointing as anchor` is the real order: the
very first one, and those after it. Pointings 25° or more off in elevation (a hanging hand, a frozen tracker)
may be anchors, since that happens, but are not scored.

`vr_eyefinger`: the ray is the true eye-finger ray and the heading is known; with visible hand, as always
outside virtual reality, and with nothing visible. `proximity_feedback`: three positions on the floor, rays
from the wrist, drifting heading, so that only the pitch is scored; the height of the eyes is not recorded.

Solvers: `none`; `pitch`, a constant of the elevation; `ladder`, that, the heading, and a polynomial
if it helps; `bound`, the optimum for a constant fitted to so many anchors: the person's own scatter
times sqrt(1 + 1/anchors). `within_2_sigma` is of the pitch; `refused` counts draws without an offset.
"""

import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pointit.geometry import vector
from pointit.services.pointing.offset import OffsetFit, OffsetSighting, fit
from pointit.services.pointing.pointer import apply
from pointit_lab.evaluation.datasets import proximity_feedback, vr_eyefinger
from pointit_lab.evaluation.datasets.proximity_feedback import read_floor_trials
from pointit_lab.evaluation.datasets.vr_eyefinger import read_wall_trials
from pointit_lab.evaluation.recordings.row import ALL, MetricSpread, Row

ANCHORS = (1, 2, 4, 8)
DRAWS = 40
"""Random sets of anchors for each person and number of anchors."""
NOT_POINTING_RAD = math.radians(25.0)
SEEN = {"hand": ", hand seen", "none": ", nothing seen"}
"""Suffixes for the conditions of `vr_eyefinger` without a cursor."""
EYE_M = 1.64
"""Assumed height of the eyes in `proximity_feedback`: a typical one."""
SETTLED_S = 1.0
"""Time from the start of a hold until the hand is still."""

SOLVERS = ("none", "pitch", "ladder")


@dataclass(frozen=True, kw_only=True)
class MeasuredPerson:
    """Pointings of a person without a cursor."""

    set: str
    subject: str
    seen: str = ""
    """Suffix of the conditions."""
    sightings: Sequence[OffsetSighting]
    targets: Sequence[int]
    is_heading_known: bool = True


@dataclass
class _Errors:
    """Errors after correction by one solver under one condition."""

    pitch_rad: list[float] = field(default_factory=list[float])
    yaw_rad: list[float] = field(default_factory=list[float])
    angle_rad: list[float] = field(default_factory=list[float])
    is_within: list[bool] = field(default_factory=list[bool])
    refused: int = 0

    def add(self, others: "_Errors") -> None:
        self.pitch_rad += others.pitch_rad
        self.yaw_rad += others.yaw_rad
        self.angle_rad += others.angle_rad
        self.is_within += others.is_within
        self.refused += others.refused


def offset_rows(data: Path, tick: Callable[[str], None]) -> list[Row]:
    """Return rows for each person and for all of a set; missing sets have none.

    Args:
        data: folder with one folder per set.
        tick: called with a short description of the next step.

    Raises:
        ConfigError: If a recording is damaged.
    """
    found: dict[tuple[str, str, str, str], _Errors] = {}
    for person in people(data):
        tick(f"{person.set} {person.subject}")
        for condition, solver, errors in scored(person):
            for subject in (person.subject, ALL):
                found.setdefault((person.set, condition, subject, solver), _Errors()).add(errors)
    rows = [_row(key, errors) for key, errors in found.items() if errors.pitch_rad]
    return sorted(rows, key=lambda row: (row.set, row.condition, row.subject == ALL))


def people(data: Path) -> Iterator[MeasuredPerson]:
    """Yield the people recorded under `data`.

    Raises:
        ConfigError: If a recording is damaged.
    """
    if (data / vr_eyefinger.NAME).is_dir():
        for trials in read_wall_trials(data / vr_eyefinger.NAME):
            if trials.feedback in SEEN:
                yield MeasuredPerson(
                    set=vr_eyefinger.NAME,
                    subject=trials.subject,
                    seen=SEEN[trials.feedback],
                    sightings=[
                        _sighting((x, y, z), (u, v, w))
                        for (x, y, z), (u, v, w) in zip(
                            trials.directions.tolist(), trials.ways.tolist(), strict=True
                        )
                    ],
                    targets=trials.targets.tolist(),
                )
    if (data / proximity_feedback.NAME).is_dir():
        yield from _on_the_floor(data / proximity_feedback.NAME)


def scored(person: MeasuredPerson) -> Iterator[tuple[str, str, _Errors]]:
    """Yield condition, solver and errors of one person."""
    pointed = np.array([_is_pointing(sighting) for sighting in person.sightings], dtype=np.bool_)
    targets = np.array(person.targets)
    whole = _Errors()
    for index in np.flatnonzero(pointed).tolist():
        _score(person, person.sightings[index], None, whole)
    yield f"no anchor{person.seen}", "none", whole
    off = np.array(whole.pitch_rad)
    if len(off) < 2:
        return
    scatter = np.sqrt(len(off) / (len(off) - 1)) * (off - off.mean())
    later: list[int] = np.flatnonzero(pointed & (targets != targets[0])).tolist()
    yield from _corrected(person, f"first pointing as anchor{person.seen}", [([0], later)])
    for count in ANCHORS:
        if count >= len(set(person.targets)):
            continue
        condition = f"{count} anchor{'s' if count > 1 else ''}{person.seen}"
        random = np.random.default_rng([zlib.crc32(person.subject.encode()), count])
        draws: list[tuple[list[int], list[int]]] = []
        for _ in range(DRAWS):
            kinds = random.choice(np.unique(targets), size=count, replace=False)
            chosen = [int(random.choice(np.flatnonzero(targets == kind))) for kind in kinds]
            draws.append((chosen, np.flatnonzero(pointed & ~np.isin(targets, kinds)).tolist()))
        yield from _corrected(person, condition, draws)
        bound = scatter * math.sqrt(1.0 + 1.0 / count)
        yield condition, "bound", _Errors(pitch_rad=bound.tolist())


def _corrected(
    person: MeasuredPerson, condition: str, draws: Sequence[tuple[list[int], list[int]]]
) -> Iterator[tuple[str, str, _Errors]]:
    """Yield the errors of each solver, given the sightings used as anchors and those scored."""
    errors = {solver: _Errors() for solver in SOLVERS}
    for chosen, rest in draws:
        anchors = [person.sightings[index] for index in chosen]
        fits = {"none": None, "pitch": fit(anchors, highest="pitch"), "ladder": fit(anchors)}
        for solver, fitted in fits.items():
            errors[solver].refused += fitted is not None and fitted.offset is None
            for index in rest:
                is_turned = solver == "ladder"
                _score(person, person.sightings[index], fitted, errors[solver], is_turned=is_turned)
    for solver in SOLVERS:
        yield condition, solver, errors[solver]


def _score(
    person: MeasuredPerson,
    sighting: OffsetSighting,
    fit: OffsetFit | None,
    errors: _Errors,
    *,
    is_turned: bool = False,
) -> None:
    azimuth, elevation = sighting.azimuth_rad, sighting.elevation_rad
    if fit is not None and fit.offset is not None:
        azimuth += fit.heading_rad if is_turned else 0.0
        by_azimuth, by_elevation = apply(fit.offset, azimuth, elevation)
        azimuth, elevation = azimuth + by_azimuth, elevation + by_elevation
        pitch = elevation - sighting.target_elevation_rad
        errors.is_within.append(abs(pitch) <= 2.0 * fit.offset.sigma_rad)
    errors.pitch_rad.append(elevation - sighting.target_elevation_rad)
    if person.is_heading_known:
        errors.yaw_rad.append(vector.wrap(azimuth - sighting.target_azimuth_rad))
        errors.angle_rad.append(
            vector.angle_between(
                vector.direction(azimuth, elevation),
                vector.direction(sighting.target_azimuth_rad, sighting.target_elevation_rad),
            )
        )


def _row(key: tuple[str, str, str, str], errors: _Errors) -> Row:
    name, condition, subject, solver = key
    return Row(
        set=name,
        subject=subject,
        condition=condition,
        solver=solver,
        n=len(errors.pitch_rad),
        pitch_deg=MetricSpread.of(map(math.degrees, errors.pitch_rad)),
        yaw_deg=MetricSpread.of(map(math.degrees, errors.yaw_rad)),
        angle_deg=MetricSpread.of(map(math.degrees, errors.angle_rad)),
        within_2_sigma=float(np.mean(errors.is_within)) if errors.is_within else None,
        refused=errors.refused if solver in ("pitch", "ladder") else None,
    )


def _on_the_floor(folder: Path) -> Iterator[MeasuredPerson]:
    errors: dict[str, tuple[list[OffsetSighting], list[int]]] = {}
    for trial in read_floor_trials(folder):
        hold = trial.phases.get("open_loop_hold")
        if hold is None:
            continue
        points_m = hold.points_m[hold.times_s >= hold.times_s[0] + SETTLED_S]
        if not len(points_m):
            continue
        x, y = (float(value) for value in np.median(points_m, axis=0))
        sightings, targets = errors.setdefault(trial.subject, ([], []))
        sightings.append(_sighting((x, y, -EYE_M), (*trial.target_m, -EYE_M)))
        targets.append(zlib.crc32(trial.target_id.encode()))
    for subject, (sightings, targets) in errors.items():
        yield MeasuredPerson(
            set=proximity_feedback.NAME,
            subject=subject,
            sightings=sightings,
            targets=targets,
            is_heading_known=False,
        )


def _sighting(ray: vector.Vec3, way: vector.Vec3) -> OffsetSighting:
    return OffsetSighting(
        vector.azimuth(ray), vector.elevation(ray), vector.azimuth(way), vector.elevation(way)
    )


def _is_pointing(sighting: OffsetSighting) -> bool:
    return abs(sighting.elevation_rad - sighting.target_elevation_rad) < NOT_POINTING_RAD
