"""Misses of the targets are named, and the gate of `pointit evaluate honesty` fails for what got worse."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click
import pytest

from pointit_lab.cli.honesty import honesty
from pointit_lab.evaluation.honesty import targets
from pointit_lab.evaluation.honesty.honesty import judged_sources, sources_of
from pointit_lab.evaluation.honesty.injections import INJECTIONS, NONE, Injection
from pointit_lab.evaluation.honesty.row import HonestyRow, Judged, rows_of
from pointit_lab.evaluation.honesty.simulated_people import followers, rooms
from pointit_lab.evaluation.honesty.sources import QUICK, RECORDED, people
from pointit_lab.evaluation.honesty.targets import (
    FEWEST,
    KNOWN_MISS,
    TARGETS,
    HonestyLimits,
    limits_of,
    missed,
    regressions,
    stated,
)
from tests.support.data import data_file
from tests.support.invoked import printed

DECISION = Path(__file__).parents[3] / "docs/decisions/certain-poses.md"


def test_missed_honesty_targets_are_named() -> None:
    good = rows_of(
        Judged(
            set="s", condition=NONE, duration="2 s", subject="a", taken=True, error_m=0.1, square=1.0,
            in_place=number % 20 != 0, in_yaw=number % 20 != 0,
        )
        for number in range(100)
    )  # fmt: skip
    assert missed(good) == []
    wide = [replace(row, square=0.3, within_2_sigma=1.0) for row in good]
    (only,) = missed(wide)
    assert only[1] == ["2 sigma of the place 100.0 %", "squared error 0.30"]


def test_a_row_worse_than_its_limits_is_a_regression(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = simulated_rows(QUICK.people // 8, ["height +0.2 m"])
    wide = targets.HonestyLimits(within_least=0.0, within_most=1.0, yaw_least=0.0, yaw_most=1.0,
                          square_least=0.0, square_most=99.0, wrong_most=1.0)  # fmt: skip
    keys = [(row.set, row.condition) for row in rows]
    monkeypatch.setattr(targets, "stated", lambda: dict.fromkeys(keys, wide))
    assert regressions(rows) == []
    monkeypatch.setattr(targets, "stated", lambda: dict.fromkeys(keys, replace(wide, taken_least=1.01)))
    assert all("taken" in told for told in regressions(rows))
    monkeypatch.setattr(targets, "stated", dict)
    assert regressions(rows)[0].endswith("no limits are stated")


def simulated_rows(count: int, names: Sequence[str] = ()) -> list[HonestyRow]:
    injections = [each for each in INJECTIONS if not names or each.name in names]
    sources = sources_of(followers(range(count)), rooms(range(count)), injections, 1)
    return rows_of(judged_sources(sources, jobs=1, tick=lambda _done, _of: None))


def asked_of(part: Sequence[Injection], *, recorded: bool) -> list[tuple[str, str]]:
    names = {each.name for each in part}
    return [key for key in stated() if (key[0] in RECORDED) == recorded and key[1] in names]


@pytest.mark.parametrize("part", [INJECTIONS[:1], pytest.param(INJECTIONS[1:], marks=pytest.mark.long)])
def test_simulated_people_are_no_worse_than_stated(part: Sequence[Injection]) -> None:
    """The gate: `pointit evaluate honesty --gate` without recordings."""
    rows = simulated_rows(QUICK.people, [each.name for each in part])
    assert regressions(rows, asked_of(part, recorded=False)) == []


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("part", [(INJECTIONS[0], *INJECTIONS[1::2]), INJECTIONS[2::2]])
def test_recorded_people_are_no_worse_than_stated(part: Sequence[Injection]) -> None:
    """The gate of `pointit evaluate honesty --gate` with recordings."""
    found = people(data_file("recordings/motion_relloc").parent, RECORDED, QUICK)
    sources = sources_of(found.followed, found.rooms, part, QUICK.windows)
    rows = rows_of(judged_sources(sources, jobs=2, tick=lambda _done, _of: None))
    assert regressions(rows, asked_of(part, recorded=True)) == []


def test_each_row_of_the_gate_has_limits() -> None:
    known = stated()
    simulated = {(name, each.name) for each in INJECTIONS for name, fits in
                 (("simulated", each.follows), ("simulated lamps", each.points)) if fits}  # fmt: skip
    assert simulated <= set(known)


def gate(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> str:
    monkeypatch.delenv("POINTIT_DATA", raising=False)
    every = (*arguments, "--quick", "--jobs", "1", "--condition", NONE, "--json", "-")
    return printed(honesty, *every)[0]


def test_the_gate_fails_only_if_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "stated", dict)
    assert json.loads(gate(monkeypatch, "--set", "simulated"))["worse"] == []
    with pytest.raises(click.ClickException, match="no limits are stated"):
        gate(monkeypatch, "--set", "simulated", "--gate")


def test_the_gate_fails_if_nothing_is_judged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(click.ClickException, match="motion_relloc, as they are: no trial"):
        gate(monkeypatch, "--set", "motion_relloc", "--data", str(tmp_path), "--gate")


def judged_row(*, wrong: int, taken: int, n: int = 40) -> HonestyRow:
    """Return a row of `n` trials, of which some are `taken`, and of these some `wrong`."""
    (row, _) = rows_of(
        Judged(
            set="s", condition=NONE, duration="2 s", subject="a", taken=number < taken,
            error_m=1.0, square=1.0, in_place=number >= wrong, in_yaw=True,
        )
        for number in range(n)
    )  # fmt: skip
    return row


@pytest.mark.parametrize(("wrong", "taken"), [(0, 30), (15, 30), (5, 5), (0, FEWEST - 1), (0, 0)])
def test_row_meets_its_own_limits_unless_it_is_much_worse(wrong: int, taken: int) -> None:
    limits = limits_of(judged_row(wrong=wrong, taken=taken))
    assert limits.broken_by(judged_row(wrong=wrong, taken=taken)) == []
    if wrong < taken:
        assert limits.broken_by(judged_row(wrong=min(wrong + 6, 30), taken=30))


def test_localizer_that_no_longer_takes_poses_breaks_its_limits() -> None:
    assert limits_of(judged_row(wrong=0, taken=20)).broken_by(judged_row(wrong=0, taken=0)) == ["taken 0 %"]
    assert limits_of(judged_row(wrong=19, taken=20)).broken_by(judged_row(wrong=0, taken=0)) == []


def test_limits_become_only_tighter() -> None:
    wide = HonestyLimits(taken_least=0.2, within_least=0.5, wrong_most=0.3)
    narrow = HonestyLimits(taken_least=0.4, within_least=0.8, wrong_most=0.1)
    assert wide.tightened(narrow) == narrow.tightened(wide) == narrow
    assert HonestyLimits(within_least=0.5).tightened(TARGETS) == TARGETS


def test_known_misses_are_told() -> None:
    """Conditions whose limits permit that more than 10 % are confidently wrong are on the decision's page."""
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in DECISION.read_text(encoding="utf-8").splitlines()
        if line.startswith("|")
    ]
    told = {(row[0].strip("`"), row[1]): row[-1] for row in cells if len(row) > 2}
    for key, limits in stated().items():
        if limits.wrong_most > KNOWN_MISS:
            assert told[key] == f"{100.0 * limits.wrong_most:.0f} %"
