"""`pointit map point`: positions of lamps, boxes, screens and tables by pointing at them."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Literal, Unpack

import click

from pointit.cli.common import site_link
from pointit.cli.common.keyboard import has_keyboard, keys
from pointit.cli.common.output import INTERRUPTED, say
from pointit.cli.maps.scan import write_new
from pointit.geometry.vector import norm, subtract
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import ConfigError, NoMessageError
from pointit.runtime.service.shutdown import EXIT_FAILED, run_until_shutdown
from pointit.scan.as_map import pointed_text
from pointit.scan.by_pointing import Pointing, Survey, locate, pointing_of
from pointit.schemas import ButtonEvent, PointingRay, UserPose
from pointit.schemas.topics import BUTTON, POSE, RAY, check_name

Kind = Literal["lamp", "box", "screen", "table"]
CORNERS: dict[str, tuple[str, ...]] = {
    "lamp": ("",),
    "box": ("a corner of its top", "the next corner of its top", "the third corner of its top", "its foot"),
    "screen": ("its first corner", "the next corner", "the third corner"),
    "table": ("its first corner", "the next corner", "the third corner"),
}
"""Corners of each kind that are pointed at."""
HOLD_RAYS = 25
"""Number of rays before a press that are averaged."""
MOST_PLACES = 4
SAME_PLACE_M = 0.5
"""Distance up to which a person stands where they stood."""
PATIENCE_S = 3.0


@click.command("point", params=[*site_link.site_options()])
@click.argument("user")
@click.argument("names", nargs=-1, required=True)
@click.option(
    "--as",
    "kind",
    type=click.Choice(list(CORNERS)),
    default="lamp",
    show_default=True,
    help="what the names are; of boxes, screens and tables the corners are pointed at",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="MAP",
    help="map to write; an existing file is never overwritten  [default: standard output]",
)
def command(
    user: str, names: Sequence[str], *, kind: Kind, output: Path | None, **at: Unpack[site_link.AtSite]
) -> int:
    """Find positions by pointing: USER points at NAMES one after the other, from two or three places.

    USER stands at a place with a known pose (`pointit person pose`), points at each thing with a straight arm
    and presses their button, or Space here; then from a second place that is at least 60 degrees aside as
    seen from the things. A third place is asked for where two do not suffice. A person's common error is
    estimated along. Positions are good to 0.2 or 0.3 m, with the standard deviation stated: enough for
    lamps, boxes and screens, too little for strips, which `pointit map scan` finds.

    Example: pointit map point anna door window -o lamps.yaml
    """
    check_name(user, "user")
    for name in names:
        check_name(name, "name")
    if output is not None and output.exists():
        raise ConfigError(f"{output}: exists already; choose another name or move it away")
    site_link.quiet()
    return run_until_shutdown(_point(user, names, kind, output, **at))


async def _point(
    user: str, names: Sequence[str], kind: Kind, output: Path | None, **at: Unpack[site_link.AtSite]
) -> int:
    async with site_link.join_site(**at) as bus:
        try:
            session = PointingSession(bus, user, say)
            with keys(session.press) if has_keyboard() else nullcontext():
                survey = await session.run(names, CORNERS[kind])
        except asyncio.CancelledError:
            return INTERRUPTED
    text = pointed_text(survey, names, kind)
    if output is None:
        click.echo(text, nl=False)
    else:
        write_new(output, text)
    open_ones = {target: each.reason for target, each in survey.targets.items() if each.reason}
    for target, reason in open_ones.items():
        say(f"{target}: {reason}")
    return EXIT_FAILED if open_ones else 0


class PointingSession:
    """Asks one person to point at things from several places."""

    def __init__(self, bus: Bus, user: str, tell: Callable[[str], None]) -> None:
        """Create for `user`; `tell` gets the instructions."""
        self._user = user
        self._tell = tell
        self._pose = site_link.LatestMessage(bus, POSE, user)
        self._rays: deque[PointingRay] = deque(maxlen=HOLD_RAYS)
        self._pressed = asyncio.Event()
        bus.subscribe(RAY, self._on_ray, user)
        bus.subscribe(BUTTON, self._on_button, user)

    async def run(self, names: Sequence[str], corners: Sequence[str]) -> Survey:
        """Return the positions of all corners, called `NAME` or `NAME.NUMBER`, from as many places as needed.

        Raises:
            NoMessageError: If there are no rays or no pose of the person.
        """
        if await self._pose.wait(PATIENCE_S) is None:
            raise NoMessageError(
                f"{self._user} has no pose: set it by `pointit person pose {self._user} X,Y`, or localize"
            )
        targets: dict[str, str] = {
            target_name(name, number, corners): f"{corner + ' of ' if corner else ''}{name}"
            for name in names
            for number, corner in enumerate(corners)
        }
        pointings: list[Pointing] = []
        stood: list[UserPose] = []
        while True:
            pose = await self._next_place(stood)
            stood.append(pose)
            for target, words in targets.items():
                self._tell(f"{self._user}: point at {words} and press")
                await self._press()
                if not self._rays:
                    raise NoMessageError(f"no rays of {self._user} arrive: is their wrist connected?")
                latest = self._pose.value or pose
                pointings.append(
                    pointing_of(target, self._user, f"place {len(stood)}", list(self._rays), latest)
                )
            survey = locate(pointings)
            open_ones = {target for target, each in survey.targets.items() if each.reason}
            for target, each in survey.targets.items():
                if not each.reason:
                    self._tell(f"{target}: known to {100 * each.sigma_m:.0f} cm")
            if not open_ones or len(stood) == MOST_PLACES:
                return survey
            if len(stood) > 1:
                targets = {target: words for target, words in targets.items() if target in open_ones}

    async def _next_place(self, stood: Sequence[UserPose]) -> UserPose:
        """Return the pose when the person has one elsewhere than where they `stood`."""
        if not stood:
            return self._pose.value or await self._pose_elsewhere(stood)
        self._tell(
            f"{self._user}: go to another place, at least 60 degrees aside as seen from the things, "
            "and have your pose set there"
        )
        return await self._pose_elsewhere(stood)

    async def _pose_elsewhere(self, stood: Sequence[UserPose]) -> UserPose:
        def is_new(pose: UserPose) -> bool:
            return all(norm(subtract(pose.position_m, old.position_m)) > SAME_PLACE_M for old in stood)

        while True:
            if pose := await self._pose.wait(PATIENCE_S, is_new):
                return pose

    async def _press(self) -> None:
        self._pressed.clear()
        self._rays.clear()
        await self._pressed.wait()

    def press(self) -> None:
        """Take the rays of this moment."""
        self._pressed.set()

    def _on_ray(self, ray: PointingRay, _user: str) -> None:
        self._rays.append(ray)

    def _on_button(self, _event: ButtonEvent, _user: str) -> None:
        self.press()


def target_name(name: str, number: int, corners: Sequence[str]) -> str:
    """Return the name of a corner, or of a thing without corners."""
    return name if len(corners) == 1 else f"{name}.{number + 1}"
