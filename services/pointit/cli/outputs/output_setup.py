"""Outputs of a scenario and its map, for commands that use them without a site."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from pointit.cli.common.completed_names import scenarios
from pointit.cli.common.output import say
from pointit.launch.plan.launches import Choices
from pointit.launch.plan.scenario import USUAL, read_scenario
from pointit.launch.plan.scenario_catalog import scenario_launches
from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.surroundings import NullHealth
from pointit.schemas import Environment
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.outputs import NONE
from pointit.services.pui.config import PuiConfig

F = TypeVar("F", bound=Callable[..., Any])


class PrintedHealth(NullHealth):
    """Prints each new warning."""

    def __init__(self) -> None:
        self._warnings: dict[str, str] = {}

    def warn(self, topic: str, sentence: str) -> None:
        """Print a warning unless it was the last one of its topic."""
        if sentence and self._warnings.get(topic) != sentence:
            say(sentence, err=True)
        self._warnings[topic] = sentence


def setup_options(function: F) -> F:
    """Add the argument and options that `read_setup` takes: `scenario`, `output`, `files`, `settings`."""
    for add in (
        click.option(
            "--set", "settings", multiple=True, metavar="SERVICE.PARAMETER=VALUE", help="change one parameter"
        ),
        click.option(
            "--config",
            "files",
            multiple=True,
            type=click.Path(path_type=Path),
            help="YAML file that maps services to parameters, as for `pointit run`",
        ),
        click.option(
            "--output",
            "--leds",
            "output",
            default="",
            show_default=False,
            metavar="OUTPUT",
            help="output, as for `pointit run`",
        ),
        click.argument("scenario", default=USUAL, shell_complete=scenarios),
    ):
        function = add(function)
    return function


def read_setup(
    scenario: str, output: str, files: Sequence[Path], settings: Sequence[str]
) -> tuple[Environment, LedDriverConfig]:
    """Return the map of a scenario, and the parameters of its outputs, of which there is at least one.

    Raises:
        ConfigError: If there is none, or anything is wrong.
    """
    chosen = read_scenario(scenario)
    launches = scenario_launches(
        chosen, Choices(output=output, files=tuple(files), settings=tuple(settings)), 1
    )
    configs = [launch.config for launch in launches]
    room = next((load_map(each.map_to_read, 0) for each in configs if isinstance(each, PuiConfig)), None)
    driver = next((each for each in configs if isinstance(each, LedDriverConfig)), None)
    if room is None or driver is None or all(each.kind == NONE for each in driver.outputs):
        raise ConfigError(f"{scenario} has no output: add --output, as in --output ddp:HOST")
    return room, driver
