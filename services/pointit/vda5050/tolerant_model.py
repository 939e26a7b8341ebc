"""Base of messages of AGVs, which is read field by field: what cannot be understood is left out by name."""

import datetime as dt
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, cast

from pydantic import (
    AliasChoices,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    StringConstraints,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)
from pydantic.alias_generators import to_camel

COUNTS = 1 << 32
"""Number of different values of a counter."""
MAX_SHOWN = 40
"""Maximum number of characters of a value in a sentence."""
MAX_NAMES = 4
"""Maximum number of fields in a sentence."""


def _word(value: object) -> str:
    """Return a value of an enumeration in the spelling of version 2: `Auto_Ack` is AUTOACK."""
    if not isinstance(value, str | int | float):
        raise ValueError("is no word")  # noqa: TRY004 - pydantic takes ValueError
    return "".join(each for each in str(value).upper() if each.isalnum())[:MAX_SHOWN]


def _seconds(value: object) -> object:
    """Return the time of an ISO 8601 timestamp, or of a number of s, ms, µs or ns, Unix s."""
    if isinstance(value, str):
        text = value.strip()
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            time = dt.datetime.fromisoformat(text)
            return (time if time.tzinfo else time.replace(tzinfo=dt.UTC)).timestamp()
    if isinstance(value, int | float):
        for _ in range(3):
            value = value / 1000.0 if value > 1e11 else value
    return value


Text = Annotated[str, StringConstraints(max_length=500)]
Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Count = Annotated[int, Field(ge=0, lt=COUNTS)]
Seconds = Annotated[float | None, BeforeValidator(_seconds)]
Word = Annotated[str, BeforeValidator(_word)]
"""Value of an enumeration. Unknown ones are kept, for the caller to decide about."""


class TolerantModel(BaseModel):
    """A part of a message. Null counts as missing, an unreadable value becomes the default of its field.

    Unreadable items of a list are left out. A part of which a required field is unreadable is so itself.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="ignore",
        allow_inf_nan=False,
        alias_generator=to_camel,
        populate_by_name=True,
        coerce_numbers_to_str=True,
    )

    NEEDED: ClassVar[tuple[str, ...]] = ()
    """Fields that are reported if they are missing, since there is no value to assume."""
    KNOWN_WORDS: ClassVar[Mapping[str, frozenset[str]]] = {}
    """Fields of type `Word` of which other values are reported."""
    IF_UNREADABLE: ClassVar[Mapping[str, object]] = {}
    """Values of fields whose default must not be assumed if the message states something unreadable."""

    _unreadable: dict[str, str] = PrivateAttr(default_factory=dict[str, str])

    @property
    def unreadable(self) -> Mapping[str, str]:
        """Return what is wrong with each field of the message that could not be read, by its name."""
        return self._unreadable

    @field_validator("*", mode="wrap")
    @classmethod
    def _read(cls, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        name = cast("str", info.field_name)
        field = cls.model_fields[name]
        default = field.get_default(call_default_factory=True)
        if value is None and not field.is_required():
            return default
        try:
            result = handler(value)
        except ValidationError as error:
            _note(info, cls._label(name), value, error)
            if field.is_required():
                raise
            return _readable_items(value, handler) or cls.IF_UNREADABLE.get(name, default)
        if result not in cls.KNOWN_WORDS.get(name, (result,)):
            _note(info, cls._label(name), value)
        return result

    def model_post_init(self, context: Any, /) -> None:
        """Report what is missing."""
        if context is None:
            return
        self._unreadable = context
        for name in self.NEEDED:
            if getattr(self, name) in (None, ""):
                context.setdefault(self._label(name), "is missing")

    @classmethod
    def _label(cls, name: str) -> str:
        field = cls.model_fields[name]
        if isinstance(field.validation_alias, AliasChoices):
            return "/".join(map(str, field.validation_alias.choices))
        return field.alias or name


class UnreadableFields:
    """Unreadable fields of the messages of one topic, each with the value that was seen first."""

    def __init__(self) -> None:
        self._first: dict[str, str] = {}

    def describe(self, topic: str, message: TolerantModel) -> str:
        """Return a sentence with a remedy if fields of the newest `message` are unreadable, else `""`."""
        self._first = {name: self._first.get(name, what) for name, what in message.unreadable.items()}
        if not self._first:
            return ""
        listed = ", ".join(f"{name} {what}" for name, what in list(self._first.items())[:MAX_NAMES])
        others = len(self._first) - MAX_NAMES
        more = f" and {others} more" if others > 0 else ""
        return (
            f"{topic[:200]}: {listed}{more}; correct it at the AGV, or update its software to keep VDA 5050"
        )


def _note(info: ValidationInfo, label: str, value: object, error: ValidationError | None = None) -> None:
    """Remember an unreadable field, unless the part that is to blame has been noted as such."""
    notes: dict[str, str] | None = info.context
    if notes is None:
        return
    first = error.errors(include_url=False)[0] if error else None
    if first is None or not first["loc"] or isinstance(first["loc"][-1], int):
        text = repr(first["input"] if first else value)
        notes.setdefault(label, f"is {text[:MAX_SHOWN]}")
    elif first["type"] == "missing":
        notes.setdefault(str(first["loc"][-1]), "is missing")


def _readable_items(value: object, handler: ValidatorFunctionWrapHandler) -> list[Any]:
    """Return those items of a list that can be read."""
    items: list[Any] = []
    for each in cast("list[object]", value) if isinstance(value, list) else ():
        try:
            items += handler([each])
        except ValidationError:
            continue
    return items
