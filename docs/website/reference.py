"""Pages of the reference, generated from the code whenever the site is built."""

import ast
import typing
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import click
from pydantic import BaseModel

import pointit
from pointit import errors
from pointit.api import requests
from pointit.api.feed import Feed, Latest, Newest
from pointit.api.inputs import Tracker
from pointit.api.requests import Lamp
from pointit.cli.common.panels import ALL_OPTIONS
from pointit.cli.main import front
from pointit.launch.plan.plan import read_scenario, scenario_names
from pointit.maps.file import load_map, shipped_maps
from pointit.plugins import GROUPS
from pointit.runtime.config.parameters import ParameterInfo, iter_parameters
from pointit.schemas import Message
from pointit.schemas import problems as problem_codes
from pointit.schemas.base import Query
from pointit.schemas.topics import REQUESTS, TOPICS
from pointit.services.registry import PROCESSES

ROOT = Path(__file__).parents[2]
SOURCES = ("pointit", "schemas", "services", "bridges")
"""Folders of the product."""
WIDTH = 100
"""Columns of the help texts."""


def parameters() -> Iterator[str]:
    """Yield the parameters of every service."""
    yield "# Parameters of services"
    yield (
        "Set them on the command line (`--set SERVICE.PARAMETER=VALUE` after `pointit run`, "
        "`--PARAMETER VALUE` after the service's own command), in a YAML file (`--config FILE`) "
        "or in the environment (`POINTIT_SELECTOR__GAUGE__FULL_S=0.8`). Lists and mappings are YAML."
    )
    for row in PROCESSES:
        yield f"## {row.name}"
        yield f"{_sentence(row.about)} One per {row.scope}." + (
            f" Needs the extra `{row.extra}`." if row.extra else ""
        )
        rows = [
            (f"`{'.'.join(each.path)}`", each.type_name, _default(each), each.field.description or "")
            for each in iter_parameters(row.config())
        ]
        yield table(("parameter", "type", "default", "meaning"), rows) if rows else "It has no parameters."


def messages() -> Iterator[str]:
    """Yield the fields of every message, query and reply."""
    yield "# Messages"
    yield (
        "Every message also has `stamp_ns`, the time of capture in ns since 1970, and `seq`, which "
        "counts the writer's messages on the key. On the wire a message is a msgpack map with these names. "
        "[Topics](topics.md) lists the keys."
    )
    kinds: dict[str, type[Message | Query]] = {}
    for topic in TOPICS:
        kinds[topic.message.schema_name()] = topic.message
    for request in REQUESTS:
        kinds |= {kind.schema_name(): kind for kind in (request.query, request.reply)}
    parts: dict[str, type[BaseModel]] = {}
    for name, kind in kinds.items():
        yield f"## {name}"
        yield from _fields(kind, parts)
    yield "# Parts of messages"
    done = set[str]()
    while todo := [name for name in parts if name not in done]:
        for name in todo:
            done.add(name)
            yield f"## {name}"
            yield from _fields(parts[name], parts)


def _fields(kind: type[BaseModel], parts: dict[str, type[BaseModel]]) -> Iterator[str]:
    yield _paragraph(kind.__doc__)
    schema = kind.model_json_schema()
    rows: list[tuple[str, str, str]] = []
    for name, field in kind.model_fields.items():
        if name in {"stamp_ns", "seq"} and issubclass(kind, Message):
            continue
        for part in _models(field.annotation):
            parts[part.__name__] = part
        shape = schema["properties"][name]
        meaning = _sentence(field.description or "")
        default = field.get_default(call_default_factory=True)
        if not field.is_required() and not isinstance(default, BaseModel):
            meaning = f"{meaning} Default: `{default!r}`.".strip()
        rows.append((f"`{name}`", _type(shape), meaning))
    yield table(("field", "type", "meaning"), rows) if rows else "It has no further fields."


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in typing.get_args(annotation):
        yield from _models(inner)


def _type(shape: dict[str, Any]) -> str:
    """Return the type of a JSON schema for readers: `number[3]`."""
    if "$ref" in shape:
        name = shape["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in shape:
        return " or ".join(_type(each) for each in shape["anyOf"])
    if "enum" in shape:
        return ", ".join(f"`{each}`" for each in shape["enum"])
    if "const" in shape:
        return f"`{shape['const']}`"
    if shape.get("type") == "array":
        items: list[dict[str, Any]] = [shape["items"]] if "items" in shape else shape["prefixItems"]
        count = shape.get("maxItems") if shape.get("maxItems") == shape.get("minItems") else None
        return f"{_type(items[0])}\\[{'' if count is None else count}\\]"
    if shape.get("type") == "object" and isinstance(shape.get("additionalProperties"), dict):
        return f"mapping to {_type(shape['additionalProperties'])}"
    return str(shape.get("type", "any"))


def commands() -> Iterator[str]:
    """Yield the help of every command."""
    yield "# Commands"
    yield "`pointit COMMAND --help` prints the same."
    root = front()
    yield from _command(
        root, click.Context(root, info_name="pointit", terminal_width=WIDTH, **root.context_settings), 1
    )


def _command(command: click.Command, context: click.Context, depth: int) -> Iterator[str]:
    if depth > 1:
        yield f"{'#' * min(depth, 4)} {context.command_path}"
    context.meta[ALL_OPTIONS] = True
    yield f"```text\n{command.get_help(context)}\n```"
    if not isinstance(command, click.Group) or context.command_path.endswith(("service", "service run")):
        return
    for name in command.list_commands(context):
        inner = command.get_command(context, name)
        if inner is not None and not inner.hidden:
            below = click.Context(inner, info_name=name, parent=context, terminal_width=WIDTH)
            yield from _command(inner, below, depth + 1)


def scenarios() -> Iterator[str]:
    """Yield the shipped scenarios and maps."""
    yield "# Scenarios and maps"
    yield "## Scenarios"
    yield "`pointit run NAME` runs one, `pointit run FILE.yaml` one of your own."
    for name in scenario_names():
        scenario = read_scenario(name)
        services = ", ".join(f"`{each}`" for each in (*scenario.site, *scenario.user))
        yield f"### {name}"
        yield f"{_sentence(scenario.about)} {scenario.explained}".strip()
        yield f"Services: {services}."
    yield "## Maps"
    yield "`--set pui.map=NAME` uses one, or the path of [a file of your own](maps.md)."
    rows: list[tuple[str, ...]] = []
    for name in shipped_maps():
        room = load_map(name, 0)
        pixels = sum(strip.pixels for strip in room.strips)
        rows.append(
            (
                f"`{name}`",
                *(str(len(each)) for each in (room.lamps, room.strips)),
                str(pixels),
                *(str(len(each)) for each in (room.belts, room.links, room.bays)),
            )
        )
    yield table(("map", "lamps", "strips", "pixels", "belts", "links", "bays"), rows)


def api() -> Iterator[str]:
    """Yield the public names of the package, which mkdocstrings documents."""
    yield "# Names of the API"
    yield (
        "Every public name of `import pointit`. [Python API](api.md) says how to use them; what sites "
        "send are the classes of [messages](messages.md), `pointit.schemas`."
    )
    for name in dir(pointit):
        public = getattr(pointit, name)
        is_ours = callable(public) and public.__module__.startswith("pointit.")
        if is_ours and name[0] != "_" and name != "PointItError":
            yield _documented(f"{public.__module__}.{public.__qualname__}", f"pointit.{name}")
    yield "# Parts of a site"
    for part in (Feed, Lamp, Tracker, Latest, Newest, *_request_classes()):
        yield _documented(f"{part.__module__}.{part.__qualname__}", part.__qualname__)
    yield "# Errors"
    yield "`pointit.errors`: each is a `PointItError`, whose text is one sentence: what, where, what to do."
    named = [(name, getattr(errors, name)) for name in errors.__all__]
    rows = [
        (f"`{name}`", f"`{each.__bases__[0].__name__}`", _paragraph(each.__doc__)) for name, each in named
    ]
    yield table(("error", "is a", "when"), rows)


def _request_classes() -> list[type]:
    """Return the classes of `site.select` and so on, in the order of their module."""
    return [each for name, each in vars(requests).items() if name.endswith("Requests") and name[0] != "_"]


def _documented(path: str, heading: str) -> str:
    return f"::: {path}\n    options:\n      heading: {heading}\n      toc_label: {heading}"


def plug_ins() -> Iterator[str]:
    """Yield the kinds of plug-ins, and those that are shipped."""
    yield "# Plug-ins"
    yield (
        "`pointit plugin list` shows what is installed, from which package, and what is wrong with it. "
        "[How to write one](../how-to/write-a-plug-in.md)."
    )
    for kind, group in GROUPS.items():
        yield f"## {kind}"
        yield f"Entry points `{group.group}`."
        plugins = [(name, group.get(name)) for name in group.names if group.package(name) == "pointit"]
        rows = [(f"`{name}{plugin.value}`", _sentence(plugin.summary)) for name, plugin in plugins]
        yield table(("name", "what it is"), rows)


def problems() -> Iterator[str]:
    """Yield the codes of the problems that services report."""
    yield "# Codes of problems"
    yield (
        "Each service publishes its `problems` once a second in `health/{service}`: code, sentence, subject, "
        "topic and severity. `pointit doctor` finds causes by code, subject and topic. The sentence is for "
        "people and may change with every release."
    )
    yield table(
        ("code", "meaning"), ((f"`{code}`", meaning) for code, meaning in problem_codes.CODES.items())
    )
    yield "## Codes of single services"
    yield "Each stands for one problem of the services or rooms that report it. The sentence has the remedy."
    rooms = {code: sorted(places) for code, places in sorted(codes_in_use().items())}
    own = ((f"`{code}`", ", ".join(each)) for code, each in rooms.items() if code not in problem_codes.CODES)
    yield table(("code", "reported by"), own)


def codes_in_use() -> dict[str, set[str]]:
    """Return the rooms that report each code, from the calls of `warn` and of `Problem` in the product.

    Raises:
        TypeError: If a call makes up its code.
    """
    rooms: dict[str, set[str]] = {}
    for path in (each for name in SOURCES for each in sorted((ROOT / name).rglob("*.py"))):
        room = "/".join(path.relative_to(ROOT).with_suffix("").parts[:2])
        for code in _codes(ast.parse(path.read_text(encoding="utf-8")), path):
            rooms.setdefault(code, set()).add(room)
    return rooms


def _codes(tree: ast.AST, path: Path) -> Iterator[str]:
    for call in ast.walk(tree):
        stated: list[ast.expr] = []
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute):
            stated = call.args[:1] if call.func.attr in ("warn", "_warn") and len(call.args) > 1 else []
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "Problem":
            stated = [each.value for each in call.keywords if each.arg == "code"]
        elif isinstance(call, ast.FunctionDef) and call.name in ("warnings", "problems"):  # they yield pairs
            pairs = (each.value for each in ast.walk(call) if isinstance(each, ast.Yield))
            stated = [each.elts[0] for each in pairs if isinstance(each, ast.Tuple)]
        for node in (part for each in stated for part in ast.walk(each)):
            if isinstance(node, ast.JoinedStr | ast.BinOp):
                raise TypeError(f"{path}:{node.lineno}: a code is a constant; put what varies into `subject`")
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield node.value
            elif isinstance(node, ast.Name) and isinstance(code := getattr(problem_codes, node.id, 0), str):
                yield code


def modules() -> Iterator[str]:
    """Yield every module of the product, by folder, with the first sentence of its docstring."""
    yield "# Modules"
    yield (
        "Every module with the first sentence of its docstring. "
        "[Architecture](../explanation/architecture.md) has the folders in order, and the way of the data."
    )
    for source in (ROOT / name for name in SOURCES):
        folders: dict[Path, list[Path]] = {}
        for path in sorted(source.rglob("*.py")):
            folders.setdefault(path.parent, []).append(path)
        for folder, paths in folders.items():
            found = [(path, ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))) for path in paths]
            rows = [(f"`{path.name}`", docstring.split("\n\n")[0]) for path, docstring in found if docstring]
            if rows:
                yield f"## {folder.relative_to(ROOT).as_posix()}"
                yield table(("module", "content"), rows)


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table."""
    columns = list(head)
    lines = [columns, ["---"] * len(columns), *(list(row) for row in rows)]
    cells = [[" ".join(cell.replace("|", "\\|").split()) for cell in line] for line in lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


def _default(each: ParameterInfo) -> str:
    text = each.default
    return text if text in {"", "none", "required"} else f"`{text}`"


def _sentence(text: str) -> str:
    """Return `text` with a capital letter and a full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}" if text else ""


def _paragraph(docstring: str | None) -> str:
    return "\n\n".join(" ".join(part.split()) for part in (docstring or "").split("\n\n"))


PAGES: dict[str, Callable[[], Iterator[str]]] = {
    "reference/api-names.md": api,
    "reference/parameters.md": parameters,
    "reference/messages.md": messages,
    "reference/modules.md": modules,
    "reference/commands.md": commands,
    "reference/plug-ins.md": plug_ins,
    "reference/problems.md": problems,
    "reference/scenarios.md": scenarios,
}
"""Generated pages, by path below `docs`."""
