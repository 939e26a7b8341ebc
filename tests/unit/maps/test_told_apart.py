"""The share of things that are told apart by pointing, by place, and the picture of it."""

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.collections import QuadMesh

from pointit.cli.main import command
from pointit.maps.checks.things import separability
from pointit.maps.file import load_map, parse_map_file
from pointit.maps.model import things_of
from pointit.maps.picture import map_figure
from pointit.runtime.errors import ConfigError

TWO_AND_ONE = """
things:
  screws: {center: [3, 0.3, 1.6], size: [0.2, 0.2, 0.2]}
  nuts: {center: [3, -0.3, 1.6], size: [0.2, 0.2, 0.2]}
  radio: {center: [-3, 0, 1.6], size: [0.2, 0.2, 0.2]}
"""


def test_things_are_told_apart_from_near_and_from_the_right_side() -> None:
    share = separability(things_of(parse_map_file(TWO_AND_ONE.encode(), Path("two.yaml"))))
    apart_m = 0.6 - 0.2
    assert share(3.0 - apart_m / math.tan(math.radians(7.0)) + 0.1, 0.0) == 1.0
    assert share(-2.5, 0.0) == pytest.approx(1 / 3), "the two are 4 degrees apart"
    assert share(3.0, 3.0) == pytest.approx(1 / 3), "one is behind the other"
    assert share(-9.0, 0.0) == 0.0, "the radio hides both"


def test_the_floor_is_coloured_by_it(tmp_path: Path) -> None:
    path = tmp_path / "two.yaml"
    path.write_text(TWO_AND_ONE)

    def share(x: float, _y: float) -> float:
        return 1.0 if x > 0.0 else 0.0

    figure = map_figure(load_map(str(path), 0), {}, "two", separability=share)
    (mesh,) = (each for each in figure.axes[0].collections if isinstance(each, QuadMesh))
    shares = np.asarray(mesh.get_array())
    assert set(shares[:, 0].ravel()) == {0.0}
    assert set(shares[:, -1].ravel()) == {1.0}
    picture = tmp_path / "a.png"
    done = CliRunner().invoke(command, ["map", "plot", str(path), "-o", str(picture), "--told-apart"])
    assert done.exit_code == 0
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize("action", [["check", "--pose=0,0"], ["plot", "-o", "tracked.svg"]])
def test_a_map_of_nothing_but_a_tracked_object_is_checked_and_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, action: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tracked.yaml").write_text("things: {agv1: {at: object}}")
    done = CliRunner().invoke(command, ["map", action[0], "tracked.yaml", *action[1:]])
    assert (done.exit_code, "1 thing" in done.output) == (0, True), done.output


def test_a_map_without_things_that_have_a_place_is_one_sentence() -> None:
    with pytest.raises(ConfigError, match="add a section `things`"):
        separability(())
