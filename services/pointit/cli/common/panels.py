"""A command whose help shows its options in panels."""

from collections.abc import Collection, Mapping
from typing import Any

import click


class PanelCommand(click.Command):
    """A command with options under headings; the others follow under `Other options`."""

    def __init__(self, *arguments: Any, panels: Mapping[str, Collection[str]], **attributes: Any) -> None:
        """Create the command. `panels` maps headings to names of parameters, in the order shown."""
        super().__init__(*arguments, **attributes)
        self.panels = panels

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the panels."""
        rows = {
            parameter.name: row
            for parameter in self.get_params(ctx)
            if isinstance(parameter, click.Option) and (row := parameter.get_help_record(ctx)) is not None
        }
        for heading, names in self.panels.items():
            with formatter.section(heading):
                formatter.write_dl([rows.pop(name) for name in names if name in rows])
        with formatter.section("Other options"):
            formatter.write_dl(list(rows.values()))
