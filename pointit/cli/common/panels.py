"""Options of commands: their panels in a help, and their types."""

import copy
import inspect
import math
import re
from collections.abc import Collection, Mapping
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
            self.params.append(click.Option(["--help-all"], callback=_show_all, help="Show all.", **flag))

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help: with usual options only its first paragraph and its examples."""
        shown = copy.copy(self)
        if self.usual and ALL_OPTIONS not in ctx.meta:
            first, *others = inspect.cleandoc(self.help or "").split("\n\n")
            examples = (each for each in others if each.removeprefix("\b\n").startswith("Example"))
            shown.help = "\n\n".join((first, *examples))
            shown.epilog = None
        super(PanelCommand, shown).format_help(ctx, formatter)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the usual options, or all in their panels."""
        rows = {
            parameter.name: row
            for parameter in self.get_params(ctx)
            if isinstance(parameter, click.Option) and (row := parameter.get_help_record(ctx)) is not None
        }
        if self.usual and ALL_OPTIONS not in ctx.meta:
            shown = [rows[name] for name in (*self.usual, "help_all", "help") if name in rows]
            with formatter.section("Usual options"):
                formatter.write_dl([(name, re.split(r"[.;] |  \[", text)[0]) for name, text in shown])
            return
        for heading, names in self.panels.items():
            with formatter.section(heading):
                formatter.write_dl([rows.pop(name) for name in names if name in rows])
        with formatter.section("Other options" if self.panels else "Options"):
            formatter.write_dl(list(rows.values()))
