"""`pointit evaluate selection`: what people read, what programs read, what is refused."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.cli.selection import METHODS, selection
from pointit_lab.evaluation.selection import condition as selection_condition
from pointit_lab.evaluation.selection import method as selection_method
from tests.support.invoked import printed


def invoke(*arguments: str) -> tuple[str, str]:
    return printed(selection, *arguments, "--jobs", "1")


@pytest.fixture(autouse=True)
def few_conditions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("POINTIT_DATA", raising=False)
    all_of = selection_condition.conditions

    def few(benches: Sequence[str] = ()) -> list[selection_condition.Condition]:
        return all_of(benches)[:2]

    monkeypatch.setattr(selection_condition, "conditions", few)


def test_a_table_for_people_json_and_a_picture(tmp_path: Path) -> None:
    file = tmp_path / "rows.json"
    picture = tmp_path / "rows.png"
    out, err = invoke(
        *("--bench", "belts_lab", "--method", "gauge", "--method", "hold@0.5", "--trials", "2"),
        *("--json", str(file), "--plot", str(picture)),
    )

    assert "static, 1 of 3" in out
    assert "hold@0.5" in out
    assert "no people of belts_lab to compare with: give --data DIR" in err

    rows = json.loads(file.read_text())["rows"]
    assert [(row["bench"], row["condition"], row["method"], row["n"]) for row in rows] == [
        ("belts_lab", condition, method, 2)
        for condition in ("static, 1 of 3", "static, 2 of 6")
        for method in ("gauge", "hold@0.5")
    ]
    assert {"time_s", "wrong_rate", "missed_rate", "human"} <= rows[0].keys()
    assert picture.stat().st_size > 1000


@pytest.mark.long
@pytest.mark.slow
def test_differences_between_methods_from_twenty_trials_on(tmp_path: Path) -> None:
    file = tmp_path / "rows.json"
    name = selection_condition.conditions(["belts_lab"])[0].name
    arguments = ("--bench", "belts_lab", "--condition", name, "--method", "gauge", "--method", "hold@2")
    out, _ = invoke(*arguments, "--trials", "20", "--json", str(file))
    (difference,) = json.loads(file.read_text())["differences"]
    assert (difference["method"], difference["other"], difference["trials"]) == ("hold@2", "gauge", 20)
    assert difference["time_s"]["low"] > 0.5
    assert difference["claims"] == ["hold@2 is slower"]
    assert "hold@2 is slower" in " ".join(out.split())
    out, _ = invoke(*arguments, "--trials", "2", "--json", "-")
    assert json.loads(out)["differences"] == []


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--method", "wink"), "no such method; there are original, hold, fraction, gauge"),
        (("--json", "."), "is a folder"),
        (("--plot", "nowhere/rows.png"), "cannot be written"),
        (("--plot", "rows.docx"), "must end in one of"),
        (("--data", "nowhere"), "not a folder"),
    ],
)
def test_mistakes_are_told_before_the_work(arguments: tuple[str, ...], complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        invoke(*arguments)


def test_the_methods_that_are_offered_are_those_there_are() -> None:
    assert set(METHODS) == set(selection_method.METHODS)
