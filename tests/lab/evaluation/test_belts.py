"""Packages on belts: what is read, refused, and published."""

import json
from pathlib import Path
from typing import Any

import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets.belts_lab import FILE, NAME, read_runs
from pointit_lab.evaluation.selection.human import humans, lab_figures
from tests.support import there
from tests.support.data import data_file


def package(uid: int, *, target: bool, selected: list[list[int]]) -> dict[str, Any]:
    return {"uid": uid, "target": target, "first": 0, "strip": [[0, 0]], "pos": 0.5, "selected": selected}


def run(*packages: dict[str, Any], **fields: Any) -> dict[str, Any]:
    usual = {
        "subject": "A", "interface": "pointing", "motion": "static", "level": 1, "belt_speed_mps": 0.0,
        "package_len_m": 0.5, "t": [0.1 * i for i in range(100)], "packages": list(packages),
    }  # fmt: skip
    return usual | fields


def write(folder: Path, *lines: dict[str, Any] | str) -> Path:
    folder = folder / NAME
    folder.mkdir(exist_ok=True)
    texts = [line if isinstance(line, str) else json.dumps(line) for line in lines]
    (folder / FILE).write_text("\n".join(texts) + "\n")
    return folder


GOOD = run(
    package(1, target=True, selected=[[0, 0], [20, 1], [30, 0], [50, 1]]),
    package(2, target=False, selected=[[0, 0], [35, 1], [45, 0]]),
    package(3, target=False, selected=[[0, 0]]),
)


def test_toggles_that_leave_packages_in_the_wrong_state_are_wrong(tmp_path: Path) -> None:
    (read,) = read_runs(write(tmp_path, GOOD))
    assert [(round(toggle.at_s, 1), toggle.is_wrong) for toggle in read.toggles] == [
        (2.0, False),
        (3.0, True),
        (3.5, True),
        (4.5, False),
        (5.0, False),
    ]
    assert read.completion_s == pytest.approx(5.0)
    assert (read.packages, read.targets, read.missed) == (3, 1, 0)


def test_run_ending_without_its_target_is_a_miss_without_time(tmp_path: Path) -> None:
    lost = run(package(1, target=True, selected=[[0, 0], [20, 1], [30, 0]]))
    figures = lab_figures(read_runs(write(tmp_path, GOOD, lost)))
    assert figures.n == 2
    assert there(figures.time_s).median == pytest.approx(5.0)
    assert figures.missed_rate == 0.5
    assert figures.wrong_rate == pytest.approx(3 / 7)


def test_a_change_after_the_last_sample_was_seen_with_it(tmp_path: Path) -> None:
    (read,) = read_runs(write(tmp_path, run(package(1, target=True, selected=[[0, 0], [100, 1]]))))
    assert read.completion_s == pytest.approx(9.9)


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("{", "line 2: .*JSON"),
        ("[]", "line 2: .*correct the line"),
        (run(), "line 2: packages: "),
        (run(package(1, target=True, selected=[[0, 0]]), interface="thumb"), "line 2: interface: .*thumb"),
        (run(package(1, target=True, selected=[[0, 0]]), t=[1.0, 0.5]), "line 2: t: time goes backwards"),
        (run(package(1, target=True, selected=[[0, 0]]), subject=""), "line 2, 'subject': a text"),
        (run(package(7, target=True, selected=[[0, 0], [101, 1]])), "line 2: packages, uid 7, selected: "),
        (run(package(7, target=True, selected=[[5, 0], [4, 1]])), "line 2: packages, uid 7, selected: "),
        ('{"subject": NaN}', "line 2: "),
    ],
)
def test_a_malformed_line_is_one_sentence(line: dict[str, Any] | str, complaint: str, tmp_path: Path) -> None:
    folder = write(tmp_path, GOOD, line)
    with pytest.raises(ConfigError, match=complaint) as error:
        read_runs(folder)
    assert str(folder / FILE) in str(error.value)
    assert "\n" not in str(error.value)


def test_people_that_are_not_there_are_noted(tmp_path: Path) -> None:
    notes: list[str] = []
    assert humans(None, notes) == {}
    assert humans(tmp_path, notes) == {}
    assert len(notes) == 2
    write(tmp_path, GOOD)
    assert list(humans(tmp_path, [])) == [("belts_lab", "static, 1 of 3")]


def test_the_published_runs() -> None:
    found = humans(data_file("recordings/belts_lab").parent, [])
    pointing = {name: figures["pointing"] for (bench, name), figures in found.items() if bench == NAME}
    assert list(pointing) == [
        *("static, 1 of 3", "static, 2 of 6", "static, 3 of 9", "moving, 0.2 m/s"),
        *("moving, 0.9 m/s", "moving, 0.5 m/s"),
    ]
    medians = {name: figures.time_s.median for name, figures in pointing.items() if figures.time_s}
    assert medians["static, 1 of 3"] == pytest.approx(2.3, abs=0.2)
    assert medians["moving, 0.9 m/s"] == pytest.approx(7.2, abs=0.2)
    assert all(figures.missed_rate == 0.0 for figures in pointing.values())
