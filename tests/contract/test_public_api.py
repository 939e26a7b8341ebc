"""The public API is as recorded, and its requests are those of the request table."""

import inspect
import typing
from pathlib import Path
from typing import Any

import pytest
from pydantic.fields import FieldInfo

import pointit
from pointit.api import requests as api_requests
from pointit.schemas.topics import BEGIN_ACT, REQUESTS, SET_METHOD, Request
from pointit.services.registry import PROCESSES
from tests.contract import public_api
from tests.support.invoked import python

ROOT = Path(__file__).parents[2]
GROUPS, SYNC_GROUPS = (public_api.groups_of(site) for site in public_api.sites())
OF_PROGRAMS = [row for row in REQUESTS if row is not BEGIN_ACT]
"""Requests that programs send. A function of `@site.carries` is only called once its carrier has asked."""

requests = pytest.mark.parametrize("row", [pytest.param(row, id=row.key) for row in OF_PROGRAMS])

STRANGER = """
import sys
import pointit

assert pointit.connect and pointit.open and pointit.Site and pointit.SyncSite and pointit.PointItError
loaded = {name.partition(".")[0] for name in sys.modules} | set(sys.modules)
print(sorted(loaded & set(sys.argv[1:])))
"""


def test_nothing_public_changes_without_a_changelog_entry() -> None:
    before = public_api.LISTING.read_text(encoding="utf-8").splitlines()
    names = public_api.changed(before, public_api.listing())
    assert not names, "describe it in CHANGELOG.md, then run `python -m tests.contract.public_api`"


def test_stubs_and_module_have_the_same_names() -> None:
    stub = (ROOT / "pointit/__init__.pyi").read_text(encoding="utf-8")
    written = {line.rpartition(" as ")[2].split()[0] for line in stub.splitlines() if " as " in line}
    assert written | {"__version__"} == {*pointit.__dict__["_HOMES"], "errors", "__version__"}
    assert all(getattr(pointit, name) for name in written)
    with pytest.raises(AttributeError, match="has no attribute 'conect'"):
        _ = pointit.conect  # pyrefly: ignore[missing-attribute]


def test_importing_loads_neither_the_command_line_nor_the_services() -> None:
    services = [row.package for row in PROCESSES]
    unwanted = ("click", "rich", "typer", "numpy", "pointit.launch", "pointit.cli", *services)
    done = python("-W", "error", "-c", STRANGER, *unwanted, check=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")


def method_of(row: Request[Any, Any]) -> tuple[Any, Any]:
    """Return the group and the method of a request: the first and the last part of its key."""
    first, *_, last = row.key.split("/")
    group = GROUPS["select" if first == "selector" else first]
    return group, getattr(group, last)


@requests
def test_each_request_is_a_method_with_its_fields(row: Request[Any, Any]) -> None:
    group, method = method_of(row)
    parameters = list(inspect.signature(method).parameters.values())
    if row.placeholder:
        name = parameters.pop(0)
        assert (name.default, name.annotation) == (inspect.Parameter.empty, str)
    fields: dict[str, FieldInfo] = row.query.model_fields
    expected = ["name", "dwell_s"] if row is SET_METHOD else list(fields)  # its `method` is older than `name`

    assert [each.name for each in parameters] == expected
    for each in parameters:
        field = fields[each.name]
        default = inspect.Parameter.empty if field.is_required() else field.default
        assert each.default == default, each.name
        assert choices(each.annotation) == choices(field.annotation), each.name

    arguments: dict[Any, Any] = dict(
        zip(group.__parameters__, typing.get_args(group.__orig_class__), strict=True)
    )
    (reply,) = typing.get_args(arguments[inspect.signature(method).return_annotation])
    assert reply is row.reply


@requests
def test_each_method_sends_what_it_is_given(row: Request[Any, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def fields_of(_row: Request[Any, Any], fields: dict[str, Any]) -> dict[str, Any]:
        return fields

    def send(*sent: object) -> tuple[object, ...]:
        return sent

    group, method = method_of(row)
    monkeypatch.setattr(api_requests, "query_of", fields_of)
    monkeypatch.setattr(group, "_send", send)
    given = {name: object() for name in inspect.signature(method).parameters}
    fields = {name: given[name] for name in row.query.model_fields if name in given}
    assert method(**given) == (row, fields, next(iter(given.values())) if row.placeholder else "")


def choices(annotation: Any) -> set[Any]:
    """Return the values that a type with `Literal` permits, of others nothing."""
    arguments = typing.get_args(annotation)
    if typing.get_origin(annotation) is typing.Literal:
        return set(arguments)
    found = set[Any]()
    return found.union(*(choices(each) for each in arguments))


def test_scripts_get_the_replies_themselves() -> None:
    awaited = {
        name: tuple(typing.get_args(reply)[0] for reply in typing.get_args(group.__orig_class__))
        for name, group in GROUPS.items()
    }
    plain = {name: typing.get_args(group.__orig_class__) for name, group in SYNC_GROUPS.items()}
    assert plain == awaited


def test_there_are_no_other_requests() -> None:
    methods = {
        (name, method)
        for name, group in GROUPS.items()
        for method, _ in inspect.getmembers(group, inspect.ismethod)
        if not method.startswith("_")
    }
    assert len(methods) == len(OF_PROGRAMS)
