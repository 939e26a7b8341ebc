"""`pointit service call KEY FIELD=VALUE…`: any request of the topic table."""

import difflib
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any

import click
from pydantic import ValidationError

from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import OutputSection, Row, json_option, print_json, say, show, to_line
from pointit.cli.common.panels import Finite
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.cli.inspect.topics import filled
from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S
from pointit.runtime.config.config import Layers, validate
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.config.parameters import ParameterInfo, iter_parameters
from pointit.runtime.errors import ConfigError
from pointit.schemas import Query, Reply, summarize_validation_error
from pointit.schemas.topics import REQUESTS, Request, check_name, topic_of
from pointit.services.registry import add_installed

AnyRequest = Request[Any, Any]

UNITS = {"m": "m", "mps": "m/s", "rad": "rad", "s": "s"}
"""Suffixes of fields."""

BOUNDS = (("ge", "from"), ("gt", "above"), ("le", "to"), ("lt", "below"))
"""Names of limits in pydantic and in the table."""


@site_command("call")
@click.argument("key", required=False)
@click.argument("values", nargs=-1, metavar="[FIELD=VALUE]...")
@click.option(
    "--timeout",
    "timeout_s",
    type=Finite(min=0.1, max=600),
    default=REQUEST_TIMEOUT_S,
    help="time to wait for the reply, s",
)
@json_option
async def command(
    site: SiteAddress, key: str | None, values: tuple[str, ...], *, timeout_s: float, as_json: bool
) -> int:
    """Send the request KEY to its service, and print the reply; without KEY, list all requests.

    VALUE is YAML: conveyor/set_speed speed_mps=0.5, or localizer/anna/set_pose 'position_m=[1, 2, 0]'; a list
    needs no brackets: conveyor/set_speed speed_mps=0.2 belts=part_e,part_f. The exit code is 1 if the
    service refuses or does not reply.

    Example: pointit service call conveyor/set_speed speed_mps=0.3
    """
    add_installed()
    if key is None:
        show([requests()], as_json=as_json)
        return 0

    # Errors of what was typed are found before the site is looked for
    request, name = resolve(key)
    query = build_query(request, key, values)
    async with site.join() as bus:
        reply: Reply = await bus.call(request, query, name, timeout_s=timeout_s)
    fields = reply.model_dump()
    if as_json:
        print_json({"key": request.at(name), **fields})
        return 0
    message = fields.pop("message")
    say((message or "done") + site.note)
    known_fields = {name: value for name, value in fields.items() if value is not None}
    if known_fields:
        click.echo(to_line(known_fields))
    return 0


def resolve(typed: str) -> tuple[AnyRequest, str]:
    """Return the request with the key `typed`, and the value of its placeholder.

    Raises:
        UnknownNameError: If there is none; suggests similar ones.
    """
    for request in REQUESTS:
        name = request.name_in(typed)
        is_name = bool(name) and "/" not in name
        if typed != request.key and not is_name:
            continue
        if request.placeholder:
            try:
                check_name(name, request.placeholder)
            except ValueError as error:
                raise UnknownNameError(f"key {typed!r}: {error}") from error
        return request, name

    # The commands for topics and requests are easily confused
    topic = topic_of(typed)
    if topic is not None:
        raise UnknownNameError(
            f"{typed} is a topic ({topic.about}), not a request; see `pointit topic echo {typed}`"
        )
    parts = typed.split("/")
    known = [filled(request.key, parts) for request in REQUESTS]
    near = difflib.get_close_matches(typed, known, n=3, cutoff=0.5)
    advice = "`pointit service call` lists all requests"
    if near:
        advice = f"did you mean {' or '.join(near)}?"
    raise UnknownNameError(f"no request has the key {typed!r}; {advice}")


def build_query(request: AnyRequest, key: str, values: Iterable[str]) -> Query:
    """Return the query of `request`, whose key was typed as `key`, with `values`, each `FIELD=VALUE`.

    Raises:
        UnknownNameError: If a value is wrong; names field, value and problem.
    """
    layers = Layers()
    known: Sequence[str] = list(request.query.model_fields)
    lists: set[str] = set()
    for parameter in iter_parameters(request.query):
        if parameter.type_name.startswith("list of "):
            lists.add(parameter.path[-1])

    for value in values:
        field, separator, text = value.partition("=")
        if not separator:
            raise UnknownNameError(f"{key}: {value!r}: write FIELD=VALUE, such as {_example(request)}")
        if field not in known:
            advice = nearest(field, known) if known else "it takes none"
            raise UnknownNameError(f"{key}: no field {field!r}; {advice}")
        if field in layers.values:
            raise UnknownNameError(f"{key}: {field} is given twice")
        # Brackets may be left out, as a shell may expand them: belts=part_e,part_f
        if field in lists and not text.lstrip().startswith("["):
            text = f"[{text}]"
        try:
            layers.add_text([field], text, f"{key}: {value}")
        except ConfigError as error:
            raise UnknownNameError(str(error)) from error

    # Types and limits are those of the query
    try:
        query: Query = validate(request.query, layers.values, strict=False)
    except ValidationError as error:
        raise UnknownNameError(f"{key}: {_error_message(request, error)}") from error
    return query


def requests() -> OutputSection:
    """Return every request with its fields."""
    return OutputSection(
        name="requests",
        about="ask with `pointit service call KEY FIELD=VALUE...`",
        rows=tuple(chain.from_iterable(map(_rows, REQUESTS))),
        roomy=frozenset({"type", "unit", "range", "default"}),
        whole=frozenset({"key", "field"}),
    )


def _rows(request: AnyRequest) -> list[Row]:
    """Return a row for each field of `request`, or one row if it has none."""
    rows = [_field_row(request, parameter) for parameter in iter_parameters(request.query)]
    if rows:
        return rows
    empty = dict.fromkeys(("field", "type", "unit", "range", "default"), "")
    return [{"key": request.key, **empty, "about": request.about}]


def _field_row(request: AnyRequest, parameter: ParameterInfo) -> Row:
    field = parameter.path[-1]
    suffix = field.rpartition("_")[2]
    return {
        "key": request.key,
        "field": field,
        "type": parameter.type_name,
        "unit": UNITS.get(suffix, ""),
        "range": _range(parameter),
        "default": parameter.default,
        "about": parameter.field.description or request.about,
    }


def _range(parameter: ParameterInfo) -> str:
    limits: dict[str, Any] = {}
    for name, word in BOUNDS:
        for limit in parameter.field.metadata:
            if hasattr(limit, name):
                limits[word] = getattr(limit, name)
    words = [f"{word} {value:g}" for word, value in limits.items()]
    return " ".join(words)


def _example(request: AnyRequest) -> str:
    fields = list(iter_parameters(request.query))
    if not fields:
        return "no field at all: it takes none"
    return f"{fields[0].path[-1]}=VALUE"


def _error_message(request: AnyRequest, error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    for parameter in iter_parameters(request.query):
        if first["type"] == "missing" and first["loc"] == parameter.path:
            field = parameter.path[-1]
            return f"{field} is missing: write {field}=VALUE, {parameter.type_name}"
    return summarize_validation_error(error)
