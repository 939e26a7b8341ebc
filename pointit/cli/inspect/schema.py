"""`pointit topic schema`: topics and messages for people and programs, and the files of the catalogue."""

import difflib
import json
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.output import OutputSection, Row, print_json, say, show
from pointit.cli.inspect import listings
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import replaced_file
from pointit.schemas import SchemaError
from pointit.schemas.catalogue import asyncapi, catalogue
from pointit.schemas.catalogue.asyncapi import Kind
from pointit.schemas.text import system_reason

DEFAULT_DIR = Path("schemas/catalogue/shipped")
"""Folder of the catalogue relative to the root of a checkout."""

EXIT_OUTDATED = 1


@click.command("schema")
@click.argument("message", required=False)
@click.option("--write", is_flag=True, help="write changed files to the catalogue's folder")
@click.option(
    "--check", is_flag=True, help="compare the catalogue's folder with the code; exit 1 if they differ"
)
@click.option(
    "--dir",
    "folder",
    type=click.Path(path_type=Path),
    help=f"the catalogue's folder; by default {DEFAULT_DIR} of a checkout, elsewhere what the package has",
)
@click.option("--json", "as_json", is_flag=True, help="print JSON: AsyncAPI, a JSON Schema, or the result")
def command(message: str | None, folder: Path | None, *, write: bool, check: bool, as_json: bool) -> int:
    """Show every topic and request, or one MESSAGE with its fields.

    MESSAGE is a name (ImuSample) or a name and version (ImuSample.v1).

    Example: pointit topic schema Cursor
    """
    if write + check + (message is not None) > 1:
        raise click.UsageError("MESSAGE, --write and --check exclude each other")
    if write:
        return _write(folder or DEFAULT_DIR, as_json=as_json)
    if folder is None:
        has_checkout = DEFAULT_DIR.is_dir() or not catalogue.SHIPPED.is_dir()
        folder = DEFAULT_DIR if has_checkout else catalogue.SHIPPED
    if check:
        return _check(folder, as_json=as_json)
    if message is not None:
        _show_message(message, folder, as_json=as_json)
    elif as_json:
        print_json(asyncapi.document())
    else:
        show([listings.topics(), listings.requests(), listings.presence()], as_json=False)
    return 0


def read_folder(folder: Path) -> dict[str, bytes]:
    """Return the committed files of a catalogue by their path in it.

    Raises:
        ConfigError: If there is no such folder, or a file cannot be read.
    """
    if not folder.is_dir():
        raise ConfigError(
            f"{folder}: there is no such folder; run this in the root of PointIt's checkout, or name the "
            "catalogue's folder with --dir"
        )
    files: dict[str, bytes] = {}
    try:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                files[path.relative_to(folder).as_posix()] = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot be read ({system_reason(error)})") from error
    return files


def write_folder(folder: Path, files: dict[str, bytes]) -> None:
    """Write `files` below `folder`.

    Raises:
        ConfigError: If one cannot be written.
    """
    try:
        for path, content in files.items():
            target = folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            with replaced_file(target) as part:
                part.write_bytes(content)
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot be written ({system_reason(error)})") from error


def _write(folder: Path, *, as_json: bool) -> int:
    files = catalogue.updated_files(read_folder(folder))
    write_folder(folder, files)
    if as_json:
        print_json({"written": sorted(files)})
        return 0
    for path in sorted(files):
        click.echo(f"wrote {folder / path}")
    if not files:
        click.echo(f"{folder} is up to date")
    return 0


def _check(folder: Path, *, as_json: bool) -> int:
    problems = catalogue.check_committed(read_folder(folder))
    if as_json:
        print_json({"ok": not problems, "problems": problems})
    for problem in problems:
        click.echo(f"{folder}: {problem}", err=True)
    if not problems and not as_json:
        click.echo(f"{folder} is up to date")
    return EXIT_OUTDATED if problems else 0


def _show_message(name: str, folder: Path, *, as_json: bool) -> None:
    schema = _schema_of(name, folder)
    if as_json:
        print_json(schema)
        return
    say(schema.get("description", ""))
    rows = tuple(_field_rows(schema, schema.get("$defs", {}), ""))
    about = f"of {schema['$id'].removesuffix('.json')}"
    show([OutputSection(name="fields", about=about, rows=rows)], as_json=False)


def _schema_of(name: str, folder: Path) -> dict[str, Any]:
    kinds = {kind.__name__: kind for kind in catalogue.all_kinds()}
    plain, _, version = name.partition(".v")
    kind: Kind | None = kinds.get(plain)
    if kind is None:
        near = difflib.get_close_matches(plain, kinds, n=1, cutoff=0.4)
        hint = f"there are {', '.join(kinds)}"
        if near:
            hint = f"did you mean {near[0]}?"
        raise SchemaError(f"no message {name!r}; {hint}")
    if not version or version == str(kind.version):
        return catalogue.message_schema(kind)
    files = read_folder(folder)
    path = f"messages/{name}.json"
    if path not in files:
        raise SchemaError(f"no message {name!r} in {folder}; today's is {kind.schema_name()}")
    schema: dict[str, Any] = json.loads(files[path])
    return schema


def _field_rows(schema: dict[str, Any], definitions: dict[str, Any], prefix: str) -> list[Row]:
    rows: list[Row] = []
    required = schema.get("required", ())
    for name, field in schema.get("properties", {}).items():
        text, part = _type_of(field, definitions)
        value = field.get("default")
        default = json.dumps(value, ensure_ascii=False)
        if name in required:
            default = "required"
        elif part is not None and value is not None:
            default = ""  # the rows of its fields have it
        about = field.get("description", "")
        rows.append({"field": prefix + name, "type": text, "default": default, "about": about})
        if part is not None:
            rows += _field_rows(part, definitions, f"{prefix}{name}.")
    return rows


def _type_of(field: dict[str, Any], definitions: dict[str, Any]) -> tuple[str, dict[str, Any] | None]:
    """Return a readable type of a field, and the model it contains, if any."""
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return name, definitions[name]
    if "anyOf" in field:
        alternatives = [_type_of(alternative, definitions) for alternative in field["anyOf"]]
        text = " or ".join(text for text, _ in alternatives)
        models = filter(None, (model for _, model in alternatives))
        return text, next(models, None)
    if "enum" in field:
        return " | ".join(map(str, field["enum"])), None
    if field.get("type") == "array":
        # A tuple, such as a vector, has a schema for each place, all of the same type
        places: list[dict[str, Any]] = field.get("prefixItems", [])
        if not places:
            text, model = _type_of(field["items"], definitions)
            return f"list of {text}", model
        text, model = _type_of(places[0], definitions)
        norm = " (norm 1)" if "x-norm" in field else ""
        return f"{len(places)} x {text}{norm}", model
    return _plain_type(field), None


def _plain_type(field: dict[str, Any]) -> str:
    name = str(field.get("const", field.get("type", "any")))
    if field.get("format") == "binary":
        name = "bytes"
    bounds = ((">=", "minimum"), (">", "exclusiveMinimum"), ("<=", "maximum"), ("<", "exclusiveMaximum"))
    for sign, keyword in bounds:
        if keyword in field:
            name += f" {sign} {field[keyword]:g}"
    return name
