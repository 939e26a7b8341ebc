"""Parameters of a ROS node: asked of it page by page, maps among them, failures; values there and back."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import Backend
from pointit.bridges.ros2.map_parameters import LINES, SECTIONS, of_maps, tree_of
from pointit.bridges.ros2.node_parameters import FIELDS, GET, LIST, MESSAGE, PAGE, NodeParameters, value_of
from pointit.bridges.ros2.types.types import Types
from pointit.geometry.floor_area import Vec2
from pointit.geometry.vector import Vec3
from pointit.maps.checks.check import check_map
from pointit.maps.file import parse_map_file
from pointit.maps.model import ENTRIES, MapFile
from pointit.runtime.config.yaml_file import parse_yaml
from pointit.runtime.errors import NoAnswerError
from tests.support.parameter_server import NODE, OneNode, ParameterServer, message_of, parameters_of

TYPES = Types("jazzy")


def travelled(parameters: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters as received by another node, by the bytes of ROS."""
    kind = "rcl_interfaces/srv/GetParameters_Response"
    values = [message_of(TYPES, value) for value in parameters.values()]
    answer = TYPES.decode(kind, TYPES.encode(kind, TYPES.make(kind, values=values)))
    return {name: value_of(each) for name, each in zip(parameters, answer.values, strict=True)}


def test_tree_of_parameters_matches_the_file_of_a_map() -> None:
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


def test_documented_node_parameters_are_a_map() -> None:
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
def test_foreign_parameter_is_refused_in_one_sentence(name: str, value: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(f'{name} {sentence}')}$"):
        tree_of({name.removesuffix(":"): value})


def test_links_are_in_the_order_of_their_numbers() -> None:
    tree = tree_of({f"links.{number}.to": f"b{number}" for number in (2, 10, 1, 300)})
    assert tree == {"links": [{"to": "b1"}, {"to": "b2"}, {"to": "b10"}, {"to": "b300"}]}


def test_other_parameters_are_ignored_unless_below_the_prefix() -> None:
    names = [
        *("use_sim_time", "leds", "ledsx.a.b", "leds.a.position", "site.leds.a.position", "site.colour"),
        "sites.x",
    ]
    assert of_maps(names) == ["leds.a.position"]
    assert of_maps(names, "site") == ["site.leds.a.position", "site.colour"]


def read(other: OneNode, **settings: Any) -> NodeParameters:
    values: dict[str, Any] = {"domain": 0, "appears_s": 0.1, "timeout_s": 0.1}
    return NodeParameters(cast("Backend", other), TYPES, NODE, **values | settings)


def other(parameters: dict[str, Any] | None = None, **settings: Any) -> OneNode:
    return OneNode(ParameterServer(TYPES, parameters or {}), **settings)


async def test_parameters_come_by_pages_in_the_nodes_order() -> None:
    there = {f"leds.{number}.position": [number * 1.0, 0.0, 1.0] for number in range(2 * PAGE + 3)}
    seen = other({"map": "text", "empty": None, **there})
    node = read(seen)
    assert await node.names() == ["map", "empty", *there]
    assert seen.watching == 0
    assert await node.values([*there, "empty"]) == there
    assert list(await node.values(["map", "leds.0.position"])) == ["map", "leds.0.position"]
    assert [len(names) for names in seen.server.asked] == [PAGE, PAGE, 4, 2]
    assert await node.values([]) == {}
    names = {"a\x1b[2J": 1, "leds.a.position": 1}
    assert await read(other(names)).names() == ["leds.a.position"], "no map has the other"


async def refused(sentence: str, asked: OneNode, **settings: Any) -> None:
    with pytest.raises(NoAnswerError) as caught:
        await read(asked, **settings).names()
    assert str(caught.value) == sentence
    assert asked.watching == 0


async def test_absent_node_is_reported_with_those_present() -> None:
    absent, nodes = (
        "there is no node /pui in domain 0; there are",
        frozenset({"/pointit_map", "/belt", "/arm"}),
    )
    await refused(f"{absent} /arm, /belt", other(name="/belt", serves=False, nodes=nodes))
    many = frozenset(f"/n{number:02}" for number in range(25))
    sentence = f"{absent} {', '.join(sorted(many)[:20])} and 5 more"
    await refused(sentence, other(name="/n00", serves=False, nodes=many))
    behind = other(name="/belt", nodes=frozenset({"behind bridge 1f"}))
    await refused(f"{absent} /belt", behind)


async def test_unreachable_parameter_services_are_reported_with_the_cause() -> None:
    await refused(
        "node /pui serves no parameters; start it with its parameter services, or give its map as a file",
        other(serves=False),
    )
    us = frozenset({"/pointit_map"})
    lonely: dict[str, Any] = {"name": "/pointit_map", "nodes": us}
    await refused("no ROS node is seen in domain 0: they need this", other(**lonely), needs="they need this")
    await refused(
        "no ROS node is seen in domain 0: no router", other(problem="no router", **lonely), needs="-"
    )
    await refused(
        "node /pui is of Humble, whose services no node of jazzy can ask; set distro to humble",
        other(hash="TypeHashNotSupported"),
    )

    await refused(
        f"node /pui has another definition of {LIST} than jazzy; set distro to theirs",
        other(hash="RIHS01_" + "0" * 64),
    )
    assert await read(other({"a": 1}, hash="")).names() == ["a"], "rclpy does not tell it"


@pytest.mark.parametrize(
    "answer", [b"", b"garbage", b"\0\1\0\0", b"\0\1\0\0\xff\xff\xff\xff", b"\0\7" + bytes(90)]
)
async def test_unreadable_answer_is_reported_in_one_sentence(answer: bytes) -> None:
    async def bad(_request: bytes) -> bytes:
        return answer

    asked = other({"a": 1}, answers={LIST: bad, GET: bad})
    with pytest.raises(NoAnswerError, match=r"^what node /pui answered cannot be read: "):
        await read(asked).names()
    with pytest.raises(NoAnswerError, match=r"^what node /pui answered cannot be read: "):
        await read(asked).values(["a"])


async def test_mismatched_and_late_answers_are_errors() -> None:
    async def few(_request: bytes) -> bytes:
        return await asked.server.get(
            TYPES.encode(f"{GET}_Request", TYPES.make(f"{GET}_Request", names=["a"]))
        )

    async def strange(_request: bytes) -> bytes:
        value = TYPES.make("rcl_interfaces/msg/ParameterValue", type=77)
        return TYPES.encode(f"{GET}_Response", TYPES.make(f"{GET}_Response", values=[value]))

    async def late(_request: bytes) -> bytes:
        raise TimeoutError("ROS service /pui/get_parameters: its server did not answer within 0.1 s")

    asked = other({"a": 1, "b": 2})
    asked.answers[GET] = few
    with pytest.raises(NoAnswerError, match="was asked for 2 parameters and told 1; try again"):
        await read(asked).values(["a", "b"])
    asked.answers[GET] = strange
    with pytest.raises(NoAnswerError, match=r"^a of node /pui: a parameter is of kind 77"):
        await read(asked).values(["a"])
    asked.answers[GET] = late
    with pytest.raises(
        NoAnswerError, match=r"^ROS service /pui/get_parameters: its server did not answer within"
    ):
        await read(asked).values(["a"])


WHOLE = st.integers(-(2**63), 2**63 - 1)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(max_size=9).filter(lambda text: "\0" not in text)
VALUE = st.one_of(
    st.booleans(),
    WHOLE,
    FINITE,
    TEXT,
    *(st.lists(each, min_size=1) for each in (st.booleans(), WHOLE, FINITE, TEXT)),
)


@given(VALUE)
def test_values_survive_a_round_trip(value: Any) -> None:
    again = value_of(TYPES.decode(MESSAGE, TYPES.encode(MESSAGE, message_of(TYPES, value))))
    assert again == value
    assert repr(again) == repr(value), "true is no 1"


def test_unset_parameter_has_no_value_and_kinds_match_ros() -> None:
    assert value_of(message_of(TYPES, None)) is None
    assert value_of(message_of(TYPES, [])) == []
    assert value_of(TYPES.make(MESSAGE, type=5, byte_array_value=b"\1\2")) == [1, 2]
    kinds = TYPES.make("rcl_interfaces/msg/ParameterType")
    for number, field in FIELDS.items():
        assert getattr(kinds, f"PARAMETER_{field.removesuffix('_value').upper()}") == number
    with pytest.raises(ValueError, match="a parameter is of kind 77, and there are 0 to 9"):
        value_of(TYPES.make(MESSAGE, type=77))
