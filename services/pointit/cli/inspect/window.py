"""Options of commands that measure a site for a while, once or again and again."""

from collections.abc import Callable
from typing import Any

import click

from pointit.cli.common.option_types import Finite

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def window_options(default_s: float, note: str = "") -> Decorator:
    """Return the options `--window` (`window_s`) and `--watch`; `note` ends the help of the first."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        watch = click.option("--watch", is_flag=True, help="repeat until Ctrl-C, once a window")
        window = click.option(
            "--window",
            "window_s",
            type=Finite(min=0.1),
            default=default_s,
            show_default=True,
            help=f"measuring time, s{note}",
        )
        return window(watch(function))

    return add
