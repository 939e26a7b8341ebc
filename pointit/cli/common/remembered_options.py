"""Completions of a shell: remembered options, and names of scenarios, maps and services."""

import contextlib
import importlib.metadata
import json
import os
from collections.abc import Callable, Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import click
import platformdirs
from click.shell_completion import CompletionItem

Completion = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def beginning(names: Iterable[tuple[str, str]], incomplete: str) -> list[CompletionItem]:
    """Return those of `names`, each with a line about it, that begin with `incomplete`."""
    return [CompletionItem(name, help=about) for name, about in names if name.startswith(incomplete)]


def scenarios(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the shipped scenarios, and files."""
    del ctx, param
    return _stems("pointit.launch", "scenarios", incomplete)


def maps(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the shipped maps, and files."""
    del ctx, param
    return _stems("pointit.maps", "shipped", incomplete)


def _stems(package: str, folder: str, incomplete: str) -> list[CompletionItem]:
    names = sorted(
        entry.name.removesuffix(".yaml")
        for entry in files(package).joinpath(folder).iterdir()
        if entry.name.endswith(".yaml")
    )
    found = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return [CompletionItem(incomplete, type="file"), *found]  # bash forgets what comes before a file


NAMES: dict[str, Completion] = {"scenarios": scenarios, "maps": maps}
"""Completions by their name in the remembered options."""


Load = Callable[[], click.Command]


def remembered(words: Sequence[str], load: Load) -> click.Command:
    """Return a command with the parameters of the one that `load` returns, which runs nothing.

    They are those of the last call as long as the sources and the installed packages are the same.

    Args:
        words: of the command, behind `pointit`.
        load: called if they are not known.
    """
    try:
        folder = platformdirs.user_cache_path("pointit", appauthor=False) / "completion"
    except RuntimeError:  # there is no home directory
        return load()
    path = folder / f"{'-'.join(words)}.json"
    state = _state_of_sources()
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        saved = json.loads(path.read_text(encoding="utf-8"))
        if saved["state"] == state:
            return _command(saved, words, load)
    saved = {"state": state, **_described(load())}
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}")
        part.write_text(json.dumps(saved), encoding="utf-8")
        part.replace(path)
    return _command(saved, words, load)


def _state_of_sources() -> list[Any]:
    """Return the version, the newest source and the time at which a package was last installed."""
    folder = Path(__file__).parents[2]
    times = (
        os.stat(os.path.join(at, name)).st_mtime_ns  # noqa: PTH116, PTH118 - hundreds of files in milliseconds
        for at, _, names in os.walk(folder, followlinks=True)
        for name in names
        if name.endswith(".py")
    )
    return [
        importlib.metadata.version("pointit"),
        max(times),
        Path(click.__file__).parents[1].stat().st_mtime_ns,
    ]


def _described(command: click.Command) -> dict[str, Any]:
    """Return names, help and values of a command's parameters, and names and help of its commands."""
    parameters: list[dict[str, Any]] = []
    for one in command.get_params(click.Context(command, help_option_names=[])):  # every command adds its own
        completion = getattr(one, "_custom_shell_complete", None)
        is_option = isinstance(one, click.Option)
        copied = ("multiple", "is_flag", "hidden", "help") if is_option else ("nargs", "required")
        choices = one.type.choices if isinstance(one.type, click.Choice) else ()
        parameters.append(
            {
                "names": [one.name, *one.opts, *one.secondary_opts] if is_option else [one.name],
                "is_option": is_option,
                "attributes": {name: getattr(one, name) for name in copied},
                "choices": [str(value) for value in choices],
                "is_file": isinstance(one.type, click.Path),
                "completion": next((name for name, known in NAMES.items() if known is completion), ""),
            }
        )
    entries: Sequence[Any] = getattr(command, "entries", ())
    return {"parameters": parameters, "entries": {entry.name: entry.about for entry in entries}}


class _Group(click.Group):
    """A group of which names are known."""

    def __init__(self, words: Sequence[str], load: Load, about: dict[str, str], **attributes: Any) -> None:
        super().__init__(words[-1], **attributes)
        self._words, self._load, self._about = words, load, about

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        del ctx
        if cmd_name not in self._about:
            return None
        return remembered((*self._words, cmd_name), lambda: self._inner(cmd_name))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        names = beginning(self._about.items(), incomplete)
        return [*names, *click.Command.shell_complete(self, ctx, incomplete)]

    def _inner(self, name: str) -> click.Command:
        group = self._load()
        found = group.get_command(click.Context(group), name) if isinstance(group, click.Group) else None
        return found or click.Command(name)


def _command(saved: dict[str, Any], words: Sequence[str], load: Load) -> click.Command:
    parameters = [_parameter(one) for one in saved["parameters"]]
    if saved["entries"]:
        return _Group(words, load, saved["entries"], params=parameters)
    return click.Command(words[-1], params=parameters)


def _parameter(saved: dict[str, Any]) -> click.Parameter:
    kind: Any = (
        click.Choice(saved["choices"]) if saved["choices"] else click.Path() if saved["is_file"] else None
    )
    attributes: dict[str, Any] = {
        **saved["attributes"],
        "type": kind,
        "shell_complete": NAMES.get(saved["completion"]),
    }
    if not saved["is_option"]:
        return click.Argument(saved["names"], **attributes)
    if attributes["is_flag"]:
        del attributes["type"]
    return click.Option(saved["names"], **attributes)
