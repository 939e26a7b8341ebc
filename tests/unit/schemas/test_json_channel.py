"""JSON and its schemas, as the viewers' parsers require them."""

import base64
import json
from typing import Any

import pytest

from pointit.schemas import Cursor, Environment, Message, StripsFrame
from pointit.schemas.catalogue.catalogue import example
from pointit.schemas.catalogue.json_channel import JsonChannel
from pointit.schemas.environment import StripFrame
from pointit.schemas.topics import TOPICS, Topic

topics = pytest.mark.parametrize("topic", [pytest.param(topic, id=topic.key) for topic in TOPICS])


def as_a_viewer_reads_it(schema: dict[str, Any]) -> dict[str, Any]:
    """Fields and their types; fails where Foxglove's and Lichtblick's parsers do."""
    assert schema["type"] == "object"
    fields: dict[str, Any] = {}
    for name, field in schema["properties"].items():
        assert "oneOf" not in field
        kind = field["type"]
        if kind == "object":
            fields[name] = as_a_viewer_reads_it(field)
        elif kind == "array":
            items = field["items"]
            assert items["type"] in ("boolean", "string", "number", "integer", "object")
            assert "contentEncoding" not in items
            fields[name] = [as_a_viewer_reads_it(items) if items["type"] == "object" else items["type"]]
        else:
            assert kind in ("boolean", "string", "number", "integer")
            assert field.get("contentEncoding", "base64") == "base64"
            fields[name] = kind
    return fields


@topics
def test_viewers_read_every_schema_and_find_its_fields(topic: Topic[Message]) -> None:
    plain = JsonChannel(topic.message)
    fields = as_a_viewer_reads_it(json.loads(json.dumps(plain.schema)))
    assert {"stamp_ns", "seq"} <= set(fields)
    assert plain.schema["title"] == topic.message.schema_name()
    told = json.loads(plain.to_json(example(topic.message)))
    assert_described(told, fields)
    assert set(told) == set(topic.message.model_fields)


def assert_described(told: Any, fields: Any) -> None:
    for name, kind in fields.items():
        inner: Any = kind[0] if isinstance(kind, list) else kind
        if not isinstance(inner, dict) or told[name] is None:
            assert name in told
            continue
        values: list[Any] = told[name] if isinstance(kind, list) else [told[name]]
        for value in values:
            assert_described(value, inner)


def test_arrays_in_arrays_are_in_the_message_only() -> None:
    strips = as_a_viewer_reads_it(JsonChannel(Environment).schema)["strips"][0]
    assert "pixels" in strips
    assert "line_m" not in strips


def test_numbers_and_empty_fields_travel_as_they_are() -> None:
    text = JsonChannel(Cursor).to_json(
        Cursor(stamp_ns=1_700_000_000_000_000_001, miss_rad=0.125, point_m=(1, 2, 3))
    )
    told = json.loads(text)
    assert told["stamp_ns"] == 1_700_000_000_000_000_001
    assert (told["miss_rad"], told["point_m"], told["origin_m"]) == (0.125, [1, 2, 3], None)


def test_bytes_travel_as_base64() -> None:
    rgb = bytes((0, 255, 254, 62, 63, 128))
    told = json.loads(
        JsonChannel(StripsFrame).to_json(StripsFrame(stamp_ns=1, strips=(StripFrame(id="s", rgb=rgb),)))
    )
    assert base64.b64decode(told["strips"][0]["rgb"], validate=True) == rgb
    schema = JsonChannel(StripsFrame).schema["properties"]["strips"]["items"]["properties"]["rgb"]
    assert schema["contentEncoding"] == "base64"
