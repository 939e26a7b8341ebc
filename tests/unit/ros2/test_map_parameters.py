"""Maps as parameters of a ROS node, there and back; what is no map's."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.parameters import LINES, SECTIONS, of_maps, tree_of, value_of
from pointit.bridges.ros2.types.types import Types
from pointit.geometry.solids import Vec2
from pointit.geometry.vector import Vec3
from pointit.maps.checks.check import check_map
from pointit.maps.file import parse_map_file
from pointit.maps.model import ENTRIES, MapFile
from pointit.runtime.config.yaml_file import parse_yaml
from tests.support.parameter_server import message_of, parameters_of

TYPES = Types("jazzy")


def travelled(parameters: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters as received by another node, by the bytes of ROS."""
    kind = "rcl_interfaces/srv/GetParameters_Response"
    values = [message_of(TYPES, value) for value in parameters.values()]
    answer = TYPES.decode(kind, TYPES.encode(kind, TYPES.make(kind, values=values)))
    return {name: value_of(each) for name, each in zip(parameters, answer.values, strict=True)}


def test_what_the_parameters_are_called() -> None:
    tree = {
        "leds": {"door": {"position": [-1.5, 3.2, 1.8]}, "up.left": {"position": [2, -1, 1]}},
        "strips": {"1": {"line": [[0, 0.6, 1], [3, 0.6, 1]], "pixels": 90}},
        "links": [{"from": "main"}],
        "bays": {"7": "main"},
        "things": {
            "a.light": {"light": {"strip": "1", "from": 0, "to": 0.5}, "press": True},
            "b": {"light": "x", "at": "object"},
            "c.at": {"at": {"belt": "main", "from": 0, "to": 0.5}},
        },
    }
    assert tree_of(parameters_of(tree)) == tree
    assert parameters_of(tree, "site") == {
        "site.leds.door.position": [-1.5, 3.2, 1.8],
        "site.leds.up.left.position": [2, -1, 1],
        "site.strips.1.line": [0.0, 0.6, 1.0, 3.0, 0.6, 1.0],
        "site.strips.1.pixels": 90,
        "site.links.0.from": "main",
        "site.bays.7": "main",
        "site.things.a.light.light.strip": "1",
        "site.things.a.light.light.from": 0,
        "site.things.a.light.light.to": 0.5,
        "site.things.a.light.press": True,
        "site.things.b.light": "x",
        "site.things.b.at": "object",
        "site.things.c.at.at.belt": "main",
        "site.things.c.at.at.from": 0,
        "site.things.c.at.at.to": 0.5,
    }


def test_what_docs_tell_of_a_nodes_parameters_is_a_map() -> None:
    text = (Path(__file__).parents[3] / "docs/reference/maps.md").read_text(encoding="utf-8")
    (block,) = (
        each for each in re.findall(r"```yaml\n(.*?)```", text, re.DOTALL) if "ros__parameters" in each
    )
    nested = parse_yaml(block.encode(), "docs/reference/maps.md")["/pui_node"]["ros__parameters"]
    tree = tree_of(dict(named(nested, "")))
    assert set(tree) == {"lamps", "strips", "belts", "links", "bays"}
    file = parse_map_file(json.dumps(tree).encode(), Path("docs.yaml"))
    assert not [each for each in check_map(file, {}) if each.severity == "error"]


def named(nested: Mapping[str, Any], start: str) -> Iterator[tuple[str, Any]]:
    """Yield parameters as ROS calls those of a file."""
    for name, value in nested.items():
        if isinstance(value, dict):
            yield from named(cast("dict[str, Any]", value), f"{start}{name}.")
        else:
            yield f"{start}{name}", value


NAME = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,20}", fullmatch=True)
NUMBER = st.floats(-1e6, 1e6)
POINT = st.lists(NUMBER, min_size=3, max_size=3)
LINE = st.lists(POINT, min_size=1, max_size=5)
OUTLINE = st.lists(st.lists(NUMBER, min_size=2, max_size=2), min_size=1, max_size=5)
KEY = st.from_regex(r"[a-z_]{1,12}", fullmatch=True).filter(lambda key: key not in LINES)
SCALAR = st.one_of(
    NUMBER, st.integers(-(2**63), 2**63 - 1), st.booleans(), st.text(max_size=9).filter(str.isprintable)
)
Fields = dict[str, st.SearchStrategy[Any]]
OUTLINED: Fields = {"outline": OUTLINE}
LINES_BESIDE: Fields = {"line": LINE, "centerline": LINE}
LINED: Fields = {"line": LINE}
ENTRY: st.SearchStrategy[dict[str, Any]] = st.one_of(
    st.fixed_dictionaries(OUTLINED, optional=LINES_BESIDE),
    st.fixed_dictionaries(LINED),
    st.dictionaries(KEY, st.one_of(SCALAR, POINT), min_size=1, max_size=4),
)
NAMED = [section for section in sorted(MapFile.model_fields) if section not in ("links", "bays")]
NOTHING: Fields = {}
TREE: st.SearchStrategy[dict[str, Any]] = st.fixed_dictionaries(
    NOTHING,
    optional={
        **{section: st.dictionaries(NAME, ENTRY, min_size=1, max_size=3) for section in NAMED},
        "links": st.lists(st.dictionaries(KEY, SCALAR, min_size=1, max_size=3), min_size=1, max_size=12),
        "bays": st.dictionaries(NAME, SCALAR, min_size=1, max_size=3),
    },
)


@given(TREE, st.sampled_from(["", "map", "site.leds.map"]))
def test_any_tree_is_parameters_and_itself_again(tree: dict[str, Any], prefix: str) -> None:
    parameters = parameters_of(tree, prefix)
    assert of_maps(parameters, prefix) == list(parameters)
    assert tree_of(travelled(parameters), prefix) == tree


PARAMETERS = st.dictionaries(
    st.one_of(
        st.text(max_size=30),
        st.lists(st.sampled_from(["leds", "strips", "links", "bays", "1", "line", "a", ""]), max_size=5).map(
            ".".join
        ),
    ),
    st.one_of(SCALAR, st.lists(NUMBER, max_size=7), st.lists(st.text(max_size=3), max_size=3)),
    max_size=6,
)


@given(PARAMETERS, st.sampled_from(["", "leds", "a"]))
def test_any_parameters_are_a_tree_or_refused(parameters: dict[str, Any], prefix: str) -> None:
    wanted = of_maps(parameters, prefix)
    try:
        tree = tree_of({name: parameters[name] for name in wanted}, prefix)
    except ValueError as refused:
        assert any(name in str(refused) for name in wanted)  # noqa: PT017 - either is right
    else:
        assert len(parameters_of(tree)) == len(wanted)


def test_sections_and_lines_are_those_of_the_map() -> None:
    assert {*MapFile.model_fields, "leds"} == SECTIONS
    fields = [field for entry in ENTRIES.values() for field in entry.model_fields.items()]
    lists = (tuple[Vec3, ...], tuple[Vec2, ...])
    assert {key for key, field in fields if field.annotation in lists} == set(LINES)


NO_PARAMETER = "is not a parameter of a map; they are called SECTION.NAME.KEY, as in leds.door.position"


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("leds.door", [1.0, 2.0, 3.0], NO_PARAMETER),
        ("leds..position", [1.0], NO_PARAMETER),
        (
            *("strips.1.line", [0.0, 1.0, 2.0, 3.0]),
            "has 4 numbers; write x, y, z of one point after the other, three for each",
        ),
        ("links.first.from:", "a", "links have numbers, as in links.0.from"),
        ("links.-1.from:", "a", "links have numbers, as in links.0.from"),
    ],
)
def test_what_is_none_of_a_map_is_one_sentence(name: str, value: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(f'{name} {sentence}')}$"):
        tree_of({name.removesuffix(":"): value})


def test_links_are_in_the_order_of_their_numbers() -> None:
    tree = tree_of({f"links.{number}.to": f"b{number}" for number in (2, 10, 1, 300)})
    assert tree == {"links": [{"to": "b1"}, {"to": "b2"}, {"to": "b10"}, {"to": "b300"}]}


def test_what_else_a_node_has_is_left_alone_unless_it_is_below_the_prefix() -> None:
    names = [
        *("use_sim_time", "leds", "ledsx.a.b", "leds.a.position", "site.leds.a.position", "site.colour"),
        "sites.x",
    ]
    assert of_maps(names) == ["leds.a.position"]
    assert of_maps(names, "site") == ["site.leds.a.position", "site.colour"]
