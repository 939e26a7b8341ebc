"""The recorder of `pointit run` and `pointit record`, from its options."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import click

from pointit.cli.parts import RunAddition, RunPart
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.plan import Beside, Scenario
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import AnyService, Launch
from pointit.schemas.text import system_reason
from pointit.services import registry
from pointit.services.recorder.config import RecorderConfig

MAGIC = b"\x89MCAP0\r\n"
"""End of a whole MCAP file."""


def recorded(launch: Launch) -> str:
    """Return a sentence on the file that the recorder of a run has written."""
    path = Path(getattr(launch.config, "file", ""))
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - len(MAGIC)))
            is_whole = file.read() == MAGIC
    except OSError as error:
        return f"the recording {path} is not there: {system_reason(error)}"
    size_mb = size / 1e6
    cut = "" if is_whole else ", cut off; the log says why"
    return f"recorded in {path}: {size_mb:.2f} MB{cut}"


class RunRecorder(Beside):
    """The recorder beside a run, from before its first service to after its last one."""

    WHAT: ClassVar[str] = "recorder"
    WAIT_S: ClassVar[float] = 10.0

    def __init__(self, launch: Launch) -> None:
        """Create it."""
        self._launch = launch

    @property
    def instance(self) -> str:
        """Return its instance name."""
        return self._launch.instance

    def launch(self) -> Launch:
        """Return its launch."""
        return self._launch

    def closing_note(self) -> str:
        """Return a sentence on its file."""
        return recorded(self._launch)


def recorder_launch(
    file: Path | None,
    *,
    without: Sequence[str] = (),
    pseudonyms: bool = False,
    person: str = "",
    seed: int | None = None,
    service: type[AnyService] | None = None,
) -> Launch:
    """Return the launch of a recorder that writes `file`, or a file with the usual name.

    Raises:
        ConfigError: If the file is there already, or the extra is not installed.
    """
    if file is not None and file.is_dir():
        raise ConfigError(f"{file} is a folder; give a file in it, such as {file / 'session.mcap'}")
    if file is not None and file.exists():
        raise ConfigError(f"{file} is there already; give another name, or move it away")

    # Absolute, since the recorder may be a process in another folder
    path = "" if file is None else str(file.absolute())
    config = RecorderConfig(
        file=path,
        without=tuple(without),
        pseudonyms=pseudonyms,
        person=person,
        seed=seed,
    )
    return Launch(service=service or registry.process(registry.RECORDER).load(), config=config)


def _options(function: Any) -> Any:
    return click.option(
        "--record",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="record all messages in this file, as `pointit record` does",
    )(recorder_options(function))


def _add(_scenario: Scenario, choices: Choices, options: Mapping[str, Any]) -> RunAddition:
    """Return the recorder of a run, if any; ConfigError: it has a file already, or options but no file."""
    file: Path | None = options["record"]
    without = options["without"]
    pseudonyms = options["pseudonyms"]
    if file is None:
        if without or pseudonyms:
            raise ConfigError("--without and --pseudonyms are for a recording: add --record FILE")
        return RunAddition()
    launch = recorder_launch(file, without=without, pseudonyms=pseudonyms, seed=choices.seed)
    return RunAddition(beside=[RunRecorder(launch)])


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
