"""Throughput compares the same people, distances and widths, and all that is left out is counted."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit import study_report
from pointit.cli.study import report as report_command
from pointit.errors import PointItError
from tests.unit.study_report.generated import RINGS, edit_trials, write_study

PARTS = ("no_start", "no_selection", "gross_errors", "in_short_sequences", "in_unmatched_sequences")
Row = dict[str, str]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a study of two methods and four people with two blocks of six trials a method."""
    write_study(tmp_path, {"dwell": 1.0, "press": 0.8}, people=4, rings=RINGS[:2], wrong=0.0, targets=5)
    return tmp_path


def times_out(*trials: tuple[str, str, int]) -> Callable[[Row], None]:
    """Return an edit: trials (method, width, number in the block from 0) end without a selection."""

    def change(row: Row) -> None:
        if (row["method"], row["target_width_m"], (int(row["trial"]) - 1) % 6) in {
            (method, f"{float(width):.6g}", number) for method, width, number in trials
        }:
            row |= {"outcome": "timeout", "selection_s": "", "error_m": "", "error_deg": ""}
            row |= {f"selected_{axis}_m": "" for axis in "xyz"}

    return change


def rows_of(table: study_report.Table) -> dict[str, dict[str, Any]]:
    return {row["method"]: row for row in table}


def test_short_sequence_is_counted_and_its_counterparts_are_left_out(folder: Path) -> None:
    edit_trials(folder, "P02", times_out(("press", "0.05", 3)))
    study = study_report.trials(folder)
    found = rows_of(study_report.throughput(study))
    left = rows_of(study_report.omissions(study))
    assert [(row["participants"], row["sequences"]) for row in found.values()] == [(4, 7), (4, 7)]
    assert (found["dwell"]["left_out"], found["press"]["left_out"]) == (5, 5)
    assert [left["press"][name] for name in PARTS] == [8, 1, 0, 4, 0]
    assert [left["dwell"][name] for name in PARTS] == [8, 0, 0, 0, 5]
    assert (left["press"]["short_sequences"], left["dwell"]["unmatched_sequences"]) == (1, 1)
    assert all(row["trials"] == row["used"] + sum(row[name] for name in PARTS) for row in left.values())


def test_methods_are_compared_with_the_same_people_and_sizes(folder: Path) -> None:
    """P02's sequences with the narrow targets are slower by far: they would make dwell alone worse."""

    def slows(row: Row) -> None:
        if row["target_width_m"] == "0.050000":
            row["selection_s"] = f"{float(row['selection_s']) * 6:.6f}"

    write_study(
        folder, {"dwell": 1.0, "press": 1.0}, people=4, rings=RINGS[:2], wrong=0.0, targets=5, spread=0
    )
    edit_trials(folder, "P02", slows)
    edit_trials(folder, "P02", times_out(("press", "0.05", 2)))
    found = rows_of(study_report.throughput(study_report.trials(folder)))
    values = [row["throughput_bit_per_s"] for row in found.values()]
    assert values[0] == pytest.approx(values[1], rel=0.25)
    assert [row["sequences"] for row in found.values()] == [7, 7]


def test_person_without_a_condition_is_in_none(folder: Path) -> None:
    edit_trials(folder, "P03", lambda row: row["method"] != "press")
    study = study_report.trials(folder)
    found = rows_of(study_report.throughput(study))
    left = rows_of(study_report.omissions(study))
    assert [row["participants"] for row in found.values()] == [3, 3]
    assert left["dwell"]["unmatched_sequences"] == 2


def test_condition_without_any_sequence_has_a_row_of_its_own(folder: Path) -> None:
    for name in ("P01", "P02", "P03", "P04"):
        edit_trials(folder, name, times_out(*(("press", width, 4) for width in ("0.05", "0.1"))))
    study = study_report.trials(folder)
    found = rows_of(study_report.throughput(study))
    left = rows_of(study_report.omissions(study))
    assert (found["dwell"]["participants"], found["press"]["participants"]) == (4, 0)
    assert (found["press"]["throughput_bit_per_s"], found["press"]["left_out"]) == (None, 40)
    assert (left["press"]["short_sequences"], left["press"]["no_selection"]) == (8, 8)

    for name in ("P01", "P02", "P03", "P04"):
        edit_trials(folder, name, times_out(*(("dwell", width, 4) for width in ("0.05", "0.1"))))
    study = study_report.trials(folder)
    with pytest.raises(
        PointItError, match=r"no throughput .*of 16 sequences 16 are shorter, 0 have no counter"
    ):
        study_report.throughput(study)
    assert len(study_report.omissions(study)) == 2


def test_groups_of_people_are_not_matched_with_each_other(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0, "press": 0.8}, people=4, rings=RINGS[:2], between=True, wrong=0.0)
    table = study_report.throughput(study_report.trials(tmp_path))
    assert [(row["group"], row["participants"], row["sequences"]) for row in table] == [
        *(("a", 2, 4), ("b", 2, 4), ("a", 2, 4), ("b", 2, 4))
    ]


def test_regression_is_of_people_with_all_sizes_in_all_conditions(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0, "press": 0.8}, people=4, wrong=0.0, targets=5)
    edit_trials(tmp_path, "P02", lambda row: (row["method"], row["target_width_m"]) != ("press", "0.03"))
    table = study_report.fitts(study_report.trials(tmp_path))
    assert [(row["participants"], row["left_out"]) for row in table] == [(3, 1), (3, 1)]


def test_report_prints_omissions_of_each_condition(folder: Path) -> None:
    edit_trials(folder, "P02", times_out(("press", "0.05", 3)))
    done = CliRunner().invoke(report_command, [str(folder)])
    assert done.exit_code == 0, done.output
    sentence = (
        "Throughput of press in m: 1 of 8 sequences are left out, 1 with fewer than 5 selections and 0"
        " without a counterpart in another condition."
    )
    assert f"note: {sentence}" in done.stderr
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert sentence in text
    assert "<th>in short sequences</th>" in text


@settings(deadline=None, max_examples=25)
@given(
    lost=st.sets(
        st.tuples(st.sampled_from(["dwell", "press"]), st.sampled_from(["0.05", "0.1"]), st.integers(0, 5))
    )
)
def test_every_trial_is_used_or_counted_as_left_out(
    tmp_path_factory: pytest.TempPathFactory, lost: set[tuple[str, str, int]]
) -> None:
    folder = tmp_path_factory.mktemp("any")
    write_study(folder, {"dwell": 1.0, "press": 0.8}, people=2, rings=RINGS[:2], wrong=0.2, targets=5)
    edit_trials(folder, "P01", times_out(*lost))
    study = study_report.trials(folder)
    for row in study_report.omissions(study):
        assert row["trials"] == 24 == row["used"] + sum(row[name] for name in PARTS)
        assert row["sequences"] + row["short_sequences"] + row["unmatched_sequences"] == 4
