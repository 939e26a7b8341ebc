"""Command line options about people: pose, hand, stature."""

import math
from collections.abc import Callable
from typing import Any

import click

from pointit.cli.common.option_types import Finite
from pointit.launch.plan.person import Pose
from pointit.schemas import FARTHEST


def pose(text: str) -> Pose:
    """Return the pose in `X,Y` or `X,Y,YAW`: metres and degrees.

    Raises:
        click.BadParameter: If it is not a pose.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in {2, 3} or not all(math.isfinite(number) for number in numbers):
        raise click.BadParameter(f"{text!r}: give X,Y or X,Y,YAW in metres and degrees, such as 2.0,0.5,20")
    x_m, y_m, *rest = numbers
    yaw_deg = rest[0] if rest else None
    if max(abs(x_m), abs(y_m)) > FARTHEST or abs(yaw_deg or 0.0) > 360.0:
        raise click.BadParameter(f"{text!r}: X and Y are metres to {FARTHEST:,.0f}, YAW degrees to 360")
    return Pose(x_m=x_m, y_m=y_m, yaw_deg=yaw_deg)


def _poses(_context: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]) -> tuple[Pose, ...]:
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
