"""Files of a home: what is written, and what people have written stays."""

from pathlib import Path

import pytest
import yaml

from pointit.bridges.home_assistant.setup.home_files import (
    HomeFiles,
    advice_on,
    draft_map,
    placed_map,
    with_home_assistant,
)
from pointit.bridges.home_assistant.setup.progress import ChosenLamp, PlacedLamp, StoredSetup
from pointit.maps.file import parse_map_file
from pointit.runtime.errors import RefusedError

PATH = Path("home.yaml")
OWN = b"""# mine
things:
  desk: {home_assistant: light.desk, label: My desk, mode: button, center: [1, 1, 1], size: [1, 1, 1]} # big
  old: {home_assistant: light.old, center: [2, 2, 1], size: [0.3, 0.3, 0.3]}
  hand: {home_assistant: {entity: light.old, action: light.turn_on}, center: [2, -2, 1], size: [1, 1, 1]}
paced_from:
  A: {position: [0, 0]}
"""


def setup_of(
    *lamps: ChosenLamp, offered: tuple[str, ...] = (), **positions: tuple[float, float, float]
) -> StoredSetup:
    placed = tuple(
        PlacedLamp(
            lamp=lamp.id, end=end, position_m=positions[f"{lamp.label}{end}"], direction_sigma_rad=0.04
        )
        for lamp in lamps
        for end in lamp.ends
    )
    return StoredSetup(
        step="try",
        lamps=lamps,
        offered=offered,
        placed=placed,
        places_m=((0.0, 0.0), (0.123, 2.04)),
        url="http://ha:8123",
    )


def test_new_home_is_a_map_that_a_run_accepts(tmp_path: Path) -> None:
    files = HomeFiles(tmp_path / "home")
    files.create()
    assert not parse_map_file(files.read_map(), files.map).things
    assert yaml.safe_load(files.site.read_text()) is None
    assert files.site.stat().st_mode & 0o777 == 0o600


def test_lamps_are_added_and_what_people_wrote_stays() -> None:
    setup = setup_of(
        ChosenLamp(id="light.desk", label="desk"),
        ChosenLamp(id="light.shelf", label="Shelf: left"),
        offered=("light.desk", "light.shelf", "light.old"),
        **{"desk": (3.0, 0.5, 0.9), "Shelf: left": (2.0, 1.0, 1.4)},
    )
    text = placed_map(OWN, PATH, setup)
    file = parse_map_file(text, PATH)

    assert text.startswith(b"# mine\n")
    assert b"# big" in text
    desk = file.things["desk"]
    assert (desk.label, desk.mode, desk.center, desk.size) == (
        "My desk",
        "button",
        (3, 0.5, 0.9),
        (1, 1, 1),
    )

    shelf = file.things["shelf"]
    assert (shelf.home_assistant, shelf.label, shelf.center) == (
        "light.shelf",
        "Shelf: left",
        (2.0, 1.0, 1.4),
    )
    assert set(file.things) == {"desk", "shelf", "hand"}, (
        "a lamp that was deselected goes, an action of people stays"
    )
    assert [place.position for place in file.paced_from.values()] == [(0, 0), (0.12, 2.04)]


def test_second_place_is_removed_when_one_place_suffices() -> None:
    setup = setup_of(ChosenLamp(id="light.desk", label="desk"), desk=(3.0, 0.5, 0.9))
    twice = placed_map(
        placed_map(OWN, PATH, setup), PATH, setup.model_copy(update={"places_m": ((0.0, 0.0),)})
    )
    assert list(parse_map_file(twice, PATH).paced_from) == ["A"]


def test_draft_has_no_things_that_could_react() -> None:
    file = parse_map_file(draft_map(OWN, PATH), PATH)
    assert not file.things
    assert list(file.paced_from) == ["A"]


def test_strip_gets_its_line_from_its_ends() -> None:
    content = b"strips:\n  shelf: {line: [[0, 0, 1], [1, 0, 1]], pixels: 60}\n"
    strip = ChosenLamp(id="strip:shelf", label="shelf")
    setup = setup_of(strip, shelffirst=(2.0, -0.5, 1.2), shelflast=(2.0, 0.5, 1.2))
    file = parse_map_file(placed_map(content, PATH, setup), PATH)
    assert file.strips["shelf"].line == ((2.0, -0.5, 1.2), (2.0, 0.5, 1.2))
    assert file.things["shelf"].mode == "switch"


def test_lamp_that_the_map_has_lost_is_refused() -> None:
    setup = setup_of(ChosenLamp(id="lamp:door", label="door"), door=(2.0, 1.0, 1.4))
    with pytest.raises(RefusedError, match="no lamp door any more"):
        placed_map(OWN, PATH, setup)


def test_parameters_of_other_services_stay() -> None:
    text = "# mine\nweb: {port: 9000}\nhome-assistant:\n  url: http://old\n  hover: false\n"
    text += "selector: {method: hold}\n"
    changed = with_home_assistant(text, 'http://ha:8123/"', Path("/x y/token"))
    data = yaml.safe_load(changed)
    assert data == {
        "web": {"port": 9000},
        "selector": {"method": "hold"},
        "home_assistant": {"url": 'http://ha:8123/"', "token_file": "/x y/token"},
    }
    assert changed.startswith("# mine\n")


@pytest.mark.parametrize("url", ["http://ha:8123", "mqtt://hub", "mqtts://anna@hub"])
def test_parameters_in_the_section_of_an_unchanged_address_stay(url: str) -> None:
    written = with_home_assistant("web: {port: 9000}\n", url, Path("/secret"))
    first, _, section = written.partition("home_assistant")
    section = section.replace("}", ", hover: false, actions: [notify.anna]} # mine")
    text = f"{first}home_assistant{section}"
    assert yaml.safe_load(text)["home_assistant"]["hover"] is False
    assert with_home_assistant(text, url, Path("/secret")) == text
    assert "notify" not in with_home_assistant(text, "http://other", Path("/secret"))


@pytest.mark.parametrize("text", ["", "home_assistant: 7\n", "home_assistant: [1]\n", "home_assistant:\n"])
def test_section_without_parameters_is_replaced(text: str) -> None:
    data = yaml.safe_load(with_home_assistant(text, "mqtt://hub", Path("/secret")))
    assert data == {"home_assistant": {"broker": "mqtt://hub"}}


def test_confused_names_and_lamps_are_reported() -> None:
    content = b"""
things:
  a: {home_assistant: light.a, label: Lamp, center: [3, 0, 1], size: [0.3, 0.3, 0.3]}
  b: {home_assistant: light.b, label: Lamb, center: [3, 0.1, 1.5], size: [0.3, 0.3, 0.3]}
"""
    sentences = advice_on(content, PATH, [(0.0, 0.0)])
    assert any("sounds like" in sentence for sentence in sentences)
    assert any("beside" in sentence for sentence in sentences)
