"""Things that pointing tells apart, labels that sound alike or take long, and their letters in pictures."""

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.collections import QuadMesh

from pointit.cli.main import command
from pointit.maps.checks.things import check_labels, separability, spoken_words, syllable_count
from pointit.maps.file import load_map, parse_map_file
from pointit.maps.picture import map_figure
from pointit.maps.things import things_of
from pointit.runtime.errors import ConfigError
from pointit.schemas import Thing

TWO_AND_ONE = """
things:
  screws: {center: [3, 0.3, 1.6], size: [0.2, 0.2, 0.2]}
  nuts: {center: [3, -0.3, 1.6], size: [0.2, 0.2, 0.2]}
  radio: {center: [-3, 0, 1.6], size: [0.2, 0.2, 0.2]}
"""


def test_things_are_told_apart_from_near_and_the_right_side() -> None:
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
def test_map_with_only_a_tracked_object_is_checked_and_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, action: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tracked.yaml").write_text("things: {agv1: {at: object}}")
    done = CliRunner().invoke(command, ["map", action[0], "tracked.yaml", *action[1:]])
    assert (done.exit_code, "1 thing" in done.output) == (0, True), done.output


def test_map_without_placed_things_is_refused_in_one_sentence() -> None:
    with pytest.raises(ConfigError, match="add a section `things`"):
        separability(())


def findings(*labels: str) -> list[str]:
    size = (0.2, 0.2, 0.2)
    things = [
        Thing(id=f"t{index}", label=label, center_m=(1.0, 0.0, 1.0), size_m=size)
        for index, label in enumerate(labels)
    ]
    return [f"{each.where}: {each.text}" for each in check_labels(things)]


@pytest.mark.parametrize(
    ("first", "second"), [("bolts", "volts"), ("Nuts", "mats"), ("Tür", "dur"), ("left door", "lift tour")]
)
def test_labels_of_similar_letters_are_reported_as_sounding_alike(first: str, second: str) -> None:
    assert findings(first, second) == [f"things.t1: {second!r} sounds like {first!r} of t0; change one label"]


@pytest.mark.parametrize(
    ("first", "second"),
    [("bin 1", "bin 11"), ("fifteen", "fifty"), ("bin 5", "bin 50"), ("box 13", "box 30")],
)
def test_numbers_that_are_taken_for_each_other_sound_alike(first: str, second: str) -> None:
    assert findings(first, second)[0] == (
        f"things.t1: {second!r} sounds like {first!r} of t0; change one label"
    )


def test_labels_whose_first_three_syllables_are_the_same_begin_alike() -> None:
    found = findings("Kaffeemaschine oben links", "Kaffeemaschine oben rechts", "Kaffee")
    assert found[0] == (
        "things.t1: 'Kaffeemaschine oben rechts' begins for 0.6 s as 'Kaffeemaschine oben links' of t0; "
        "say first what differs"
    )
    assert len(found) == 2


@pytest.mark.parametrize(
    ("first", "second"),
    [("radio", "kettle"), ("box 1", "box 2"), ("door", "lamp"), ("灯", "门"), ("bin 10", "bin 1")],
)
def test_labels_that_sound_different_are_not_reported(first: str, second: str) -> None:
    assert findings(first, second) == []


def test_a_label_of_more_than_three_syllables_takes_too_long() -> None:
    assert findings("radio", "heater", "washing machine") == [
        ("things: labels take longer than 0.6 s to speak: 'washing machine' (0.8 s); give shorter ones")
    ]
    many = findings(*(f"washing machine {letter}" for letter in "abcdefghijkl"))
    assert many[-1].endswith(" and 2 more; give shorter ones")


def test_long_ids_without_a_label_are_no_labels() -> None:
    assert findings("", "", "") == []


def test_digits_and_accents_count_as_spoken() -> None:
    assert spoken_words("Café_27") == ["cafe", "twenty", "seven"]
    assert spoken_words("bin 11, 105, 07") == ["bin", "eleven", "one", "zero", "five", "zero", "seven"]
    assert [syllable_count(word) for word in ("table", "stove", "the", "rhythm", "灯")] == [2, 1, 1, 1, 1]


def plot(folder: Path, name: str, label: str, suffix: str) -> tuple[Path, str]:
    path = folder / f"{name}.yaml"
    picture = folder / f"picture{suffix}"
    thing = f'{{light: a, mode: switch, label: "{label}"}}'
    path.write_text(f"lamps: {{a: {{position: [0, 0, 1]}}}}\nthings: {{t: {thing}}}\n", encoding="utf-8")
    result = CliRunner().invoke(command, ["map", "plot", str(path), "-o", str(picture)])
    assert result.exception is None, result.output
    return picture, result.stderr


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_letters_without_a_font_are_boxes_with_a_note(tmp_path: Path, suffix: str) -> None:
    private = "\U000f0001\U000f0002"  # no font of any machine has these
    picture, note = plot(tmp_path, f"raum_{private}", "Küche", suffix)
    assert picture.stat().st_size > 1000
    assert note.startswith("note: letters are drawn as boxes: no font here has them; install one")


@pytest.mark.parametrize("label", ["Küche", "Ωμέγα", "света", "half $1 of $2", r"cost $\\frac{a$"])
def test_letters_of_the_usual_font_and_formulas_are_texts(tmp_path: Path, label: str) -> None:
    assert "note" not in plot(tmp_path, "room", label, ".svg")[1]
