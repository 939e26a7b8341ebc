"""The compose files as compose reads them."""

import re
from pathlib import Path
from typing import Any

import click
import yaml

from pointit.cli.main import front

DEPLOY = Path(__file__).parents[3] / "deploy"
VARIABLE = re.compile(r"\$\{(\w+)(?::([-?])([^}]*))?\}")


def substituted(text: str, variables: dict[str, str]) -> str:
    """Return `text` with `${NAME}`, `${NAME:-default}` and `${NAME:?error}` replaced."""

    def value(found: re.Match[str]) -> str:
        name, kind, rest = found.groups()
        if variables.get(name):
            return variables[name]
        assert kind == "-", f"{name} has no value: {rest}"
        return str(rest)

    return VARIABLE.sub(value, text)


def compose(name: str, **variables: str) -> dict[str, Any]:
    text = (DEPLOY / name).read_text(encoding="utf-8")
    body = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#"))
    read: dict[str, Any] = yaml.safe_load(substituted(body, variables))
    return read


def parse(words: list[str]) -> tuple[str, dict[str, Any]]:
    """Have `pointit` take a command line, without running it. Return the command and its parameters."""
    group: Any = front()
    path: list[str] = []
    while isinstance(group, click.Group):
        found = group.get_command(click.Context(group), words[0])
        assert found is not None, words[0]
        group = found
        words = words[1:]
        path.append(group.name or "")
    with group.make_context(group.name, list(words)) as context:
        return " ".join(path), context.params
