"""Files of a home: what is written, and what people have written stays."""

from pathlib import Path

import pytest
import yaml

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.setup.home_files import (
    HomeFiles,
    advice_on,
    draft_map,
    placed_map,
    with_home_assistant,
)
from pointit.bridges.home_assistant.setup.stored_setup import ChosenLamp, PlacedLamp, StoredSetup
from pointit.maps.file import parse_map_file
from pointit.runtime.errors import ConfigError, RefusedError

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


SITE_FILE = Path("site.yaml")


def changed_site(text: str, url: str, secret: Path = Path("/secret")) -> str:
    return with_home_assistant(text.encode(), SITE_FILE, url, secret).decode()


def test_parameters_of_other_services_stay() -> None:
    text = "# mine\nweb: {port: 9000}\nhome-assistant:\n  url: http://old\n  hover: false\n"
    text += "selector: {method: hold}\n"
    changed = changed_site(text, 'http://ha:8123/"', Path("/x y/token"))
    data = yaml.safe_load(changed)
    assert data == {
        "web": {"port": 9000},
        "selector": {"method": "hold"},
        "home-assistant": {"url": 'http://ha:8123/"', "token_file": "/x y/token", "hover": False},
    }
    assert changed.startswith("# mine\n")


@pytest.mark.parametrize("url", ["http://ha:8123", "mqtt://hub", "mqtts://anna@hub"])
def test_parameters_in_the_section_stay_whatever_the_address(url: str) -> None:
    written = changed_site("web: {port: 9000}\n", url)
    text = f"{written}  hover: false  # mine\n  actions: [notify.anna]\n"
    assert changed_site(text, url) == text
    other = changed_site(text, "http://other")
    assert yaml.safe_load(other)["home_assistant"] == {
        "url": "http://other",
        "token_file": "/secret",
        "hover": False,
        "actions": ["notify.anna"],
    }
    assert "hover: false  # mine\n" in other


@pytest.mark.parametrize(
    ("url", "stays"), [("mqtts://anna@hub:8884", True), ("mqtt://hub", False), ("http://ha:8123", True)]
)
def test_section_with_an_authority_is_one_that_the_next_start_accepts(url: str, *, stays: bool) -> None:
    text = "home_assistant:\n  broker: hub\n  username: ben\n  tls: true\n  ca_file: /ca.pem  # ours\n"
    changed = changed_site(text, url)
    section = yaml.safe_load(changed)["home_assistant"]
    config = HomeAssistantConfig(**section)
    config.check()
    assert ("/ca.pem  # ours" in changed) == stays
    assert config.username == ("anna" if "@" in url else "")


EDITED_SITES = (
    "web: {port: 9000}\nhome_assistant:\n  url: http://old\n\n  hover: false\n",
    "web: {port: 9000}\nhome_assistant:\n  url: http://old\n# at the margin\n  hover: false\n",
    "web: {port: 9000}\nhome_assistant: {\n  url: http://old,\n  hover: false\n}\n",
    "web: {port: 9000}\nhome_assistant: {url: http://old, hover: false}\nselector: {}\n",
    "---\nweb: {port: 9000}\nhome_assistant:\n  hover: false\n...\n",
    "---\nweb: {port: 9000}\nhome_assistant:\n    hover: false",
    "{web: {port: 9000}, home_assistant: {url: http://old, hover: false}}\n",
    "home_assistant:\r\n  hover: false\r\nweb: {port: 9000}\r\n",
    "web: &web {port: 9000}\nhome_assistant: {<<: {hover: false}, url: http://old}\n",
    "web: {port: 9000}\nhome_assistant:\n  hover: false\n  note: |\n    url: in a text\n    of mine\n",
)
"""Files as people write them: blank lines, comments at the margin, braces, marks of documents, merges."""


@pytest.mark.parametrize("text", EDITED_SITES)
@pytest.mark.parametrize("url", ["http://ha:8123", "mqtts://anna@hub"])
def test_edited_site_file_is_the_same_but_for_the_address(text: str, url: str) -> None:
    before = yaml.safe_load(text)
    changed = changed_site(text, url)
    data = yaml.safe_load(changed)
    address = ("url", "token_file", "broker", "password_file")
    for key in address:
        before["home_assistant"].pop(key, None)
    key = "broker" if "mqtt" in url else "url"
    assert data["home_assistant"][key] == url
    for key in address:
        data["home_assistant"].pop(key, None)
    assert {name: value for name, value in data.items() if value} == {
        name: value for name, value in before.items() if value
    }
    assert changed.count("\n") - changed.count("\r\n") == (0 if "\r" in text else changed.count("\n"))


@pytest.mark.parametrize(
    "text", ["", "---\n...\n", "{web: {port: 9000}}\n", "web:\n  port: 9000\n...\n", "web: {port: 9000}"]
)
def test_section_is_added_to_any_form_of_file(text: str) -> None:
    data = yaml.safe_load(changed_site(text, "mqtt://hub"))
    assert data["home_assistant"] == {"broker": "mqtt://hub"}
    assert data.get("web") == (yaml.safe_load(text) or {}).get("web")


def test_form_that_cannot_be_edited_stays_and_the_sentence_has_the_lines(tmp_path: Path) -> None:
    files = HomeFiles(tmp_path)
    text = "mine: &mine {url: http://old, token_file: /t}\nhome_assistant: *mine\n"
    files.site.write_text(text)
    with pytest.raises(ConfigError, match=r'`home_assistant` needs url: "http://ha:8123", token_file: '):
        files.write_site(StoredSetup(url="http://ha:8123"))
    assert files.site.read_text() == text


@pytest.mark.parametrize("text", ["", "home_assistant: 7\n", "home_assistant: [1]\n", "home_assistant:\n"])
def test_section_without_parameters_is_replaced(text: str) -> None:
    data = yaml.safe_load(changed_site(text, "mqtt://hub"))
    assert data == {"home_assistant": {"broker": "mqtt://hub"}}


@pytest.mark.parametrize(
    "things",
    [
        b"things:\n  a: {home_assistant: light.a, center: [3, 0, 1], size: [1, 1, 1]}\n",
        b"things: {\n  a: {home_assistant: light.a, center: [3, 0, 1], size: [1, 1, 1]}\n}\n",
        b"things:  # mine\n\n  # a\n  a:\n   {home_assistant: light.a, center: [3, 0, 1], size: [1, 1, 1]}\n",
        b'"things": {a: {home_assistant: light.a, center: [3, 0, 1], size: [1, 1, 1]}}\n',
        b"things: {}\n",
    ],
)
def test_draft_of_any_form_has_the_rest_of_the_map(things: bytes) -> None:
    rest = b"# lamps\npaced_from:\n  A: {position: [0, 0]}  # here\n"
    for content in (things + rest, rest + things):
        draft = draft_map(content, PATH)
        assert not parse_map_file(draft, PATH).things
        assert b"  A: {position: [0, 0]}  # here\n" in draft


def test_confused_names_and_lamps_are_reported() -> None:
    content = b"""
things:
  a: {home_assistant: light.a, label: Lamp, center: [3, 0, 1], size: [0.3, 0.3, 0.3]}
  b: {home_assistant: light.b, label: Lamb, center: [3, 0.1, 1.5], size: [0.3, 0.3, 0.3]}
"""
    sentences = advice_on(content, PATH, [(0.0, 0.0)])
    assert any("sounds like" in sentence for sentence in sentences)
    assert any("beside" in sentence for sentence in sentences)
