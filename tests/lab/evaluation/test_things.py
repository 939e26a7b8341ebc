"""The evaluation of things: reaches with and without light, people who point elsewhere, its command."""

import json

import pytest
from click.testing import CliRunner

from pointit.services.selector.config import SelectorConfig
from pointit_lab.cli.things import things
from pointit_lab.evaluation.things.announced import ANNOUNCED_ROWS, announced_reach, announced_reaches, waves
from pointit_lab.evaluation.things.drift_series import drift_series, series_row
from pointit_lab.evaluation.things.ideal import max_right
from pointit_lab.evaluation.things.listening_reach import ListenerModel
from pointit_lab.evaluation.things.things import ROWS, Share, reaches, row_of, wrong_selections

CONFIG = SelectorConfig(method="estimate")
LIT, DARK, NEAR_LIT, NEAR_DARK, CALIBRATED = ROWS


def test_light_lets_people_find_what_is_hard_to_point_at() -> None:
    lit, dark = (row_of(row, reaches(CONFIG, (row, 2000, 20))) for row in (NEAR_LIT, NEAR_DARK))
    assert lit.right.count >= 18
    assert dark.right.count <= 10
    assert lit.wrong.count + dark.wrong.count <= 1
    assert 1.5 < lit.median_s < 3.5
    assert lit.right.count + lit.wrong.count + lit.nothing.count == 20
    assert reaches(CONFIG, (LIT, 2000, 2)) == reaches(CONFIG, (LIT, 2000, 2))


def test_without_light_no_method_beats_the_ideal_judge() -> None:
    found = row_of(DARK, reaches(CONFIG, (DARK, 2000, 60)))
    at_best = max_right(DARK, 2000, 60, found.wrong.value)
    assert found.right.value <= at_best + 0.05
    assert max_right(DARK, 2000, 60, 0.0) < at_best <= max_right(DARK, 2000, 60, 1.0) < 1.0
    assert max_right(NEAR_DARK, 2000, 60, 0.03) < 0.5
    assert max_right(DARK, 2000, 400, 0.03) == pytest.approx(0.84, abs=0.04)
    assert max_right(CALIBRATED, 2000, 60, 0.03) == pytest.approx(max_right(DARK, 2000, 60, 0.03), abs=0.1)


def test_the_interval_is_wilsons() -> None:
    assert Share(95, 100).interval == pytest.approx((0.888, 0.978), abs=1e-3)
    assert Share(0, 300).interval == pytest.approx((0.0, 0.0126), abs=1e-3)


def test_who_points_elsewhere_fires_less_than_a_method_that_is_never_in_doubt() -> None:
    hasty = SelectorConfig.model_validate({"method": "estimate", "estimate": {"sure": 0.5, "dwell_s": 0.3}})
    assert wrong_selections(CONFIG, ("nothing", 2000, 1.0)) == 0
    assert wrong_selections(hasty, ("strip", 2001, 2.0)) > wrong_selections(CONFIG, ("strip", 2001, 2.0))


def test_the_command_gives_the_same_rows_as_json() -> None:
    ended = CliRunner().invoke(
        things, ["--trials", "2", "--people", "1", "--minutes", "0.1", "--jobs", "1", "--json", "-"]
    )
    assert ended.exit_code == 0, ended.output
    document = json.loads(ended.stdout)
    assert [row["name"] for row in document["rows"]] == [row.name for row in ROWS]
    assert set(document["unintended_per_30_min"]) == {"strip", "nothing"}
    assert set(document["right_at_best"]) == {row.name for row in ROWS if not row.lit}


def test_people_who_hear_names_find_things_that_they_would_miss() -> None:
    row = ANNOUNCED_ROWS[1]
    named = row_of(row, announced_reaches("names+step", (row, 400_000, 12)))
    silent = row_of(row, reaches(CONFIG, (row, 400_000, 12)))
    assert named.right.count >= 11 > silent.right.count
    assert named.wrong.count <= 1  # by a false press
    assert announced_reaches("names", (row, 400_001, 2)) == announced_reaches("names", (row, 400_001, 2))


def test_without_hearing_or_pressing_nothing_is_selected() -> None:
    deaf = ListenerModel(missed=1.0, false_presses_per_min=0.0)
    lame = ListenerModel(press_missed=1.0, false_presses_per_min=0.0)
    row = ANNOUNCED_ROWS[0]
    for model in (deaf, lame):
        assert {announced_reach(row, "names", seed, model).end for seed in (400_010, 400_011)} == {"nothing"}


def test_people_who_press_late_hear_the_name_again_and_select() -> None:
    late = ListenerModel(hand_s=3.0, false_presses_per_min=0.0)
    ends = [announced_reach(ANNOUNCED_ROWS[0], "names+step", seed, late) for seed in range(400_020, 400_024)]
    assert {each.end for each in ends} == {"right"}
    assert min(each.took_s for each in ends) > 4.0


def test_a_button_protects_who_waves_among_the_things() -> None:
    assert waves("names", ("among", 400_000, 0.5)) <= 1
    assert waves("names+dwell", ("among", 400_000, 0.5)) > 1


def test_the_command_simulates_listeners() -> None:
    few = ["--announce", "names", "--trials", "1", "--people", "1", "--minutes", "0.1", "--jobs", "1"]
    ended = CliRunner().invoke(things, [*few, "--json", "-"])
    assert ended.exit_code == 0, ended.output
    document = json.loads(ended.stdout)
    assert [row["name"] for row in document["rows"]] == [row.name for row in ANNOUNCED_ROWS]
    assert document["assumptions"]["false_presses_per_min"] == 0.5
    ended = CliRunner().invoke(things, ["--announce", "names", "--method", "gauge"])
    assert "--announce works with method estimate, not gauge" in str(ended.exception)


def test_landings_keep_drift_away_and_nothing_learned_does_not() -> None:
    learned, ignored = (
        series_row(0.25, learns, drift_series(("names", 0.25, learns), (400_000, 2)))
        for learns in (True, False)
    )
    assert learned.yaw_error_deg < 8.0 < ignored.yaw_error_deg
    assert learned.last.right.of == ignored.last.right.of == 2


def test_the_command_simulates_series_with_drift() -> None:
    few = ["--announce", "names", "--drift", "0.1", "--trials", "1", "--jobs", "1", "--json", "-"]
    ended = CliRunner().invoke(things, few)
    assert ended.exit_code == 0, ended.output
    assert [row["learns"] for row in json.loads(ended.stdout)["series"]] == [False, True]
    ended = CliRunner().invoke(things, ["--drift", "0.1"])
    assert "--drift works with --announce only" in str(ended.exception)
