"""The evaluation of things: reaches with and without light, people who point elsewhere, its command."""

import json

import pytest
from click.testing import CliRunner

from pointit.runtime.errors import ConfigError
from pointit.services.selector.config import SelectorConfig
from pointit_lab.cli.things import things
from pointit_lab.evaluation.things.things import ROWS, Share, reaches, row_of, wrong_selections
from tests.support.invoked import printed

CONFIG = SelectorConfig(method="estimate")
LIT, _, NEAR_LIT, NEAR_DARK, _ = ROWS


def test_light_lets_people_find_what_is_hard_to_point_at() -> None:
    lit, dark = (row_of(row, reaches(CONFIG, (row, 2000, 20))) for row in (NEAR_LIT, NEAR_DARK))
    assert lit.right.count >= 18
    assert dark.right.count <= 10
    assert lit.wrong.count + dark.wrong.count <= 1
    assert 1.5 < lit.median_s < 3.5
    assert lit.right.count + lit.wrong.count + lit.nothing.count == 20
    assert reaches(CONFIG, (LIT, 2000, 2)) == reaches(CONFIG, (LIT, 2000, 2))


def test_the_interval_is_wilsons() -> None:
    assert Share(95, 100).interval == pytest.approx((0.888, 0.978), abs=1e-3)
    assert Share(0, 300).interval == pytest.approx((0.0, 0.0126), abs=1e-3)


def test_default_method_fires_less_than_hasty_ones_when_pointing_elsewhere() -> None:
    hasty = SelectorConfig.model_validate({"method": "estimate", "estimate": {"sure": 0.5, "dwell_s": 0.3}})
    assert wrong_selections(CONFIG, ("nothing", 2000, 1.0)) == 0
    assert wrong_selections(hasty, ("strip", 2001, 2.0)) > wrong_selections(CONFIG, ("strip", 2001, 2.0))


def test_an_unknown_method_is_refused_with_those_that_are_there() -> None:
    with pytest.raises(ConfigError, match=r"--method nope: there is no such method; there are .*estimate"):
        printed(things, "--method", "nope", "--jobs", "1")


def test_the_command_gives_the_same_rows_as_json() -> None:
    ended = CliRunner().invoke(
        things, ["--trials", "2", "--people", "1", "--minutes", "0.1", "--jobs", "1", "--json", "-"]
    )
    assert ended.exit_code == 0, ended.output
    document = json.loads(ended.stdout)
    assert [row["name"] for row in document["rows"]] == [row.name for row in ROWS]
    assert set(document["unintended_per_30_min"]) == {"strip", "nothing"}
