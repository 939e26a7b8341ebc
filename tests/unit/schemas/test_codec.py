"""Messages to bytes and back, and everything that is not a message; ids have a length."""

import contextlib
import math
import time
from collections.abc import Iterator
from typing import Any, cast

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pointit.schemas as models
from pointit.schemas import Cursor, DecodeError, ImuSample, Message, Query, TrackedObjects, decode, encode
from pointit.schemas.base import MAX_ID
from pointit.schemas.catalogue.asyncapi import Kind
from pointit.schemas.catalogue.catalogue import all_kinds, example
from tests.unit.schemas.strategies import messages

KINDS = [pytest.param(kind, id=kind.__name__) for kind in all_kinds()]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def packed(**fields: Any) -> bytes:
    return msgpack.packb({"stamp_ns": 1, "orientation_xyzw": UPRIGHT, **fields})


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_every_message_survives_the_wire(kind: type[Message | Query], data: st.DataObject) -> None:
    message = data.draw(messages(kind))
    payload = encode(message)
    back = decode(kind, payload)
    assert (back, encode(back)) == (message, payload)
    assert tuple(msgpack.unpackb(payload)) == tuple(kind.model_fields)


@settings(max_examples=200)
@given(kind=st.sampled_from(all_kinds()), payload=st.binary(max_size=200), schema=st.text(max_size=20))
def test_random_bytes_raise_nothing_but_decode_errors(kind: Kind, payload: bytes, schema: str) -> None:
    with contextlib.suppress(DecodeError):
        decode(kind, payload, schema)


json_like = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)


@settings(max_examples=200)
@given(
    values=st.dictionaries(
        st.sampled_from(["stamp_ns", "seq", "objects", "surprise"]), json_like, max_size=4
    ),
    schema=st.sampled_from(["", "TrackedObjects.v1", "TrackedObjects.v2"]),
)
def test_well_formed_nonsense_raises_nothing_but_decode_errors(values: dict[str, Any], schema: str) -> None:
    with contextlib.suppress(DecodeError):
        decode(TrackedObjects, msgpack.packb(values), schema)


@settings(max_examples=200)
@given(data=st.data())
def test_a_damaged_message_raises_nothing_but_decode_errors(data: st.DataObject) -> None:
    payload = bytearray(encode(data.draw(messages(TrackedObjects))))
    place = data.draw(st.integers(0, len(payload) - 1))
    payload[place] ^= data.draw(st.integers(1, 255))
    cut = data.draw(st.integers(0, len(payload)))
    for damaged in (bytes(payload), bytes(payload[:cut])):
        with contextlib.suppress(DecodeError):
            decode(TrackedObjects, damaged)


@pytest.mark.parametrize(
    "payload",
    [
        pytest.param(b"", id="nothing"),
        pytest.param(b"\xc1", id="never used byte"),
        pytest.param(b"\x91" * 1_000_000, id="arrays in arrays"),
        pytest.param(b"\xdd\xff\xff\xff\xff", id="array of 4 G"),
        pytest.param(b"\xc9\xff\xff\xff\xff\x01", id="extension of 4 G"),
        pytest.param(b"\xdd\x00\x0f\x00\x00" + b"\xc0" * 0xF0000, id="a million nils"),
        pytest.param(b"\xd7\xff" + b"\xff" * 8, id="time stamp out of range"),
        pytest.param(b"\x81\xc0\x01", id="nil as a field's name"),
        pytest.param(b"\x81\xa1\xff\x01", id="name that is not UTF-8"),
        pytest.param(b"\x80\x80", id="two of them"),
    ],
)
def test_bombs_and_rubbish_are_decode_errors(payload: bytes) -> None:
    with pytest.raises(DecodeError, match=r"^Environment: (?!has \d+ bytes).{5,200}$"):
        decode(models.Environment, payload)


def test_a_payload_that_is_too_long_is_refused_unread() -> None:
    padding = ImuSample.max_bytes - len(packed(skin=b""))
    with pytest.raises(DecodeError, match=r"^ImuSample: skin: is no field of it"):
        decode(ImuSample, packed(skin=b"x" * (padding - 1)))  # one more to say how long it is
    with pytest.raises(DecodeError, match=r"^ImuSample: has 16385 bytes, at most 16384 are taken$"):
        decode(ImuSample, packed(skin=b"x" * padding))


@pytest.mark.parametrize(
    "payload",
    [
        pytest.param({"objects": [()] * 500_000}, id="a complaint for each byte"),
        pytest.param({f"field{number}": None for number in range(40_000)}, id="a complaint for each field"),
    ],
)
def test_flood_of_mistakes_in_a_message_is_refused_quickly(payload: dict[str, Any]) -> None:
    bytes_ = msgpack.packb(payload)
    assert len(bytes_) <= TrackedObjects.max_bytes
    began_s = time.process_time()
    with pytest.raises(DecodeError):
        decode(TrackedObjects, bytes_)
    assert time.process_time() - began_s < 0.1  # 10 ms; all complaints took 1.6 s


PACKAGE = models.TrackedObject(
    id="19a9f0c2b31-1999", kind="yellow", position_m=(1.5, 2.5, 3.5), velocity_mps=(0.1, 0.2, 0.3),
    surface="strip", surface_id="strip_10",
)  # fmt: skip
LONG = models.Strip(id="strip_9999", line_m=((0.5, 9999, 1.5), (9.5, 9999, 1.5)), pixels=150)
LARGEST = {
    "a full expander": models.StripsFrame(
        stamp_ns=1, strips=tuple(models.StripFrame(id=f"strip_{n}", rgb=bytes(3 * 4096)) for n in range(64))
    ),
    "2000 objects": TrackedObjects(stamp_ns=2**62, objects=(PACKAGE,) * 2000),
    "10 000 strips": models.Environment(stamp_ns=1, name="hall", strips=(LONG,) * 10_000),
}


@pytest.mark.parametrize("message", LARGEST.values(), ids=LARGEST)
def test_the_largest_that_is_meant_to_travel_does(message: Message) -> None:
    assert decode(type(message), encode(message)) == message


def test_an_error_is_one_short_line() -> None:
    objects = [{"id": str(number)} for number in range(20_000)]
    with pytest.raises(DecodeError) as caught:
        decode(TrackedObjects, msgpack.packb({"stamp_ns": 1, "objects": objects}))
    assert str(caught.value).startswith(
        "TrackedObjects: objects.0.kind: is missing; give it a value (got {'id': '0'}), and"
    )
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"orientation_xyzw": (0.0, 0.0, 0.0, math.nan)}, r"orientation_xyzw\.3.*finite.*nan"),
        ({"acceleration_mps2": (0.0, -math.inf, 0.0)}, r"acceleration_mps2\.1.*finite.*-inf"),
        ({"stamp_ns": 1.5}, r"stamp_ns: write a whole number.*1\.5"),
        ({"stamp_ns": -1}, r"stamp_ns: must be at least 0.*-1"),
        ({"orientation_xyzw": (0.0, 0.0, 1.0)}, r"orientation_xyzw\.3: is missing"),
        ({"orientation_xyzw": (0.0, 0.0, 0.0, 1.06)}, r"orientation_xyzw: a quaternion of norm 1\.06, not 1"),
        ({"battery": 1.01}, r"battery: must be at most 1.*1\.01"),
        ({"orientation_wxyz": UPRIGHT}, r"orientation_wxyz: is no field of it"),
    ],
)
def test_wrong_fields_are_refused_by_name(fields: dict[str, Any], complaint: str) -> None:
    with pytest.raises(DecodeError, match=f"^ImuSample: {complaint}"):
        decode(ImuSample, packed(**fields))


def test_whole_numbers_stand_for_floats() -> None:
    sample = decode(ImuSample, packed(orientation_xyzw=(0, 0, 0, 1)))
    assert sample.orientation_xyzw == UPRIGHT
    assert all(type(value) is float for value in sample.orientation_xyzw)


@pytest.mark.parametrize(
    ("norm", "taken"), [(1.0009, True), (0.9991, True), (1.0011, False), (0.9989, False)]
)
def test_directions_have_norm_one_as_far_as_float32_has(norm: float, taken: bool) -> None:
    fields: dict[str, Any] = {"stamp_ns": 1, "origin_m": (0.0, 0.0, 0.0), "direction": (0.0, norm, 0.0)}
    if taken:
        assert decode(models.PointingRay, msgpack.packb(fields)).direction == (0.0, norm, 0.0)
    else:
        with pytest.raises(DecodeError, match=r"direction: must have norm 1"):
            decode(models.PointingRay, msgpack.packb(fields))


@pytest.mark.parametrize("schema", ["ImuSample.v98", "ImuSample.v1700"])
def test_fields_of_a_newer_sender_are_ignored(schema: str) -> None:
    assert decode(ImuSample, packed(skin_temperature_k=307.0), schema) == decode(ImuSample, packed())


@pytest.mark.parametrize(
    "schema",
    [
        "", "ImuSample", "ImuSample.v1", ImuSample.schema_name(), "ImuSample.v0", "ImuSample.v-2",
        "ImuSample.v²", "UserPose.v98", ".v98", pytest.param("ImuSample.v" + "9" * 5000, id="v999..."),
    ],
)  # fmt: skip
def test_unknown_fields_of_other_senders_are_refused(schema: str) -> None:
    with pytest.raises(DecodeError, match=r"skin_temperature_k: is no field of it"):
        decode(ImuSample, packed(skin_temperature_k=307.0), schema)


def test_nested_fields_of_a_newer_sender_are_ignored() -> None:
    payload = msgpack.packb({"stamp_ns": 1, "body": {"shoulder_to_wrist_m": 0.6, "ring_size_m": 0.02}})
    assert decode(models.UserProfile, payload, "UserProfile.v99").body.shoulder_to_wrist_m == 0.6
    with pytest.raises(DecodeError, match=r"body\.ring_size_m"):
        decode(models.UserProfile, payload, "UserProfile.v1")


def test_a_newer_sender_may_still_be_wrong() -> None:
    with pytest.raises(DecodeError, match=r"battery"):
        decode(ImuSample, packed(battery=2.0, skin_temperature_k=307.0), "ImuSample.v98")


@pytest.mark.parametrize(
    ("kind", "fields", "where"),
    [
        (Cursor, {"stamp_ns": 2**63}, "stamp_ns"),
        (Cursor, {"stamp_ns": 1, "point_m": (0.0, -1.1e6, 0.0)}, "point_m"),
        (Cursor, {"stamp_ns": 1, "range_m": 1e308}, "range_m"),
        (ImuSample, {"stamp_ns": 1, "orientation_xyzw": (1e308, 0.0, 0.0, 1.0)}, "orientation_xyzw"),
        (models.UserPose, {"stamp_ns": 1, "position_m": (1e7, 0.0, 0.0), "yaw_rad": 0.0}, "position_m"),
        (models.ClockTick, {"stamp_ns": 1, "sim_ns": 2**63 - 1}, "sim_ns"),
        (models.ConveyorState, {"stamp_ns": 1, "speed_mps": 1e7}, "speed_mps"),
        (models.TrackedObject, {"id": "a", "kind": "b", "position_m": (0.0, 0.0, 1e7)}, "position_m"),
        (models.Lamp, {"id": "a/b", "position_m": (0.0, 0.0, 0.0)}, "id"),
        (models.Strip, {"id": "a", "line_m": ((0.0, 0.0, 0.0), (1e7, 0.0, 0.0)), "pixels": 5}, "line_m"),
        (models.Belt, {"id": "a", "line_m": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), "width_m": 1e7}, "width_m"),
    ],
)
def test_numbers_that_nothing_can_be_calculated_with_do_not_travel(
    kind: type[models.SchemaModel], fields: dict[str, object], where: str
) -> None:
    with pytest.raises(DecodeError, match=where):
        decode(kind, msgpack.packb(fields))


SENTENCES = {"advice", "next_step", "message", "problem", "reason", "refusal", "sentence", "text", "warnings"}
"""Texts for people, that are no ids."""
DOCUMENTS = {"command", "home_assistant", "map", "parameters", "path", "query", "reply", "url"}
"""JSON, commands to show, addresses, and paths of files: only who runs the site writes them."""


def texts(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of each text in a message."""
    if isinstance(value, str):
        yield path
    elif isinstance(value, dict):
        for name, each in cast("dict[str, Any]", value).items():
            yield from texts(each, (*path, name))
    elif isinstance(value, list):
        for place, each in enumerate(cast("list[object]", value)):
            yield from texts(each, (*path, place))


@pytest.mark.parametrize("kind", all_kinds(), ids=lambda kind: kind.__name__)
def test_every_text_that_is_no_sentence_is_bounded(kind: Kind) -> None:
    for path in texts(msgpack.unpackb(encode(example(kind)))):
        (field,) = [name for name in path if isinstance(name, str)][-1:]
        if field in SENTENCES | DOCUMENTS:
            continue
        message = msgpack.unpackb(encode(example(kind)))
        part = message
        for step in path[:-1]:
            part = part[step]
        part[path[-1]] = "x" * (MAX_ID + 1)
        with pytest.raises(DecodeError, match=rf"{kind.__name__}: {path[0]}.*\(got 'xxx"):
            decode(kind, msgpack.packb(message))
