"""Messages about an invalid file or parameter, for the person who wrote it."""

import difflib
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from pointit.runtime.config.nearest_name import nearest
from pointit.schemas.text import SECRET_NAME, describe_mistake

MAX_SHOWN = 60
"""Characters of a value that are worth showing."""

DESCRIBED = "described"
"""Error type of pydantic whose message is already written for people."""


def describe_validation_error(error: ValidationError, kind: type[BaseModel]) -> str:
    """Return a message on the first mistake of `error` in a `kind`: field, action, value, more errors."""
    loc, text = first_mistake(error, kind)
    field = ".".join(str(part) for part in loc)
    return f"{field}: {text}" if field else text


def first_mistake(error: ValidationError, kind: type[BaseModel]) -> tuple[tuple[int | str, ...], str]:
    """Return place and message of the first mistake of `error` in a `kind`; the message counts the others."""
    details = error.errors(include_url=False)
    first = details[0]
    loc = first["loc"]
    if first["type"] == "extra_forbidden":
        *parents, name = loc
        loc = tuple(parents)
        model = _model_at(kind, loc)
        known_fields = () if model is None else field_names(model)
        text = unknown_parameter_message(str(name), known_fields)
    elif first["type"] == "missing":
        text = _missing(first)
    elif first["type"] == "union_tag_invalid":
        context = first.get("ctx", {})
        loc = (*loc, context["discriminator"].strip("'"))
        known_tags = context["expected_tags"].replace("'", "").split(", ")
        tag = context["tag"]
        text = f"no {loc[-1]} {tag!r}; {nearest(tag, known_tags)}"
    elif first["type"] == DESCRIBED:
        text = first["msg"]
    else:
        text = _remedy(first, kind)
        is_secret = any(SECRET_NAME.search(str(part)) for part in loc)
        if not is_secret:
            text += f" (got {format_value(first['input'])})"
    return loc, text + more_errors_suffix(len(details) - 1)


def unknown_parameter_message(name: str, known: Sequence[str]) -> str:
    """Return the message that there is no parameter `name`, with the nearest of those `known`."""
    similar = difflib.get_close_matches(name, known, n=1)
    if similar:
        return f"no parameter {name}; did you mean {similar[0]}?"
    if known:
        return f"no parameter {name}; there are {join_names(known)}"
    return f"no parameter {name}"


def field_names(model: type[BaseModel]) -> list[str]:
    """Return the parameters of `model` as people write them, and its plug-ins that have some."""
    names = [field.alias or name for name, field in model.model_fields.items()]
    sections: Callable[[], Mapping[str, object]] = getattr(model, "sections", dict)
    return [*names, *sections()]


def more_errors_suffix(count: int) -> str:
    """Return the end of a message that describes one mistake, if there are `count` more."""
    if count < 1:
        return ""
    return f" (and {count} more mistake{'s' if count > 1 else ''})"


def join_names(names: Iterable[object]) -> str:
    """Return `names` as a sentence lists them."""
    return ", ".join(str(name) for name in names)


def format_value(value: object) -> str:
    """Return `value` as a sentence can show it."""
    text = repr(value)
    if len(text) <= MAX_SHOWN:
        return text
    return text[: MAX_SHOWN - 3] + "..."


def _missing(detail: ErrorDetails) -> str:
    if isinstance(detail["loc"][-1], int):
        return f"is missing in {format_value(detail['input'])}; write as many values as are wanted"
    return "is missing; give it a value"


def _remedy(detail: ErrorDetails, kind: type[BaseModel]) -> str:
    mistake = detail["type"]
    if mistake in ("model_type", "model_attributes_type", "dataclass_type"):
        model = _model_at(kind, detail["loc"])
        return f"write a mapping with {join_names(field_names(model))}" if model else "write a mapping"
    return describe_mistake(detail)


def _model_at(kind: type[BaseModel], loc: Sequence[int | str]) -> type[BaseModel] | None:
    annotation: Any = kind
    for part in loc:
        annotation = _inner(annotation, part)
    annotation = _plain(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return None


def _inner(annotation: Any, part: int | str) -> Any:
    plain_type = _plain(annotation)
    if isinstance(plain_type, type) and issubclass(plain_type, BaseModel):
        for name, field in plain_type.model_fields.items():
            if part in (name, field.alias):
                return field.annotation
    origin = typing.get_origin(plain_type)
    arguments = typing.get_args(plain_type)
    if origin is dict:
        return arguments[1]
    if origin in (tuple, list) and isinstance(part, int):
        has_one_type = arguments[-1] is Ellipsis or origin is list
        return arguments[0] if has_one_type else arguments[part]
    return None


def _plain(annotation: Any) -> Any:
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        return _plain(typing.get_args(annotation)[0])
    if origin in (typing.Union, types.UnionType):
        kinds = [kind for kind in typing.get_args(annotation) if kind is not type(None)]
        return _plain(kinds[0]) if len(kinds) == 1 else None
    return annotation
