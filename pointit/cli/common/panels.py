"""Options of commands: their panels in a help, and their types."""

import copy
import inspect
import math
import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import click

ALL_OPTIONS = "pointit.cli: all options"
"""Key of a context's `meta` that is set while all options are shown."""


class Finite(click.FloatRange):
    """A range of numbers without NaN."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return `value` as a number in the range."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


def _show_all(ctx: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        ctx.meta[ALL_OPTIONS] = True
        click.echo(ctx.get_help())
        ctx.exit()


class PanelCommand(click.Command):
    """A command with options under headings; the others follow under `Other options`."""

    def __init__(
        self,
        *arguments: Any,
        panels: Mapping[str, Collection[str]] | None = None,
        usual: Collection[str] = (),
        **attributes: Any,
    ) -> None:
        """Create the command.

        Args:
            arguments: of `click.Command`.
            panels: headings with names of parameters, in the order shown.
            usual: names of the parameters that `--help` shows, each by the first clause of its help, below
                the first paragraph and the examples; `--help-all` shows all. None: `--help` shows all.
            attributes: of `click.Command`.
        """
        super().__init__(*arguments, **attributes)
        self.panels = panels or {}
        self.usual = usual
        if usual:
            flag: dict[str, Any] = {"is_flag": True, "is_eager": True, "expose_value": False}
            option = click.Option(["--help-all"], callback=_show_all, help="Show all options.", **flag)
            self.params.append(option)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help: with usual options only its first paragraph and its examples."""
        shown = copy.copy(self)
        if self.usual and ALL_OPTIONS not in ctx.meta:
            first, *others = inspect.cleandoc(self.help or "").split("\n\n")
            shown.help = "\n\n".join((first, *filter(_is_example, others)))
            shown.epilog = None
        super(PanelCommand, shown).format_help(ctx, formatter)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the usual options, or all in their panels."""
        rows: dict[str | None, tuple[str, str]] = {}
        for parameter in self.get_params(ctx):
            if isinstance(parameter, click.Option):
                row = parameter.get_help_record(ctx)
                if row is not None:
                    rows[parameter.name] = row

        # Usual options, each by the first clause of its help, without its default
        if self.usual and ALL_OPTIONS not in ctx.meta:
            with formatter.section("Usual options"):
                usual: list[tuple[str, str]] = []
                for names, text in _pop_rows(rows, (*self.usual, "help_all", "help")):
                    clause = re.split(r"[.;] |  \[", text)[0]
                    usual.append((names, clause))
                formatter.write_dl(usual)
            return

        # All options, those of no panel last
        for heading, panel in self.panels.items():
            with formatter.section(heading):
                formatter.write_dl(_pop_rows(rows, panel))
        with formatter.section("Other options" if self.panels else "Options"):
            formatter.write_dl(list(rows.values()))


def _is_example(paragraph: str) -> bool:
    return paragraph.removeprefix("\b\n").startswith("Example")


def _pop_rows(rows: dict[str | None, tuple[str, str]], names: Iterable[str]) -> list[tuple[str, str]]:
    """Remove and return the rows of `names` that exist, in the order of `names`."""
    popped: list[tuple[str, str]] = []
    for name in names:
        if name in rows:
            popped.append(rows.pop(name))
    return popped
