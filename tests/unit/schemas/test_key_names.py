"""Fields of messages that name a part of a key are checked as such."""

import types
import typing
from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from pointit.schemas import Cursor, SchemaModel, decode
from pointit.schemas.base import DecodeError, Id, KeyName, KeyNameOrEmpty
from pointit.schemas.codec import pack
from pointit.schemas.topics import TOPICS

NAMES_OF_KEYS = {"user", "ahead", "lamps", "carriers", "service", "instance", "robot", "taken_by"}
"""Fields of text that name people, lamps, carriers, services and robots."""
NO_NAMES = ("", "a/b", "*", "$*", "../a", "-a", "a b", "a" * 65, "é", "a\n")


def parts_of(kind: type[SchemaModel], seen: set[type[SchemaModel]]) -> Iterator[type[SchemaModel]]:
    """Yield `kind` and the models of its fields that are not in `seen`, which grows."""
    if kind in seen:
        return
    seen.add(kind)
    yield kind
    for field in kind.model_fields.values():
        for part in models_in(field.annotation):
            yield from parts_of(part, seen)


def models_in(annotation: Any) -> Iterator[type[SchemaModel]]:
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        if issubclass(annotation, SchemaModel):
            yield annotation
        return
    for argument in typing.get_args(annotation):
        yield from models_in(argument)


def key_fields() -> Iterator[Any]:
    seen: set[type[SchemaModel]] = set()
    for topic in TOPICS:
        for kind in parts_of(topic.message, seen):
            for name, field in kind.model_fields.items():
                is_text = not list(models_in(field.annotation))
                if name in NAMES_OF_KEYS and is_text:
                    yield pytest.param(kind, name, id=f"{kind.__name__}.{name}")


@pytest.mark.parametrize(("kind", "name"), list(key_fields()))
def test_names_of_keys_are_checked_in_every_message(kind: type[SchemaModel], name: str) -> None:
    field = kind.model_fields[name]
    is_list = "tuple" in str(field.annotation)
    annotation: Any = field.annotation
    adapter: TypeAdapter[Any] = TypeAdapter(typing.Annotated[annotation, *field.metadata])
    adapter.validate_python(("anna",) if is_list else "anna")
    for text in NO_NAMES[1:]:
        with pytest.raises(ValidationError):
            adapter.validate_python((text,) if is_list else text)


def test_key_names_of_all_topics_are_found() -> None:
    assert len(list(key_fields())) >= 20


@pytest.mark.parametrize("text", NO_NAMES)
def test_key_name_refuses_what_cannot_stand_in_a_key(text: str) -> None:
    TypeAdapter(Id).validate_python(text)
    with pytest.raises(ValidationError):
        TypeAdapter(KeyName).validate_python(text)
    if text:
        with pytest.raises(ValidationError):
            TypeAdapter(KeyNameOrEmpty).validate_python(text)


def test_key_name_is_plain_text_in_schemas_of_messages() -> None:
    """Published schemas never change, and the pattern is newer than some of them."""
    assert TypeAdapter(KeyName).json_schema() == {"type": "string"}
    assert TypeAdapter(KeyNameOrEmpty).json_schema() == {"type": "string"}


def test_cursor_at_a_lamp_without_a_name_is_no_message() -> None:
    payload = pack({"stamp_ns": 1, "lamps": [{"id": "", "miss_rad": 0.0}]})
    with pytest.raises(DecodeError, match=r"lamps\.0\.id"):
        decode(Cursor, payload)
