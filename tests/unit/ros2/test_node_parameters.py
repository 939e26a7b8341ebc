"""Reading the parameters of another node: pages, failures; their values, there and back."""

from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import Backend
from pointit.bridges.ros2.parameters import FIELDS, GET, LIST, MESSAGE, PAGE, NodeParameters, value_of
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.errors import NoAnswerError
from tests.support.parameter_server import NODE, OneNode, ParameterServer, message_of

TYPES = Types("jazzy")


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


async def test_who_is_not_there_is_told_with_those_who_are() -> None:
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


async def test_what_else_keeps_a_node_from_being_asked() -> None:
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
async def test_an_answer_that_is_none_is_one_sentence(answer: bytes) -> None:
    async def bad(_request: bytes) -> bytes:
        return answer

    asked = other({"a": 1}, answers={LIST: bad, GET: bad})
    with pytest.raises(NoAnswerError, match=r"^what node /pui answered cannot be read: "):
        await read(asked).names()
    with pytest.raises(NoAnswerError, match=r"^what node /pui answered cannot be read: "):
        await read(asked).values(["a"])


async def test_answers_to_something_else_and_none_in_time() -> None:
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
NUMBER = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(max_size=9).filter(lambda text: "\0" not in text)
VALUE = st.one_of(
    st.booleans(),
    WHOLE,
    NUMBER,
    TEXT,
    *(st.lists(each, min_size=1) for each in (st.booleans(), WHOLE, NUMBER, TEXT)),
)


@given(VALUE)
def test_values_survive_a_round_trip(value: Any) -> None:
    again = value_of(TYPES.decode(MESSAGE, TYPES.encode(MESSAGE, message_of(TYPES, value))))
    assert again == value
    assert repr(again) == repr(value), "true is no 1"


def test_what_has_no_value_has_none_and_the_kinds_are_those_of_ros() -> None:
    assert value_of(message_of(TYPES, None)) is None
    assert value_of(message_of(TYPES, [])) == []
    assert value_of(TYPES.make(MESSAGE, type=5, byte_array_value=b"\1\2")) == [1, 2]
    kinds = TYPES.make("rcl_interfaces/msg/ParameterType")
    for number, field in FIELDS.items():
        assert getattr(kinds, f"PARAMETER_{field.removesuffix('_value').upper()}") == number
    with pytest.raises(ValueError, match="a parameter is of kind 77, and there are 0 to 9"):
        value_of(TYPES.make(MESSAGE, type=77))
