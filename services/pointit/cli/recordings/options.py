"""Options of commands that record."""

from typing import Any

import click


def recorder_options(function: Any) -> Any:
    """Add the options that say what is left out of a recording."""
    for option in (
        click.option(
            "--pseudonyms", is_flag=True, help="in the recording, call people person-1, person-2 and so on"
        ),
        click.option(
            "--without",
            multiple=True,
            metavar="TOPIC",
            help="leave topics out of the recording, by a part of their key, such as imu. Repeatable",
        ),
    ):
        function = option(function)
    return function
