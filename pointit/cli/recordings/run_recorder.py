"""The recorder of `pointit run`: its options."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.run_part import Added, RunPart
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import Scenario
from pointit.launch.recorder import RunRecorder, recorder_launch
from pointit.runtime.errors import ConfigError


def _options(function: Any) -> Any:
    return click.option(
        "--record",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="record all messages in this file, as `pointit record` does",
    )(recorder_options(function))


def _add(_scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> Added:
    """Return the recorder of a run, if any; ConfigError: it has a file already, or options but no file."""
    file: Path | None = options["record"]
    without, pseudonyms = options["without"], options["pseudonyms"]
    if file is None:
        if without or pseudonyms:
            raise ConfigError("--without and --pseudonyms are for a recording: add --record FILE")
        return Added()
    launch = recorder_launch(file, without=without, pseudonyms=pseudonyms, seed=choices.seed)
    return Added(beside=[RunRecorder(launch)])


RECORDER_PART = RunPart(
    heading="Recording", names=("record", "without", "pseudonyms"), options=_options, add=_add
)


def recorder_options(function: Any) -> Any:
    """Add the options that exclude data from a recording."""
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
