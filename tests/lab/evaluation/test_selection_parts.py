"""The parts of the evaluation of selecting: methods by name, layouts, scores, rows, pictures."""

import json
from pathlib import Path

import numpy as np
import pytest

from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError
from pointit.schemas import NS_PER_S
from pointit_lab.evaluation.selection.carousel import Carousel
from pointit_lab.evaluation.selection.condition import BENCHES, LAB, conditions
from pointit_lab.evaluation.selection.method import METHODS, selector_config
from pointit_lab.evaluation.selection.plot import check_plot, plot
from pointit_lab.evaluation.selection.row import SelectionMetrics, SelectionRow, TimeSpread
from pointit_lab.evaluation.selection.score import Score, figures_of
from pointit_lab.evaluation.selection.selection import document


def test_a_method_has_the_time_that_its_name_says() -> None:
    assert selector_config("hold@0.6").window_s == 0.6
    assert selector_config("original@1").fraction == METHODS["original"].fraction
    gauge = selector_config("gauge@1.6").gauge
    assert gauge.full_s == 1.6
    usual = METHODS["gauge"].gauge
    assert gauge.sparse_full_s / gauge.full_s == pytest.approx(usual.sparse_full_s / usual.full_s)


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("dwell", "no such method; there are original, hold"),
        ("hold@", "seconds were expected"),
        ("hold@x", "seconds were expected"),
        ("hold@-1", "window_s"),
        ("hold@nan", "--method hold@nan: "),
        ("gauge@99", "full_s"),
    ],
)
def test_a_method_that_is_none_is_refused_in_a_sentence(name: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        selector_config(name)


def test_conditions_have_names_of_their_own() -> None:
    names = [(condition.bench, condition.name) for condition in conditions()]
    assert len(set(names)) == len(names)
    assert {bench for bench, _ in names} == set(BENCHES)
    assert [condition.targets for condition in conditions([LAB])] == [1, 2, 3, 3, 3, 3]


def test_packages_go_around_the_ring() -> None:
    ring = Carousel(
        load_map("lab", 0),
        np.array([1.0, 4.9, 9.9]),
        ["red", "blue", "blue"],
        length_m=0.5,
        speed_mps=0.5,
        start_ns=0,
    )
    first, later = ring.tracked(0).objects, ring.tracked(NS_PER_S).objects
    assert [thing.surface_id for thing in first] == ["0", "0", "1"]
    assert [thing.surface_id for thing in later] == ["0", "1", "0"]
    assert [thing.surface_position_m for thing in later] == pytest.approx([1.5, 0.4, 0.4])
    assert later[0].position_m == pytest.approx((4.85, 0.075, 0.9))
    assert first[0].velocity_mps == pytest.approx((0.0, 0.5, 0.0))


def test_figures_over_trials() -> None:
    good, bad = Score(targets=2), Score(targets=2, missed=1)
    good.toggled(2.0, selected=True, is_target=True)
    good.toggled(5.0, selected=True, is_target=True)
    good.took_s = [5.0]
    bad.toggled(2.0, selected=True, is_target=False)
    bad.toggled(3.0, selected=False, is_target=False)
    bad.toggled(4.0, selected=False, is_target=True)
    figures = figures_of([good, bad], per_package=False)
    assert (figures.n, figures.wrong_rate, figures.missed_rate) == (2, 0.4, 0.25)
    assert figures.time_s == TimeSpread(median=5.0, p90=5.0)
    assert figures.between_s == TimeSpread(median=3.0, p90=3.0)
    assert figures_of([good, bad], per_package=True).n == 4
    assert figures_of([Score(targets=1)], per_package=False).wrong_rate is None


def rows() -> list[SelectionRow]:
    some = SelectionMetrics(n=3, time_s=TimeSpread(median=2.0, p90=3.0), wrong_rate=0.0, missed_rate=None)
    none = SelectionMetrics(n=3, time_s=None)
    return [
        SelectionRow(bench="a", condition="x", method="hold", figures=some, human={"pointing": some}),
        SelectionRow(bench="a", condition="y", method="hold", figures=none, human={}),
    ]


def test_the_document_is_as_promised() -> None:
    row = json.loads(json.dumps(document(rows(), [])))["rows"][0]
    assert list(row)[:4] == ["bench", "condition", "method", "n"]
    assert row["time_s"] == {"median": 2.0, "p90": 3.0}
    assert row["wrong_rate"] == 0.0
    assert row["human"]["pointing"]["time_s"]["median"] == 2.0


def test_a_picture_on_request(tmp_path: Path) -> None:
    file = tmp_path / "rows.svg"
    check_plot(file)
    plot(rows(), file)
    assert "<svg" in file.read_text()
    with pytest.raises(ConfigError, match="must end in one of"):
        check_plot(tmp_path / "rows.docx")
