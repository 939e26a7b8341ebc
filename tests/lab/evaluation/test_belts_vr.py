"""Packages on fast belts in virtual reality: what is read, what is refused, what the published ones say."""

import json
from pathlib import Path
from typing import Any

import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets.belts_vr import FILE, NAME, read_passages
from pointit_lab.evaluation.selection.human import humans, vr_figures
from tests.support import there
from tests.support.data import data_file


def passage(selected_t: float | None = 2.5, **fields: Any) -> dict[str, Any]:
    usual = {
        "subject": "V1",
        "step": 0,
        "speed_param": 2.0,
        "target": True,
        "t": [0.5 + 0.1 * i for i in range(50)],
        "selected_t": selected_t,
    }
    return usual | fields


def write(folder: Path, *lines: dict[str, Any]) -> Path:
    folder = folder / NAME
    folder.mkdir()
    (folder / FILE).write_text("".join(json.dumps(line) + "\n" for line in lines))
    return folder


def test_recall_and_wrong_selections(tmp_path: Path) -> None:
    folder = write(
        tmp_path,
        passage(2.5),
        passage(3.5),
        passage(None),
        passage(None, target=False),
        passage(1.0, target=False),
    )
    figures = vr_figures(read_passages(folder))
    assert figures.n == 3
    assert figures.missed_rate == pytest.approx(1 / 3)
    assert (figures.wrong_rate, there(figures.time_s).median) == pytest.approx((1 / 3, 2.5))


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        (passage(speed_param=0.0), "line 2: speed_param: "),
        (passage(0.1), "line 2: selected_t: a time after the first"),
        (passage(t=[]), "line 2: t: "),
        (passage(t=[0.2, 0.1]), "line 2: t: time goes backwards"),
        ({"subject": "V1"}, "line 2: .*and 3 more"),
    ],
)
def test_a_malformed_line_is_told_in_one_sentence(
    line: dict[str, Any], complaint: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=complaint):
        read_passages(write(tmp_path, passage(), line))


def test_the_published_packages() -> None:
    found = humans(data_file("recordings/belts_vr").parent, [])
    missed = {
        condition: figures["pointing"].missed_rate
        for (bench, condition), figures in found.items()
        if bench == NAME
    }
    assert missed["0.5 m/s"] == 0.0
    assert missed["2 m/s"] == pytest.approx(0.125)
    assert (missed["7.5 m/s"] or 0.0) > 0.8
