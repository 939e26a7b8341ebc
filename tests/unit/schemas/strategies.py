"""Hypothesis strategies for messages, built from their annotations and not from their JSON Schemas."""

import types
import typing
from collections.abc import Callable
from typing import Any, TypeVar

from hypothesis import strategies as st
from pydantic.functional_validators import AfterValidator

from pointit.schemas import SchemaModel

P = TypeVar("P", bound=SchemaModel)


def messages(kind: type[P]) -> st.SearchStrategy[P]:
    """Any valid message of `kind`, optional fields sometimes left to their defaults."""
    required: dict[str, st.SearchStrategy[Any]] = {}
    optional: dict[str, st.SearchStrategy[Any]] = {}
    for name, field in kind.model_fields.items():
        target = required if field.is_required() else optional
        target[name] = _values(field.annotation, field.metadata)
    return st.fixed_dictionaries(required, optional=optional).map(kind.model_validate)


def _values(annotation: Any, metadata: list[Any]) -> st.SearchStrategy[Any]:
    origin = typing.get_origin(annotation)
    args = typing.get_args(annotation)
    if origin is typing.Annotated:
        return _values(args[0], [*args[1:], *metadata])
    if origin is typing.Literal:
        return st.sampled_from(args)
    if origin in (typing.Union, types.UnionType):
        return st.one_of([_values(each, metadata) for each in args])
    if origin is tuple:
        if any(isinstance(each, AfterValidator) for each in metadata):
            return st.sampled_from(_axes(len(args)))
        if args[-1] is Ellipsis:
            low = next((each.min_length for each in metadata if hasattr(each, "min_length")), 0)
            return st.lists(_values(args[0], []), min_size=low, max_size=low + 2).map(tuple)
        return st.tuples(*(_values(each, []) for each in args))
    if isinstance(annotation, type) and issubclass(annotation, SchemaModel):
        return messages(annotation)
    return _plain(annotation, _flat(metadata))


def _flat(metadata: list[Any]) -> list[Any]:
    """Write pydantic's `Field(...)` inside `Annotated` out into its constraints."""
    flat: list[Any] = []
    for each in metadata:
        inner: list[Any] = getattr(each, "metadata", [each])
        flat += inner
    return flat


def _plain(annotation: Any, metadata: list[Any]) -> st.SearchStrategy[Any]:
    limits: dict[str, Any] = {
        name: value
        for each in metadata
        for name in ("ge", "gt", "le", "lt", "min_length", "max_length", "pattern")
        if (value := getattr(each, name, None)) is not None
    }
    low = limits.get("gt", limits.get("ge"))
    high = limits.get("lt", limits.get("le"))
    if "pattern" in limits:
        return st.from_regex(str(limits["pattern"]), fullmatch=True)
    plain: dict[Any, Callable[[], st.SearchStrategy[Any]]] = {
        types.NoneType: st.none,
        bool: st.booleans,
        int: lambda: st.integers(
            -(2**63) if low is None else low + ("gt" in limits),
            2**64 - 1 if high is None else high - ("lt" in limits),
        ),
        float: lambda: st.floats(
            low,
            high,
            exclude_min="gt" in limits,
            exclude_max="lt" in limits,
            allow_nan=False,
            allow_infinity=False,
        ),
        bytes: lambda: st.binary(max_size=64),
        str: lambda: st.text(min_size=limits.get("min_length", 0), max_size=limits.get("max_length", 20)),
    }
    if annotation not in plain:
        raise TypeError(f"no strategy for {annotation}: add it here")
    return plain[annotation]()


def _axes(size: int) -> list[tuple[float, ...]]:
    """Unit vectors of `size`: the axes, their opposites, a diagonal."""
    diagonal = (size**-0.5,) * size
    return [
        diagonal,
        *(
            tuple(sign if place == axis else 0.0 for place in range(size))
            for axis in range(size)
            for sign in (1.0, -1.0)
        ),
    ]
