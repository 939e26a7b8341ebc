"""Bases of all messages: immutability, strictness, units, the time of capture; their errors.

PointItError
└── SchemaError
    ├── DecodeError     bytes that are not the message they should be
    └── KeyNameError    a name that cannot stand in a key
"""

import math
from collections.abc import Callable
from typing import Annotated, ClassVar, ParamSpec, TypeVar, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, FailFast, Field, WithJsonSchema

P = ParamSpec("P")
T = TypeVar("T")
Ns = Annotated[int, Field(ge=0, lt=2**63)]
"""A time in ns that fits 64 bits."""

Count = Annotated[int, Field(ge=0, lt=2**63)]
"""A 64-bit count."""
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
"""A share, 0 to 1."""

Rgb = tuple[
    Annotated[int, Field(ge=0, le=255)],
    Annotated[int, Field(ge=0, le=255)],
    Annotated[int, Field(ge=0, le=255)],
]
"""Red, green, blue, 0 to 255 each."""

Many = Annotated[tuple[T, ...], FailFast()]
"""Any number of items. Only the first invalid one is reported: a million errors would take seconds."""

UNIT_TOLERANCE = 1e-3
"""Accepted deviation of the norm of a unit vector from 1 (float32 devices)."""

NORM_TOLERANCE = 0.05
"""Largest deviation of a quaternion's norm from 1 at which it is normalized, for all sources. Two decimals
deviate by up to 0.01, 8-bit integers by 0.008, a mean of two orientations 45° apart by 0.02. Zeros, angles
and shifted columns exceed it."""

NS_PER_S = 1_000_000_000

FARTHEST = 1e6
"""No coordinate, size, speed or angle is beyond, in SI units: nothing calculated with them overflows."""

Real = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
"""A coordinate, speed or angle."""

Extent = Annotated[float, Field(ge=0.0, le=FARTHEST)]
"""A size."""
Vec3 = tuple[Real, Real, Real]
"""x, y, z; metres unless the field says otherwise; right-handed, z up (REP-103)."""

FARTHEST_ALONG = 1e12
"""No way along a line or between two places is longer, whatever line a message can hold."""

Along = Annotated[float, Field(ge=-FARTHEST_ALONG, le=FARTHEST_ALONG)]
"""An arc length; beyond an end of its line it goes on."""

Distance = Annotated[float, Field(ge=0.0, le=FARTHEST_ALONG)]
"""From one place to another."""

NAME_PATTERN = r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,63}"
"""Regular expression of a name that may stand in a key."""

Name = Annotated[str, Field(pattern=f"^{NAME_PATTERN}$")]
"""A name that may stand in a key: letters, digits, `_`, `-`, `.`; at most 64 of them."""

KeyName = Annotated[str, Field(pattern=f"^{NAME_PATTERN}$"), WithJsonSchema({"type": "string"})]
"""A name of a person, a lamp, a robot, a service or a carrier, which becomes a part of a key.

A reader may declare a key with it, which fails if it is no `Name`. The pattern is newer than the schemas of
messages, which never change, so they do not state it; the catalogue does."""

KeyNameOrEmpty = Annotated[str, Field(pattern=f"^({NAME_PATTERN})?$"), WithJsonSchema({"type": "string"})]
"""A `KeyName`, or empty for none."""

MAX_ID = 256
"""Limit of characters of an id, so that a message that repeats a few of them has room for them."""

Id = Annotated[str, Field(max_length=MAX_ID), WithJsonSchema({"type": "string"})]
"""A name of anything: of an object, a surface, a kind, a person. The limit is newer than the schemas of
messages, which never change, so they do not state it; the catalogue does."""


class PointItError(Exception):
    """Root of everything PointIt raises on purpose."""


class SchemaError(PointItError, ValueError):
    """Root of everything raised by `pointit.schemas`."""


class DecodeError(SchemaError):
    """Bytes do not decode, or are not valid as the message of their key."""


class KeyNameError(SchemaError):
    """A user, lamp or service name contains characters that a key cannot hold."""


def _unit(values: tuple[float, ...]) -> tuple[float, ...]:
    norm = math.hypot(*values)
    if abs(norm - 1.0) > UNIT_TOLERANCE:
        raise ValueError(f"must have norm 1, has {norm:.6g}")
    return values


def unit_quaternion(values: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return the quaternion `values`, in any order, with norm 1.

    Raises:
        ValueError: If its norm is beyond `NORM_TOLERANCE`, or a value is not finite.
    """
    norm = math.hypot(*values)
    if not abs(norm - 1.0) <= NORM_TOLERANCE:  # false for NaN as well
        low = 1 - NORM_TOLERANCE
        high = 1 + NORM_TOLERANCE
        limits = f"{low:g} to {high:g}"
        raise ValueError(f"a quaternion of norm {norm:.7g}, not 1 ({limits} is normalized): scale it to 1")
    a, b, c, d = values
    return (a / norm, b / norm, c / norm, d / norm)


def _rotation(values: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return `unit_quaternion`. Norms of float32 stay as they are, so that a message keeps its bytes."""
    if abs(math.hypot(*values) - 1.0) <= UNIT_TOLERANCE:
        return values
    return unit_quaternion(values)


UnitVec3 = Annotated[
    tuple[float, float, float], AfterValidator(_unit), Field(json_schema_extra={"x-norm": 1})
]
"""A direction: x, y, z with norm 1."""

QuaternionXyzw = Annotated[
    tuple[float, float, float, float], AfterValidator(_rotation), Field(json_schema_extra={"x-norm": 1})
]
"""A rotation, scalar last: x, y, z, w with norm 1."""


class SchemaModel(BaseModel):
    """A piece of a message: frozen, strict, finite, nothing unknown."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        val_json_bytes="base64",
        defer_build=True,  # a process uses few of the messages: each is built at its first use
    )

    max_bytes: ClassVar[int] = 16 * 1024
    """A longer payload is refused unread: it can be no honest message, and to read it takes time."""


class Message(SchemaModel):
    """A thing that travels on its own.

    Fields are only ever added, with a default; a change raises `version`; anything else is a new message.
    """

    version: ClassVar[int] = 1
    """Raised by one with every change of the fields."""

    stamp_ns: Annotated[Ns, Field(description="time of capture, Unix ns; derived data keep it")]
    seq: Annotated[Count, Field(description="counts this writer's messages on this key")] = 0

    @classmethod
    def schema_name(cls) -> str:
        """Return name and version as they travel in the encoding, `ImuSample.v1`."""
        return f"{cls.__name__}.v{cls.version}"

    def contradiction(self, name: str) -> str:  # noqa: ARG002 - for messages that repeat it
        """Return the false statement about its writer under the key of `name`, or `""`.

        Access rules check the key, and nothing checks what a message says about its writer. Fields that
        repeat the name of the key are compared with it here, and a message that contradicts it is dropped.
        """
        return ""


M = TypeVar("M", bound=Message)


class ConstructorChecks:
    """Switch by which unchecked constructors validate after all. It is on in tests."""

    are_on: ClassVar[bool] = False


def unchecked(kind: Callable[P, M]) -> Callable[P, M]:
    """Return a constructor of the message `kind` that does not validate, in a third of the time.

    Only for messages of each sample whose values a pure core has calculated from valid messages and
    parameters. What comes from a device, another program, a plug-in or a file is made by `kind` itself.

    The fields are required or have defaults as those of `kind`, and stand in its order.
    """
    model = cast("type[M]", kind)
    fields = model.model_fields
    names = set(fields)
    new = object.__new__
    # as `object.__setattr__`, which looks for the slot at each call
    slots = ("__dict__", "__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__")
    set_fields, set_names, set_extra, set_private = (vars(BaseModel)[slot].__set__ for slot in slots)
    defaults = {name: field.default for name, field in fields.items()}  # in order, as it travels

    def make(*args: P.args, **values: P.kwargs) -> M:
        message = new(model)
        # as BaseModel.model_construct does, which has no signature and is slower than validation
        set_fields(message, {**defaults, **values})
        set_names(message, names)
        set_extra(message, None)
        set_private(message, None)
        if ConstructorChecks.are_on:
            validated = tuple(vars(kind(*args, **values)).items())
            calculated = tuple(vars(message).items())
            if not _is_same(validated, calculated):
                raise TypeError(f"{message!r}: validation converts a value; calculate it in its field's type")
        return message

    return make


def _is_same(validated: object, calculated: object) -> bool:
    """Return True if both have the same `repr`. Values that validation returns as they are cost nothing."""
    if isinstance(validated, tuple) and isinstance(calculated, tuple):
        if len(validated) != len(calculated):
            return False
        return all(map(_is_same, validated, calculated))
    return validated is calculated or repr(validated) == repr(calculated)


class Query(SchemaModel):
    """The content of a request. Same rules as a message, without a time of its own."""

    version: ClassVar[int] = 1

    @classmethod
    def schema_name(cls) -> str:
        """Return name and version as they travel in the encoding."""
        return f"{cls.__name__}.v{cls.version}"


class Reply(Query):
    """The answer to a request."""

    message: Annotated[str, Field(description="the effect, in one sentence for a person")] = ""
