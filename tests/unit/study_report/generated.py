"""Folders of studies with a known truth, of the columns that `pointit study run` writes."""

import csv
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from pointit.study.study_folder import ANSWER_COLUMNS
from pointit.study.table_file import COLUMNS, spreadsheet_row

NAMES = [name for name, _, _ in COLUMNS][5:]
RINGS = ((0.4, 0.05), (0.8, 0.1), (1.2, 0.05), (0.8, 0.03))
"""Distance and width of the circles of targets, m: a block each."""
EYES_M = 2.0
"""Distance of the eyes to the wall of targets."""


def write_rows(path: Path, rows: list[dict[str, object]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*rows[0]], lineterminator="\n")
        writer.writeheader()
        writer.writerows(spreadsheet_row({name: str(value) for name, value in row.items()}) for row in rows)


def edit_trials(folder: Path, name: str, change: Callable[[dict[str, str]], object]) -> None:
    """Change the trials of a participant; a row of which `change` returns False is removed."""
    path = folder / name / "trials.csv"
    with path.open(newline="", encoding="utf-8") as file:
        rows = [*csv.DictReader(file)]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*rows[0]], lineterminator="\n")
        writer.writeheader()
        writer.writerows([row for row in rows if change(row) is not False])


def write_study(
    folder: Path,
    effects: Mapping[str, float],
    *,
    people: int = 12,
    seed: int = 0,
    spread: float = 0.2,
    wrong: float = 0.05,
    between: bool = False,
    rings: tuple[tuple[float, float], ...] = RINGS,
    targets: int = 9,
    learning: float = 0.0,
    sized: bool = False,
) -> None:
    """Write a study of tapping circles; `effects` are factors of the time by level of `method`.

    The time of a hit is (0.4 + 0.25 bits) s, times the effect, times one of the person, times noise. SD of
    errors is a fifth of the width. `learning` is the exponent of the trial's number. `between`: people have a
    `group`, of which b is twice as slow. `sized`: distance and width are factors.
    """
    sizes = [*dict.fromkeys(ring[0] for ring in rings)], [*dict.fromkeys(ring[1] for ring in rings)]
    in_block = (targets + 1) * (1 if sized else len(rings))
    write_yaml(
        folder,
        people,
        in_block,
        method=("block", dict.fromkeys(effects, "x.y")),
        **({"group": ("between", {"a": "x.z", "b": "x.z"})} if between else {}),
        **({"distance": ("block", {f"{ring[0]:g}": "task.distance_m" for ring in rings})} if sized else {}),
        **({"width": ("block", {f"{ring[1]:g}": "task.width_m" for ring in rings})} if sized else {}),
    )
    random = np.random.default_rng(seed)
    for number in range(people):
        name = f"P{number + 1:02d}"
        pace = math.exp(random.normal(0, spread))
        group = "ab"[number % 2]
        rows: list[dict[str, object]] = []
        block = 0
        for method in (*effects,) if number % 2 else reversed((*effects,)):
            for distance, width in rings:
                block += 1
                cell = [*effects].index(method)
                if sized:
                    cell = cell * len(sizes[0]) + sizes[0].index(distance)
                    cell = cell * len(sizes[1]) + sizes[1].index(width)
                first = in_block * cell + (0 if sized else (targets + 1) * ((block - 1) % len(rings))) + 1
                radius = distance / (2 * math.cos(math.pi / (2 * targets)))
                for trial in range(targets + 1):
                    angle = 2 * math.pi * (trial * (targets // 2) % targets) / targets
                    target = np.array([0.0, radius * math.cos(angle), 1.5 + radius * math.sin(angle)])
                    error = np.array([0.0, *random.normal(0, width / 5, size=2)])
                    bits = math.log2(distance / width + 1)
                    slow = 2.0 if between and group == "b" else 1.0
                    noise = math.exp(random.normal(0, 0.15))
                    practised = (len(rows) % (len(rings) * (targets + 1)) + 1) ** learning
                    time = (0.4 + 0.25 * bits) * effects[method] * pace * slow * noise * practised
                    size_m = float(np.linalg.norm(error))
                    point = dict(zip(NAMES[-6:], (*target, *(target + error)), strict=True))
                    numbers: dict[str, float] = {
                        "first_hover_s": time * 0.7,
                        "selection_s": time,
                        "corrections": float(random.poisson(1)),
                        "path_length_deg": math.degrees(distance / EYES_M) * 1.2,
                        "error_m": size_m,
                        "error_deg": math.degrees(size_m / EYES_M),
                        "target_distance_m": distance,
                        "target_width_m": width,
                        "target_distance_deg": math.degrees(distance / EYES_M),
                        "target_width_deg": math.degrees(width / EYES_M),
                        **point,
                    }
                    rows.append(
                        {
                            "participant": name,
                            "block": block,
                            "trial": first + trial,
                            "attempt": 1,
                            "practice": 0,
                            **({"method": method} if len(effects) > 1 else {}),
                            **({"group": group} if between else {}),
                            **({"distance": f"{distance:g}", "width": f"{width:g}"} if sized else {}),
                            **dict.fromkeys(NAMES, ""),
                            "task": "tapping",
                            "seed": seed,
                            "target": f"t{trial % targets}",
                            "outcome": "wrong" if random.random() < wrong else "hit",
                            "began_utc": "2026-01-01T10:00:00.000Z",
                            **{key: f"{value:.6g}" for key, value in numbers.items()},
                        }
                    )
        write_rows(folder / name / "trials.csv", rows)
        (folder / name / "participant.yaml").write_text("simulated: false\n", encoding="utf-8")
    write_rows(
        folder / "columns.csv", [{"column": "selection_s", "unit": "s", "meaning": "time to selection"}]
    )


def write_yaml(folder: Path, people: int, in_block: int, **factors: tuple[str, dict[str, str]]) -> None:
    """Write `study.yaml` with factors: how each varies, and by level the parameter that it sets.

    A block has `in_block` trials.
    """
    named: dict[str, object] = {}
    for name, (vary, levels) in factors.items():
        if len(levels) > 1:
            values = {level: {each: 0.1 + n} for n, (level, each) in enumerate(levels.items())}
            named[name] = {"vary": vary, "levels": values}
    study = {"name": "made", "participants": people * 2, "order": "as_written", "factors": named}
    study |= {"repetitions": in_block}
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps({**study, "task": {"kind": "tapping"}})
    (folder / "study.yaml").write_text(text, encoding="utf-8")


def write_answers(folder: Path, participant: str, sheets: Mapping[tuple[str, str], list[float]]) -> None:
    """Write answers by questionnaire and condition; each condition is a block, in their order."""
    blocks = [*dict.fromkeys(condition for _, condition in sheets)]
    rows: list[dict[str, object]] = [
        dict(
            zip(
                ANSWER_COLUMNS,
                (participant, name, item, condition, blocks.index(condition) + 1, f"{value:g}"),
                strict=True,
            )
        )
        for (name, condition), values in sheets.items()
        for item, value in enumerate(values, 1)
    ]
    write_rows(folder / participant / "answers.csv", rows)
