"""Writes the limits of `pointit evaluate honesty --gate`: the tighter of those stated and those of the rows.

pointit evaluate honesty --quick --json rows.json; python -m tests.lab.honesty_limits rows.json
"""

import argparse
import csv
from dataclasses import asdict
from pathlib import Path

from pydantic import BaseModel

from pointit_lab.evaluation.honesty import targets
from pointit_lab.evaluation.honesty.row import EVERY, HonestyRow
from pointit_lab.evaluation.honesty.targets import KNOWN_MISS, LIMITS_FILE, HonestyLimits, limits_of, stated

FILE = Path(targets.__file__).with_name(LIMITS_FILE)


class Document(BaseModel):
    """Content of the file of `--json`, as far as wanted."""

    rows: list[HonestyRow]


def main() -> None:
    """Write the limits, and print those that permit known misses."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.honesty_limits", description=__doc__)
    parser.add_argument("rows", type=Path, help="rows of `--quick --json`")
    parser.add_argument(
        "--loosen", action="store_true", help="write those of the rows: after another criterion"
    )
    options = parser.parse_args()
    before = {} if options.loosen else stated()
    rows = Document.model_validate_json(options.rows.read_bytes()).rows
    limits = dict(before)
    for row in rows:
        if row.duration == EVERY:
            key = (row.set, row.condition)
            own = limits_of(row)
            limits[key] = before[key].tightened(own) if key in before else own
    write(limits)
    for key, own in limits.items():
        if own.wrong_most > KNOWN_MISS:
            print(f"known miss: {', '.join(key)}: up to {own.wrong_most:.0%}")  # noqa: T201


def write(limits: dict[tuple[str, str], HonestyLimits]) -> None:
    with FILE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["set", "condition", *asdict(targets.TARGETS)])
        writer.writerows(
            [*key, *(f"{value:.2f}" for value in asdict(own).values())] for key, own in limits.items()
        )


if __name__ == "__main__":
    main()
