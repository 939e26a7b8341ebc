"""Messages at the limits of their types, made from the annotations of their fields in each run.

Each field takes each of its extremes once, while the others have plain values; then all take theirs at once.
"""

import itertools
import math
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic.functional_validators import AfterValidator

from pointit.schemas import SchemaModel
from pointit.schemas.codec import encode
from pointit.schemas.table_types import NAME

P = TypeVar("P", bound=SchemaModel)

TEXTS = (
    "", "/", "*", "**", "$*", "a/../b", "..", "-", "\x00", "\n", "\r\n\x1b[2J", "{user}", "%s%n{0}",
    "'\"<b>&", "__proto__", "nan", "9" * 64, "\u202e\u2066", "\U0001f4a5" * 64,
)  # fmt: skip
"""Texts that are no name, or mean something where they are shown or used as a key, path or pattern."""
LONG = 256
"""Characters of the longest text of a field without a limit, and of an id."""
MANY = 40
"""Number of items of a long list. A longer one does not differ, and takes longer to make."""
TINY = 5e-324
"""Smallest positive double."""


def extreme_messages(kind: type[P], plain: Mapping[str, Any], texts: Sequence[str] = ()) -> Iterator[P]:
    """Yield valid messages of `kind` that fit into its `max_bytes`.

    Args:
        kind: the message or query.
        plain: values of fields that have no default, or that keep a message from being dropped as late.
        texts: further values of texts, such as names that exist on the site.
    """
    values = _Values((*TEXTS, *texts))
    fields: dict[str, list[Any]] = {}
    plain_fields: dict[str, Any] = {}
    for name, field in kind.model_fields.items():
        fields[name] = values.of(field.annotation, field.metadata)
        if field.is_required():
            plain_fields[name] = fields[name][0]
    plain_fields.update(plain)
    for changed in itertools.chain(_singles(fields), _rows(fields, plain)):
        message = _valid(kind, {**plain_fields, **changed})
        if message is not None:
            yield message


def _singles(fields: Mapping[str, Sequence[Any]]) -> Iterator[dict[str, Any]]:
    """Yield each extreme of each field alone."""
    for name, extremes in fields.items():
        for value in extremes:
            yield {name: value}


def _rows(fields: Mapping[str, Sequence[Any]], plain: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield extremes of all fields at once, each at least once, but for `plain` ones."""
    longest = max(map(len, fields.values()), default=0)
    for row in range(longest):
        values = {name: extremes[row % len(extremes)] for name, extremes in fields.items()}
        yield {**values, **plain}


def _valid(kind: type[P], fields: Mapping[str, Any]) -> P | None:
    """Return the message, or None if it is invalid or too long to travel."""
    try:
        message = kind.model_validate(fields)
    except ValidationError:
        return None
    is_short = len(encode(message)) <= kind.max_bytes
    return message if is_short else None


class _Values:
    """Extremes of annotations, the plainest first."""

    def __init__(self, texts: Sequence[str]) -> None:
        self._texts = texts

    def of(self, annotation: Any, metadata: Sequence[Any]) -> list[Any]:
        """Return the extremes of a field. Some may be invalid."""
        origin = typing.get_origin(annotation)
        arguments = typing.get_args(annotation)
        if origin is typing.Annotated:
            return self.of(arguments[0], [*arguments[1:], *metadata])
        if origin is typing.Literal:
            return list(arguments)
        if origin in (typing.Union, types.UnionType):
            values: list[Any] = []
            for argument in arguments:
                values += self.of(argument, metadata)
            return values
        if origin is tuple:
            return self._of_tuple(arguments, metadata)
        if isinstance(annotation, type) and issubclass(annotation, SchemaModel):
            return self._of_model(annotation)
        return self._of_plain(annotation, _limits(metadata))

    def _of_tuple(self, arguments: Sequence[Any], metadata: Sequence[Any]) -> list[Any]:
        if arguments[-1] is not Ellipsis:
            if any(isinstance(constraint, AfterValidator) for constraint in metadata):
                return _axes(len(arguments))
            columns = [self.of(argument, []) for argument in arguments]
            longest = max(map(len, columns))
            rows: list[Any] = []
            shifted: list[Any] = []
            for row in range(longest):
                rows.append(tuple(column[row % len(column)] for column in columns))
                # different extremes at the same time
                places = enumerate(columns, start=row)
                shifted.append(tuple(column[place % len(column)] for place, column in places))
            return [*rows, *shifted]
        items = self.of(arguments[0], [])
        singles = [(item,) for item in items]
        pairs = [(item, item) for item in items]  # lines of no length, ids that occur twice
        return [(), *singles, *pairs, tuple(items[:MANY]), tuple(items[:1] * MANY)]

    def _of_model(self, kind: type[SchemaModel]) -> list[Any]:
        texts = self._texts[len(TEXTS) :]
        return [dict(vars(message)) for message in extreme_messages(kind, {}, texts)]

    def _of_plain(self, annotation: Any, limits: Mapping[str, Any]) -> list[Any]:
        if annotation is str:
            length = limits.get("max_length", LONG)
            long_texts = ["a" * length, "\U0001f4a5" * length]
            short_texts = [text[:length] for text in self._texts]
            return ["a", *long_texts, *short_texts]
        if annotation is bool:
            return [False, True]
        if annotation is bytes:
            return [b"", b"\x00", b"\xff" * 12, b"\x7f" * 13]
        if annotation is types.NoneType:
            return [None]
        if annotation not in (int, float):
            raise TypeError(f"no extremes of {annotation}: add them here")
        least = -1e300 if annotation is float else -(2**63)
        most = 1e300 if annotation is float else 2**64 - 1
        low = limits.get("gt", limits.get("ge", least))
        high = limits.get("lt", limits.get("le", most))
        if annotation is int:
            return [max(low, 0), low, low + 1, high, high - 1, 1]
        inside = (math.nextafter(low, math.inf), math.nextafter(high, -math.inf))
        return [max(low, 0.0), float(low), float(high), *inside, TINY, -0.0, 1.0]


def _limits(metadata: Sequence[Any]) -> dict[str, Any]:
    """Return the constraints of a field by their names."""
    constraints: list[Any] = []
    for item in metadata:
        constraints += getattr(item, "metadata", [item])
    limits: dict[str, Any] = {}
    for constraint in constraints:
        for name in ("ge", "gt", "le", "lt", "max_length"):
            limit = getattr(constraint, name, None)
            if limit is not None:
                limits[name] = limit
    return limits


def _axes(size: int) -> list[Any]:
    """Return unit vectors of `size`: both directions of each axis, a diagonal, one of float32 precision."""
    axes: list[Any] = []
    for axis in range(size):
        for sign in (1.0, -1.0):
            vector = [0.0] * size
            vector[axis] = sign
            axes.append(tuple(vector))
    diagonal = (size**-0.5,) * size
    zeros = (0.0,) * (size - 1)
    return [*axes, diagonal, (1.0009, *zeros)]


def is_name(text: str) -> bool:
    """Return True if `text` can stand in a key."""
    return NAME.match(text) is not None
