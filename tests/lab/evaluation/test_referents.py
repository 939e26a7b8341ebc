"""The evaluation of referents: targets on people of other seeds, rules beside it, its command."""

import json

import pytest
from click.testing import CliRunner

from pointit.services.listener.referents import MODEL
from pointit_lab.cli.referents import referents
from pointit_lab.evaluation.referents.referents import RULES, SCENES, answers, reliability, rows_of
from pointit_lab.evaluation.referents.speakers import SpokenScene, speak

ONE, TWO = (SpokenScene(apart_deg=20.0, words=words) for words in (1, 2))


@pytest.mark.parametrize("scene", [ONE, TWO], ids=["one word", "two words"])
def test_things_20_degrees_apart_are_understood_or_asked_about(scene: SpokenScene) -> None:
    model, *rules = rows_of(scene, answers(MODEL, (scene, 4000, 300)))
    assert model.right.value + model.asked.value >= 0.95
    assert model.wrong.value <= 0.02
    assert [row.rule for row in rules] == list(RULES)
    assert all(row.wrong.value > 2.0 * model.wrong.value for row in rules), "rules that are never in doubt"


def test_a_stated_probability_of_nine_in_ten_is_right_as_often() -> None:
    found = [each for scene in SCENES for each in answers(MODEL, (scene, 4000, 30))]
    sure = [each for each in found if each.stated >= 0.9]
    assert len(sure) > 100
    assert sum(each.is_best for each in sure) >= 0.9 * len(sure)
    assert sum(row.right.of for row in reliability(found)) == len(found)


def test_a_person_who_means_nothing_starts_nothing() -> None:
    nothing = SpokenScene(apart_deg=20.0, is_nothing=True)
    model, *_ = rows_of(nothing, answers(MODEL, (nothing, 4000, 100)))
    assert model.right.count == 0
    assert model.wrong.value <= 0.02


def test_a_person_is_the_same_for_the_same_seed_and_their_times_are_in_order() -> None:
    said = speak(TWO, 7)
    assert said == speak(TWO, 7) != speak(TWO, 8)
    stamps = [cursor.stamp_ns for cursor in said.cursors]
    assert stamps == sorted(stamps)
    assert len(set(said.goals)) == 2


def test_the_command_gives_the_same_rows_as_json() -> None:
    ended = CliRunner().invoke(referents, ["--people", "1", "--jobs", "1", "--json", "-"])
    assert ended.exit_code == 0, ended.output
    document = json.loads(ended.stdout)
    assert [row["scene"] for row in document["rows"]] == [
        s.name for s in SCENES for _ in range(len(RULES) + 1)
    ]
    assert document["median_ms"] <= document["p99_ms"]
    shown = CliRunner().invoke(referents, ["--people", "1", "--jobs", "1"])
    assert "99th percentile" in shown.output
