"""Configuration: one pydantic tree per service, filled from YAML, environment and command line.

Later sources win: defaults, files in order, `POINTIT_<SERVICE>__<FIELD>` variables, options.
"""

import contextlib
import copy
import json
import typing
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, cast

from pydantic import BaseModel, ConfigDict, ValidationError

from pointit.runtime.config.validation_message import describe_validation_error
from pointit.runtime.config.yaml_file import load_yaml, written_text
from pointit.runtime.errors import ConfigError
from pointit.schemas.text import SECRET_NAME, hide_secrets

C = TypeVar("C", bound="Config")
M = TypeVar("M", bound=BaseModel)
_TEXT_ERRORS = ("string_type", "path_type", "literal_error")


class Config(BaseModel):
    """Base of every configuration: a frozen set of parameters that refuses what it does not know.

    A service, plug-in or file declares its parameters as fields. Their values come from defaults, YAML files,
    `--set` and variables of the environment, in that order, and a mistake is one sentence that names the
    source.

    >>> from pydantic import Field
    >>> class LampConfig(Config):
    ...     brightness: float = Field(1.0, ge=0, le=1, description="0 is dark")
    >>> LampConfig(brightness=0.5)
    LampConfig(brightness=0.5)

    A field that does not exist is an error, not ignored: who writes `brightnes: 0.5` is told at the start.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)
    REPLACED: typing.ClassVar[tuple[str, ...]] = ()
    """Fields whose mapping in a later source replaces the earlier one. All others are merged by name."""
    SECRETS: typing.ClassVar[frozenset[str]] = frozenset()
    """Fields that are not published with the others. Those called `token`, `password`, `secret` or `key` need
    not be named here."""

    @classmethod
    def __pydantic_init_subclass__(cls, **_kwargs: Any) -> None:
        """Build the class of another package at its import, so that its errors are errors of the import."""
        if not cls.__module__.startswith("pointit."):
            cls.model_rebuild(raise_errors=False)  # False: for names that are defined later, as pydantic does


class Layers:
    """Values from several sources, the later ones on top, each remembered with where it came from."""

    def __init__(self, replaced: Sequence[str] = ()) -> None:
        """Create without values. `replaced` are the fields of `Config.REPLACED`."""
        self.values: dict[str, Any] = {}
        self._replaced = replaced
        self._sources: dict[tuple[str, ...], str] = {}

    def add(self, values: Mapping[str, Any], source: str) -> None:
        """Lay `values` on top; mappings are merged but for `replaced` ones, everything else is replaced."""
        for name in self._replaced:
            if isinstance(values.get(name), Mapping):
                self.values.pop(name, None)
        self._add_layer(values, source)

    def add_text(self, path: Sequence[str], text: str, source: str) -> None:
        """Override one value, given as YAML text (`0.5`, `[1, 2]`, `red`) and read as in files."""
        try:
            value = load_yaml(text, source)
        except ConfigError as error:
            shown = "" if SECRET_NAME.search(path[-1]) else f" ({text!r})"
            raise ConfigError(
                f"{source}: is not a value{shown}; it is read as YAML: write a text with {{ [ : or # in "
                "double quotes, such as '\"{w},{x}\"'"
            ) from error
        nested: Any = value
        is_quoted = text.lstrip().startswith(("'", '"'))
        if isinstance(value, str) and not is_quoted:
            nested = text.strip()  # with what follows ` #`
        for name in reversed(path[1:]):
            nested = dict[str, Any]({name: nested})

        # with a longer path, one entry of a mapping is changed
        add = self._add_layer if len(path) > 1 else self.add
        add({path[0]: nested}, source)

    def add_environment(self, environment: Mapping[str, str], prefix: str) -> None:
        """Lay variables `<prefix>A__B` on top as `a.b`."""
        for variable, text in sorted(environment.items()):
            if variable.startswith(prefix):
                path = variable[len(prefix) :].lower().split("__")
                self.add_text(path, text, f"variable {variable}")

    def build(self, kind: type[C]) -> C:
        """Return the configuration.

        Raises:
            ConfigError: If a value is invalid. Names the source, the field and the value.
        """
        try:
            return validate(kind, self.values)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            loc = tuple(str(part) for part in first["loc"])
            mistake = describe_validation_error(error, kind)
            raise ConfigError(f"{self._source_of(loc)}: {mistake}") from error

    def _add_layer(self, values: Mapping[str, Any], source: str) -> None:
        self._sources.setdefault((), source)  # of a value that is missing
        self._merge(self.values, values, (), source)

    def _merge(
        self, into: dict[str, Any], values: Mapping[Any, Any], path: tuple[str, ...], source: str
    ) -> None:
        for raw, value in values.items():
            key = str(raw)
            own_path = (*path, key)
            self._sources[own_path] = source
            if isinstance(value, Mapping):
                if not isinstance(into.get(key), dict):
                    into[key] = {}
                self._merge(into[key], typing.cast("Mapping[str, Any]", value), own_path, source)
            else:
                into[key] = value

    def _source_of(self, loc: tuple[str, ...]) -> str:
        # The longest path with a source: that of the value itself, else that of what contains it
        lengths = range(len(loc), -1, -1)
        sources = (self._sources.get(loc[:length]) for length in lengths)
        return next(filter(None, sources), "configuration")


def validate(kind: type[M], values: object, *, strict: bool | None = None) -> M:
    """Return `values` as a `kind`. In a field of text, a number, true or false is its text in the file.

    Raises:
        ValidationError: If a value is wrong.
    """
    try:
        return kind.model_validate(values, strict=strict)
    except ValidationError as error:
        names: list[tuple[int | str, ...]] = []
        for detail in error.errors(include_url=False):
            if detail["type"] not in _TEXT_ERRORS:
                continue
            if detail["input"] is not written_text(detail["input"]):
                names.append(detail["loc"])
        if not names:
            raise
    values = copy.deepcopy(values)
    for loc in names:
        _make_text(values, loc)
    return kind.model_validate(values, strict=strict)


def _make_text(values: Any, loc: Sequence[int | str]) -> None:
    """Replace the value at `loc` by its text. Alternatives of a union in it, such as `str`, are skipped."""
    holder = values
    last = loc[-1]
    inner = values
    for part in loc:
        with contextlib.suppress(KeyError, IndexError, TypeError):
            holder, last, inner = inner, part, inner[part]
    holder[last] = written_text(inner)


def published_parameters(config: Config) -> str:
    """Return the parameters of `config` as JSON that all users may read.

    It omits fields of `Config.SECRETS`, and fields at any depth with the name of a secret: `api_token`,
    `password`, `client_secret`, `key`. `hide_secrets` is applied to all text.
    """
    values = json.loads(config.model_dump_json(exclude=set(config.SECRETS), fallback=str))
    return json.dumps(_without_secrets(values))


def _without_secrets(value: object) -> Any:
    if isinstance(value, dict):
        fields = cast("dict[str, object]", value).items()
        return {name: _without_secrets(entry) for name, entry in fields if not SECRET_NAME.search(name)}
    if isinstance(value, list):
        return [_without_secrets(entry) for entry in cast("list[object]", value)]
    return hide_secrets(value) if isinstance(value, str) else value
