"""Completions in a shell: names of scenarios and maps."""

from collections.abc import Iterable
from importlib.resources import files

import click
from click.shell_completion import CompletionItem


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
    names: list[str] = []
    for entry in files(package).joinpath(folder).iterdir():
        if entry.name.endswith(".yaml"):
            names.append(entry.name.removesuffix(".yaml"))
    matching = [name for name in sorted(names) if name.startswith(incomplete)]
    # bash forgets what comes before a file
    return [CompletionItem(incomplete, type="file"), *map(CompletionItem, matching)]
