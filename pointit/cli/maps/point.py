"""`pointit map point`: positions of lamps, boxes, screens and tables by pointing at them."""

import asyncio
import math
import re
from collections import deque
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Literal

import click
import numpy as np

from pointit.cli.common.keyboard import has_keyboard, keys
from pointit.cli.common.latest_message import LatestMessage
from pointit.cli.common.output import INTERRUPTED, print_file, say
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3, norm, rotate_z, subtract
from pointit.maps.edit import SetValue, edited, write_new
from pointit.maps.file import parse_map_file, to_message
from pointit.runtime.bus.contract import Bus
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import ConfigError, NoMessageError, PointItError, RefusedError
from pointit.runtime.host.state_file import replaced_file
from pointit.runtime.service.process import EXIT_FAILED
from pointit.scan.by_pointing import PointedAt, TargetRay, locate, pointing_of
from pointit.scan.result import pointed_text
from pointit.schemas import ButtonEvent, Environment, PointingRay, UseMap, UserPose
from pointit.schemas.text import system_reason
from pointit.schemas.topics import BUTTON, POSE, RAY, USE_MAP, check_name
from pointit.services.localizer.estimation.estimator import Pointings, Refusal, Solution, solve
from pointit.services.localizer.estimation.solution import SolverSettings
from pointit.services.localizer.estimation.unfiltered_rays import directions, origins

Point = tuple[float, float]
Kind = Literal["lamp", "box", "screen", "table"]
Work = Callable[["PointingSession"], Awaitable[tuple[str, int]]]
"""Asks a person to point, and returns the text of a map and the exit code."""

FLOOR_SIGMA_M = 1.0
"""Standard deviation of a floor's height that is not known: the person's eye height finds it."""
POINTS = {"lamps": "position", "strips": "line", "boxes": "center", "planes": "center"}
"""Key of the point or points of each section that can be placed."""
OLD_NOTE = re.compile(r"^# (Origin of the scan|Placed): .*\n", re.MULTILINE)
CORNERS: dict[str, tuple[str, ...]] = {
    "lamp": ("",),
    "box": ("a corner of its top", "the next corner of its top", "the third corner of its top", "its foot"),
    "screen": ("its first corner", "the next corner", "the third corner"),
    "table": ("its first corner", "the next corner", "the third corner"),
}
"""Corners of each kind that are pointed at."""
HOLD_RAYS = 25
"""Number of rays before a press that are averaged."""
PLACED_SIZE_M = 0.3
"""Size of a thing that is placed by pointing, m: about the error of its position."""
MAX_PLACES = 4
SAME_PLACE_M = 0.5
"""Distance up to which a person stands where they stood."""
TIMEOUT_S = 3.0


def point(ctx: click.Context, parameter: click.Parameter, text: str | None) -> Point | None:
    """Return the two numbers in `text`.

    Raises:
        click.BadParameter: If it does not have two.
    """
    if text is None:
        return None
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise click.BadParameter(
            f"{text!r} is not a position; write x and y in metres, such as 1.5,-2", ctx=ctx, param=parameter
        )
    return x, y


person_option = click.option(
    "--person",
    "person_m",
    metavar="X,Y",
    callback=point,
    help="position of a person in the room, m; write --person=-1,2 if x is negative",
)


def read(path: Path) -> tuple[bytes, Environment]:
    """Return the content of the map at `path`, and the map.

    Raises:
        ConfigError: If it cannot be read as a map.
        RefusedError: If it has sections that cannot be placed.
    """
    content = path.read_bytes()
    file = parse_map_file(content, path)
    for section in file.model_dump(exclude_unset=True):
        if section not in POINTS:
            raise RefusedError(f"{path} has {section}: only lamps, strips, boxes and planes are placed so")
    return content, to_message(path, file, {}, 0)


def ends_in(room: Environment, names: Sequence[str]) -> dict[str, Vec3]:
    """Return the place of each of `names`: a lamp, `STRIP:first` or `STRIP:last`, the pixels' order counts.

    Raises:
        RefusedError: If there is no such light.
    """
    places: dict[str, Vec3] = {lamp.id: lamp.position_m for lamp in room.lamps}
    for strip in room.strips:
        line = Polyline(strip.line_m)

        # The middle of the first and of the last pixel, half a pixel from the ends of the line
        half_m = line.length_m / strip.pixels / 2.0
        positions_m = np.array([half_m, line.length_m - half_m])
        ends = [_vec3(end) for end in line.points_at(positions_m)]
        first, last = ends[:: strip.direction]
        places[f"{strip.id}:first"] = first
        places[f"{strip.id}:last"] = last
    for name in names:
        if name not in places:
            raise RefusedError(f"there is no {name!r} in the map; there are {', '.join(places)}")
    return {name: places[name] for name in names}


def poses_of(
    rays: Mapping[str, Sequence[PointingRay]], ends: Mapping[str, Vec3], floor_m: float | None
) -> Solution:
    """Return the pose of a person whose `rays` were pointed at `ends`; its `z_m` is the height of the floor.

    Args:
        rays: rays of each hold, {H}, by name of the end.
        ends: position of each end, {W}.
        floor_m: height of the floor in the map, m. None: found by the person's eye height.

    Raises:
        RefusedError: If the ends do not determine it. One sentence.
    """
    # A target for each ray
    all_rays: list[PointingRay] = []
    targets_m: list[Vec3] = []
    for name, held_rays in rays.items():
        all_rays += held_rays
        targets_m += [ends[name]] * len(held_rays)
    times_s = np.array([ray.stamp_ns * 1e-9 for ray in all_rays])
    pointings = Pointings(times_s, origins(all_rays), directions(all_rays), np.array(targets_m))

    # A floor that is not known is sought around 0
    settings = SolverSettings()
    if floor_m is None:
        settings = SolverSettings(height_sigma_m=FLOOR_SIGMA_M)
    solution = solve(pointings, settings, floor_m=floor_m or 0.0)
    if isinstance(solution, Refusal):
        raise RefusedError(solution.reason)
    return solution


def placed(content: bytes, path: Path, origin_m: Vec3, heading_rad: float, note: str) -> bytes:
    """Return the map with its origin at `origin_m` and x in direction `heading_rad`; comments stay.

    Args:
        content: the map as it is.
        path: its path.
        origin_m: position in it that becomes [0, 0, 0].
        heading_rad: azimuth in it that becomes x.
        note: comment for the first line.
    """

    def rotated(vector: Any) -> list[float]:
        x, y, z = vector
        values = rotate_z((x, y, z), -heading_rad)
        return [round(value, 4) for value in values]

    def moved(point: Any) -> list[float]:
        offset = subtract(tuple(point), origin_m)
        return [round(value, 3) for value in rotated(offset)]

    # Points move and turn. A normal and a yaw only turn
    file = parse_map_file(content, path)
    sections: dict[str, dict[str, dict[str, Any]]] = file.model_dump(
        mode="json", by_alias=True, exclude_unset=True
    )
    edits: list[SetValue] = []
    for section, key in POINTS.items():
        for name, entry in sections.get(section, {}).items():
            point = entry[key]
            changes: dict[str, Any] = {}
            if section == "strips":
                changes[key] = list(map(moved, point))
            else:
                changes[key] = moved(point)
            if section == "planes":
                changes["normal"] = rotated(entry["normal"])
            if section == "boxes":
                yaw_deg = entry.get("yaw_deg", 0.0) - math.degrees(heading_rad)
                changes["yaw_deg"] = round(yaw_deg, 1)
            for changed_key, value in changes.items():
                edits.append(SetValue(section=section, name=name, key=changed_key, value=value))

    # The origin of the scan, or of an earlier placing, is not that of the map any more
    text = OLD_NOTE.sub("", edited(content, edits, path).decode())
    return f"# Placed: {note}\n{text}".encode()


def _vec3(values: Any) -> Vec3:
    x, y, z = values
    return (float(x), float(y), float(z))


@site_command("point", cls=PanelCommand, usual=("kind", "output", "room", "connect"))
@click.argument("user")
@click.argument("names", nargs=-1, required=True)
@click.option(
    "--as",
    "kind",
    type=click.Choice(list(CORNERS)),
    default="lamp",
    help="kind of NAMES; people point at the corners of boxes, screens and tables",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="MAP",
    help="map to write; an existing file is never overwritten  [default: standard output]",
)
@click.option(
    "--origin",
    "room",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    metavar="MAP",
    help="a scanned map: USER stands at its future origin and points at NAMES, which are its lamps or the "
    "ends of its strips (STRIP:first, STRIP:last); x points to the first one",
)
@click.option(
    "--into",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    metavar="MAP",
    help="NAMES are things of this map, whose centers are written into it",
)
@click.option(
    "--floor",
    "floor_m",
    type=Finite(-10, 10),
    metavar="M",
    help="with --origin: z of the floor in MAP  [default: by the eye height, less exactly]",
)
async def command(
    site: SiteAddress,
    user: str,
    names: Sequence[str],
    *,
    kind: Kind,
    output: Path | None,
    room: Path | None,
    into: Path | None,
    floor_m: float | None,
) -> int:
    """Find positions by pointing: USER points at NAMES one after the other, from two or three positions.

    USER stands at a position with a known pose (`pointit person pose`), points at each thing with a straight
    arm and presses their button, or Space here. Then USER does the same from a second position, at least 60
    degrees to the side as seen from the things. If two positions do not suffice, a third is requested. The
    person's constant error is also estimated. Errors are 0.2 to 0.3 m, and the standard deviation is printed.
    That suffices for lamps, boxes and screens. For strips, use `pointit map scan`.

    With --into, NAMES are things of a map, such as those of `pointit map import home-assistant`.

    With --origin, one position suffices, and its pose may be unknown. Two ends place a scanned map: one of
    them is low, and they are far apart sideways. The floor becomes z = 0.

    Example: pointit map point anna door window -o lamps.yaml
    """
    check_name(user, "user")
    _check_is_new(output)

    # Three kinds of work: things of a map, the origin of a map, or new things
    if into is not None:
        _check_things(names, into)
        has_other_map = room is not None or output is not None
        if has_other_map or kind != "lamp":
            raise click.UsageError("--into writes things into a map: leave out --origin, --output and --as")
        work = place_things(names, into)
    elif room is None:
        for name in names:
            check_name(name, "name")
        work = _point(names, kind)
    else:
        content, environment = read(room)
        work = stand_at(room, content, ends_in(environment, names), floor_m)

    # Space presses where there is a keyboard, else only the person's button
    async with site.join() as bus:
        try:
            session = PointingSession(bus, user, say)
            with keys(session.press) if has_keyboard() else nullcontext():
                text, code = await work(session)
        except asyncio.CancelledError:
            return INTERRUPTED
    if output is None and text:
        print_file(text)
    elif output is not None:
        write_new(output, text)
    return code


def _check_is_new(output: Path | None) -> None:
    """Raise ConfigError if there is a file already."""
    if output is not None and output.exists():
        raise ConfigError(f"{output}: exists already; choose another name or move it away")


def _check_things(names: Sequence[str], path: Path) -> None:
    """Raise ConfigError unless all names are things of the map at `path` that can be placed."""
    things = parse_map_file(path.read_bytes(), path).things
    for name in names:
        if name not in things:
            raise ConfigError(f"{path} has no thing {name!r}; {nearest(name, things)}")
    for name in names:
        if things[name].at is not None:
            raise ConfigError(f"{path}: {name} has `at`, which says where it is; leave it out of NAMES")


def _point(names: Sequence[str], kind: Kind) -> Work:
    corners = CORNERS[kind]

    async def work(session: "PointingSession") -> tuple[str, int]:
        positions = await session.run(names, corners)
        has_open = False
        for target, position in positions.items():
            if position.reason:
                say(f"{target}: {position.reason}")
                has_open = True
        targets: dict[str, list[PointedAt]] = {}
        for name in names:
            own = [target_name(name, number, corners) for number in range(len(corners))]
            targets[name] = [positions[target] for target in own]
        text = f"# Positions found by pointing.\n{pointed_text(targets, kind)}"
        return text, EXIT_FAILED if has_open else 0

    return work


def place_things(names: Sequence[str], path: Path) -> Work:
    """Return the work of pointing at things of the map at `path`, which gets their centers."""

    async def work(session: "PointingSession") -> tuple[str, int]:
        positions = await session.run(names, CORNERS["lamp"])
        centers: dict[str, list[float]] = {}
        for name, position in positions.items():
            if position.reason:
                say(f"{name}: {position.reason}")
            else:
                centers[name] = [round(value, 2) for value in position.position_m]

        # What was pointed at is not lost if the file cannot be written
        if centers:
            try:
                await asyncio.to_thread(_write_centers, path, centers)
            except PointItError as error:
                raise RefusedError(f"{error}; write these centers yourself: {centers}") from error
            except OSError as error:
                problem = f"{path}: cannot be changed ({system_reason(error)})"
                raise RefusedError(f"{problem}; write these centers yourself: {centers}") from error
            usage = await _use_again(session.bus, path)
            say(f"{', '.join(centers)}: written into {path}, {usage}")
        is_complete = len(centers) == len(positions)
        return "", 0 if is_complete else EXIT_FAILED

    return work


def _write_centers(path: Path, centers: Mapping[str, Sequence[float]]) -> None:
    content = path.read_bytes()  # may have changed meanwhile
    things = parse_map_file(content, path).things
    edits: list[SetValue] = []
    for name, center in centers.items():
        edits.append(SetValue(section="things", name=name, key="center", value=center))
        if name not in things or things[name].size is None:
            size_m = [PLACED_SIZE_M] * 3
            edits.append(SetValue(section="things", name=name, key="size", value=size_m))
    text = edited(content, edits, path)
    with replaced_file(path) as part:
        part.write_bytes(text)


async def _use_again(bus: Bus, path: Path) -> str:
    """Make the site use the map at `path` as it is now. Return a clause on whether it does."""
    try:
        used = (await bus.call(USE_MAP, UseMap())).path
        if not await asyncio.to_thread(_is_same, path, used):
            return f"which the site does not use: it uses {used}"
        await bus.call(USE_MAP, UseMap(path=used))
    except PointItError as error:
        return f"which the site uses from its next start on ({error})"
    return "and people point at it now"


def _is_same(path: Path, used: str) -> bool:
    try:
        return path.samefile(used)
    except OSError:  # a shipped map, or a file of another machine
        return False


def stand_at(room: Path, content: bytes, ends: Mapping[str, Vec3], floor_m: float | None) -> Work:
    """Return the work of placing the map `room`, of this content, by a person at its future origin.

    Args:
        room: path of the map.
        content: what it contains.
        ends: places of the lights to point at, in the map as it is, by name.
        floor_m: z of the floor in it, None if unknown.
    """

    async def work(session: "PointingSession") -> tuple[str, int]:
        user = session.user
        rays = {name: await session.hold(name) for name in ends}
        pose = poses_of(rays, ends, floor_m)

        # x points from the person to the first light
        first, (first_x_m, first_y_m, _) = next(iter(ends.items()))
        heading_rad = math.atan2(first_y_m - pose.y_m, first_x_m - pose.x_m)
        z_m = pose.z_m
        z_sigma_m = pose.z_sigma_m
        if floor_m is not None:
            z_m = floor_m
            z_sigma_m = 0.0
        note = (
            f"the origin is on the floor where {user} stood, within {pose.position_sigma_m:.2f} m "
            f"and {z_sigma_m:.2f} m in height (1 sigma); x points towards {first}."
        )
        say(note)

        # The person stands at the origin now, with the same IMU
        yaw_rad = math.remainder(pose.yaw_rad - heading_rad, math.tau)
        yaw_deg = math.degrees(yaw_rad)
        say(f"{user} there: pointit person pose {user} 0 0 --yaw {yaw_deg:.0f}")
        origin_m = (pose.x_m, pose.y_m, z_m)
        return placed(content, room, origin_m, heading_rad, note).decode(), 0

    return work


class PointingSession:
    """Asks one person to point at things from several places."""

    def __init__(self, bus: Bus, user: str, tell: Callable[[str], None]) -> None:
        """Create for `user`; `tell` gets the instructions."""
        self.user = user
        self.bus = bus
        self._tell = tell
        self._latest_pose = LatestMessage(bus, POSE, user)
        self._rays: deque[PointingRay] = deque(maxlen=HOLD_RAYS)
        self._pressed = asyncio.Event()
        bus.subscribe(RAY, self._on_ray, user)
        bus.subscribe(BUTTON, self._on_button, user)

    async def run(self, names: Sequence[str], corners: Sequence[str]) -> dict[str, PointedAt]:
        """Return the positions of all corners, called `NAME` or `NAME.NUMBER`, from as many places as needed.

        Raises:
            NoMessageError: If there are no rays or no pose of the person.
        """
        if await self._latest_pose.wait(TIMEOUT_S) is None:
            raise NoMessageError(
                f"{self.user} has no pose: set it by `pointit person pose {self.user} X Y`, or localize"
            )
        targets: dict[str, str] = {}
        for name in names:
            for number, corner in enumerate(corners):
                words = f"{corner} of {name}" if corner else name
                targets[target_name(name, number, corners)] = words
        pointings: list[TargetRay] = []
        poses: list[UserPose] = []
        while True:
            pose = await self._next_place(poses)
            poses.append(pose)
            place = f"place {len(poses)}"
            for target, words in targets.items():
                rays = await self.hold(words)
                latest = self._latest_pose.value or pose
                pointings.append(pointing_of(target, self.user, place, rays, latest))

            # All pointings count for all positions, as they share the person's constant error
            positions = locate(pointings)
            open_targets: dict[str, str] = {}
            for target, position in positions.items():
                if position.reason:
                    open_targets[target] = position.reason
                else:
                    sigma_cm = 100 * position.sigma_m
                    self._tell(f"{target}: known to {sigma_cm:.0f} cm")
            if not open_targets or len(poses) == MAX_PLACES:
                return positions

            # From a second place all are needed, from a third only what is still open
            if len(poses) > 1:
                targets = {target: words for target, words in targets.items() if target in open_targets}

    async def _next_place(self, poses: Sequence[UserPose]) -> UserPose:
        """Return the pose when the person has one elsewhere than where they `poses`."""
        if not poses:
            return self._latest_pose.value or await self._pose_at_another_place(poses)
        self._tell(
            f"{self.user}: go to another position, at least 60 degrees aside as seen from the things, and "
            "set your pose there"
        )
        return await self._pose_at_another_place(poses)

    async def _pose_at_another_place(self, poses: Sequence[UserPose]) -> UserPose:
        def is_new(pose: UserPose) -> bool:
            return all(norm(subtract(pose.position_m, old.position_m)) > SAME_PLACE_M for old in poses)

        while True:
            pose = await self._latest_pose.wait(TIMEOUT_S, is_new)
            if pose is not None:
                return pose

    async def hold(self, words: str) -> list[PointingRay]:
        """Ask the person to point at the target in `words`, and return the rays before their press, {H}.

        Raises:
            NoMessageError: If there are none.
        """
        self._tell(f"{self.user}: point at {words} and press")
        self._pressed.clear()
        self._rays.clear()
        await self._pressed.wait()
        if not self._rays:
            raise NoMessageError(f"no rays of {self.user} arrive: is their wrist connected?")
        return list(self._rays)

    def press(self) -> None:
        """Record the rays of this moment."""
        self._pressed.set()

    def _on_ray(self, ray: PointingRay, _user: str) -> None:
        self._rays.append(ray)

    def _on_button(self, _event: ButtonEvent, _user: str) -> None:
        self.press()


def target_name(name: str, number: int, corners: Sequence[str]) -> str:
    """Return the name of a corner, or of a thing without corners."""
    if len(corners) == 1:
        return name
    return f"{name}.{number + 1}"
