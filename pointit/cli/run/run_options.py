"""Options shared by commands that start services, and their conversion."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pointit.cli.common.panels import Finite
from pointit.cli.parts import RUN_PARTS
from pointit.launch.plan.launches import LAMPS, LOCALIZATIONS, Choices, robot_of
from pointit.launch.plan.plan import FloorPose
from pointit.runtime.config.environment_variables import check_environment
from pointit.runtime.host.extras import present
from pointit.runtime.link.link import DEFAULT_ENDPOINT, Link
from pointit.runtime.link.options import given_credentials, link_of
from pointit.schemas import FARTHEST
from pointit.services import registry

BESIDE_ROS = "tcp/127.0.0.1:7448"
"""Listen address of a run in a ROS graph: ROS nodes would mistake a process at 7447 for their router."""

PARTS = present(RUN_PARTS)
"""Panels that optional rooms bring."""

PANELS = {
    "People": (
        *("users", "site_only", "scenario", "place", "here", "localize", "targets", "poses", "hand"),
        *("stature_m", "method"),
    ),
    "Devices": ("imu", "output", "ros2"),
    **{part.heading: part.names for part in PARTS},
    "Network": ("connect", "listen", "site", "credentials"),
}
"""Names of the options of `run` by the heading of their panel."""

USUAL = ("users", "method", "localize", "imu", "output", "lan", "record", "on", "settings", "duration")
"""Names of the options that `run --help` shows."""

PERSON_PANELS = {heading: PANELS[heading] for heading in ("People", "Devices", "Network")}
"""The same for `person add`."""


def _localization(ctx: click.Context, parameter: click.Parameter, value: str | None) -> str | None:
    if value is not None and not LOCALIZATIONS.fullmatch(value):
        raise click.BadParameter(
            f"{value!r} is no way to localize; write lamps, robot or robot:NAME", ctx=ctx, param=parameter
        )
    return value


def shared_options(function: Any) -> Any:
    """Add the options that `run` and `user` share."""
    # click shows the option first that was added last
    for option in reversed(
        [
            click.option(
                "--localize",
                is_flag=False,
                flag_value=LAMPS,
                metavar="[lamps|robot[:NAME]]",
                callback=_localization,
                help="find people's poses by pointing: at lamps, or by following a robot of the scenario "
                "with the arm (the first one, or the one called NAME). Without a value: lamps  [default: "
                "--pose, or the scenario's places]",
            ),
            *PERSON_OPTIONS,
            click.option(
                "--seed",
                default=0,
                type=click.IntRange(min=0),
                help="seed of all random number generators: people, packages, simulated devices",
            ),
            click.option(
                "--imu",
                multiple=True,
                metavar="SOURCE",
                help="source of orientations. sim (default): a simulated person, who chooses "
                "objects, points at them and presses the button. page: only a page's mouse or phone, or ROS. "
                "simulated: only a simulated sensor, on an "
                "arm that sweeps to and fro, to test the path of a device. serial:PORT or "
                "replay:FILE.csv: a device, or its recording; `pointit plugin list` lists others. "
                "Once for each person",
            ),
            click.option(
                "--with",
                "services",
                multiple=True,
                metavar="SERVICE",
                help="also start this service, such as one of an installed package; `pointit service list` "
                "lists them. Repeatable",
            ),
            click.option(
                "--config",
                "files",
                multiple=True,
                type=click.Path(path_type=Path),
                help="YAML file that maps services to parameters",
            ),
            click.option(
                "--set",
                "settings",
                multiple=True,
                metavar="SERVICE.PARAMETER=VALUE",
                help="change one parameter; `pointit service run NAME --help` shows them",
            ),
            click.option(
                "--duration",
                type=Finite(min=0.1),
                help="seconds until it ends by itself  [default: the scenario's, or never]",
            ),
            click.option(
                "--processes", is_flag=True, help="one process per service  [default: all in one process]"
            ),
            click.option("--no-view", is_flag=True, help="log instead of drawing in the terminal"),
        ]
    ):
        function = option(function)
    return function


def part_options(function: Any) -> Any:
    """Add the options of `run` that optional rooms bring."""
    for part in reversed(PARTS):
        function = part.options(function)
    return function


def choices_of(options: dict[str, Any], output: str = "") -> Choices:
    """Return the changes to a scenario by the options of `run` or `user` and `--output`.

    Raises:
        ConfigError: If an environment variable is for a service that does not exist.
    """
    check_environment(os.environ, registry.names())

    # Programs are started by a service of their own
    services: tuple[str, ...] = options["services"]
    if options.get("on"):
        services = (*services, "reactions")
    return Choices(
        seed=options["seed"],
        localize=options["localize"] is not None,
        robot=robot_of(options["localize"]),
        targets=options["targets"],
        poses=options["poses"],
        method=options.get("method", ""),
        hand=options["hand"] or "",
        stature_m=options["stature_m"],
        imu=options["imu"],
        output=output,
        services=services,
        ros2=options.get("ros2", False),
        files=options["files"],
        settings=options["settings"],
    )


def joining(options: dict[str, Any]) -> Link:
    """Return the link of `run` or `user` to the network, from its options or the given credentials.

    Raises:
        ConfigError: See `link_of`.
    """
    listen = tuple(options["listen"])
    connect = tuple(options["connect"])
    if not listen and not connect:
        credentials = given_credentials()
        if credentials is None:
            listen = (BESIDE_ROS if options.get("ros2") else DEFAULT_ENDPOINT,)
        else:
            connect = credentials.link.endpoints
    return link_of(options["site"], () if listen else connect, listen)


def pose(text: str) -> FloorPose:
    """Return the pose in `X,Y` or `X,Y,YAW`: metres and degrees.

    Raises:
        click.BadParameter: If it is not a pose.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in {2, 3} or not all(map(math.isfinite, numbers)):
        raise click.BadParameter(f"{text!r}: give X,Y or X,Y,YAW in metres and degrees, such as 2.0,0.5,20")
    x_m, y_m, *rest = numbers
    yaw_deg = rest[0] if rest else None
    is_far = max(abs(x_m), abs(y_m)) > FARTHEST
    if is_far or abs(yaw_deg or 0.0) > 360.0:
        raise click.BadParameter(f"{text!r}: X and Y are metres to {FARTHEST:,.0f}, YAW degrees to 360")
    return FloorPose(x_m=x_m, y_m=y_m, yaw_deg=yaw_deg)


def _poses(
    _context: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> tuple[FloorPose, ...]:
    return tuple(pose(text) for text in texts)


PERSON_OPTIONS: tuple[Callable[[Any], Any], ...] = (
    click.option(
        "--targets",
        type=click.IntRange(2, 64),
        metavar="N",
        help="with --localize: number of lamps to point at. With two, as in the paper, poses are uncertain "
        "but still accepted  [default: until the pose is certain enough]",
    ),
    click.option(
        "--pose",
        "poses",
        multiple=True,
        callback=_poses,
        metavar="X,Y[,YAW]",
        help="position of a person, m, and the azimuth of their IMU's yaw 0, deg; "
        "once for each person  [default: the scenario's places]",
    ),
    click.option(
        "--hand",
        type=click.Choice(["left", "right"]),
        help="hand with which people point, in their profile and as simulated",
    ),
    click.option(
        "--stature",
        "stature_m",
        type=Finite(0.5, 2.5),
        metavar="M",
        help="stature of people, m: scales the body measures of profile and simulation",
    ),
)
"""Options of `run` and `user` about people."""
