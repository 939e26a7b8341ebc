"""`pointit track`: trackers and their objects."""

import asyncio
import contextlib
import math
import operator
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import click
import numpy as np
from pydantic import ValidationError

from pointit.cli.common.output import (
    OutputSection,
    Row,
    console,
    json_option,
    print_table,
    say,
    to_json,
    write_line,
)
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.cli.inspect.pose_errors import PoseErrors, TruthRow, print_errors
from pointit.cli.inspect.topics import RateMeter, window_options
from pointit.runtime.machine import this_machine
from pointit.runtime.service.process import EXIT_FAILED
from pointit.schemas import NS_PER_S, Configuration, Health, TrackedObjects, UserPose, encode
from pointit.schemas.system import BODY
from pointit.schemas.topics import CONFIGURATION, HEALTH, OBJECTS, POSE
from pointit.services.pui.tracked_objects import DuplicateFinder

MOCAP = "mocap"
"""Service of motion capture."""
MAX_LINES = 4096
"""Largest number of messages of a window whose age counts; of more, the latest."""


@dataclass(frozen=True, kw_only=True)
class TrackerRow:
    """One tracker over one window."""

    tracker: str
    objects: int
    rate_hz: float | None
    """Mean rate, or None for fewer than two messages."""
    age_s: float | None
    """Median time from a message's stamp to its arrival, by this machine's clock. None without messages."""
    age_p95_s: float | None
    latency_sigma_s: float | None
    """1 sigma of the stamps' error, as the tracker states it."""


@dataclass(frozen=True, kw_only=True)
class ObjectRow:
    """One object, as last reported."""

    object: str
    kind: str
    tracker: str
    x_m: float
    y_m: float
    z_m: float
    speed_mps: float
    yaw_deg: float | None
    sigma_m: float | None


@dataclass(frozen=True, kw_only=True)
class BodyRow:
    """One rigid body of motion capture."""

    body: str
    service: str
    configured_as: str
    """Kind or part of a person, or `""` if it is not configured."""
    state: str


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """All trackers over one window."""

    trackers: tuple[TrackerRow, ...]
    objects: tuple[ObjectRow, ...]
    bodies: tuple[BodyRow, ...]
    truth: tuple[TruthRow, ...]
    twins: tuple[str, ...]
    """Objects that two trackers report: a sentence each."""


class TrackerMeters:
    """Collects the messages of trackers."""

    def __init__(self, only: Sequence[str] = ()) -> None:
        self._only = frozenset(only)
        self._meters: dict[str, RateMeter] = {}
        self._ages_s: dict[str, deque[float]] = {}
        self._newest: dict[str, TrackedObjects] = {}
        self._bodies: dict[str, dict[str, str]] = {}
        """States of the bodies of motion capture by services."""
        self._configured: dict[str, dict[str, str]] = {}
        self._pose_errors = PoseErrors()
        self._duplicate_finder = DuplicateFinder()

    def add(self, tracker: str, message: TrackedObjects, *, arrived_s: float, arrived_ns: int) -> None:
        """Add a message.

        Args:
            tracker: its tracker.
            message: as it came.
            arrived_s: time of its arrival by any monotonic clock.
            arrived_ns: the same by this machine's clock, Unix ns.
        """
        self._duplicate_finder.on_objects(tracker, message)
        if self._only and tracker not in self._only:
            return
        meter = self._meters.setdefault(tracker, RateMeter(tracker))
        meter.add(arrived_s, len(encode(message)))
        ages_s = self._ages_s.setdefault(tracker, deque(maxlen=MAX_LINES))
        ages_s.append((arrived_ns - message.stamp_ns) / NS_PER_S)
        self._newest[tracker] = message
        self._pose_errors.add(message, tracker)

    def add_health(self, health: Health, instance: str) -> None:
        """Add the bodies that motion capture reports."""
        if health.service != MOCAP:
            return
        states: dict[str, str] = {}
        for figure in health.figures:
            if figure.name.startswith(BODY):
                states[figure.name.removeprefix(BODY)] = "used" if figure.value else "not used"
        self._bodies[instance] = states

    def add_configuration(self, configuration: Configuration, instance: str) -> None:
        """Add the bodies that motion capture is configured for."""
        from pointit.bridges.mocap.config import MocapConfig  # noqa: PLC0415 - for few sites

        if configuration.service == MOCAP:
            with contextlib.suppress(ValidationError):
                config = MocapConfig.model_validate_json(configuration.parameters)
                meanings = {name: body.meaning for name, body in config.bodies.items()}
                self._configured[instance] = meanings

    def add_pose(self, user: str, pose: UserPose) -> None:
        """Add the pose of a person, which is compared with that of trackers."""
        self._pose_errors.add(pose, user)

    def take(self, now_s: float, window_s: float) -> Tracking:
        """Return the last `window_s` until `now_s`, and start the next window."""
        trackers: list[TrackerRow] = []
        for tracker, message in sorted(self._newest.items()):
            ages_s = self._ages_s[tracker]
            age_s: float | None = None
            age_p95_s: float | None = None
            if ages_s:
                age_s = float(np.median(ages_s))
                age_p95_s = float(np.quantile(ages_s, 0.95))
            row = TrackerRow(
                tracker=tracker,
                objects=len(message.objects),
                rate_hz=self._meters[tracker].take(now_s, window_s).rate_hz,
                age_s=age_s,
                age_p95_s=age_p95_s,
                latency_sigma_s=message.latency_sigma_s,
            )
            trackers.append(row)
            ages_s.clear()

        # Duplicates are sought among all trackers, also those that are not shown
        twins: list[str] = []
        for twin in self._duplicate_finder.duplicates:
            if not self._only or not self._only.isdisjoint((twin.tracker, twin.other_tracker)):
                twins.append(twin.sentence)
        return Tracking(
            trackers=tuple(trackers),
            objects=tuple(_object_rows(self._newest)),
            bodies=tuple(self._body_rows()),
            truth=self._pose_errors.take(),
            twins=tuple(twins),
        )

    def _body_rows(self) -> Iterator[BodyRow]:
        for service, states in sorted(self._bodies.items()):
            configured = self._configured.get(service, {})
            for body in sorted(states.keys() | configured.keys()):
                yield BodyRow(
                    body=body,
                    service=service,
                    configured_as=configured.get(body, ""),
                    state=states.get(body, "not in the stream"),
                )


def _object_rows(newest: dict[str, TrackedObjects]) -> list[ObjectRow]:
    rows: list[ObjectRow] = []
    for tracker, message in sorted(newest.items()):
        for item in sorted(message.objects, key=operator.attrgetter("id")):
            x_m, y_m, z_m = item.position_m
            yaw_deg = None if item.yaw_rad is None else math.degrees(item.yaw_rad)
            row = ObjectRow(
                object=item.id,
                kind=item.kind,
                tracker=tracker,
                x_m=x_m,
                y_m=y_m,
                z_m=z_m,
                speed_mps=math.hypot(*item.velocity_mps),
                yaw_deg=yaw_deg,
                sigma_m=item.position_sigma_m,
            )
            rows.append(row)
    return rows


@site_command("track")
@click.argument("trackers", nargs=-1, metavar="[TRACKER]...")
@window_options(3.0, "; 3 and more find objects that two trackers report by different ids")
@json_option
async def command(
    site: SiteAddress, trackers: tuple[str, ...], *, window_s: float, watch: bool, as_json: bool
) -> int:
    """Show the trackers of a site and their objects: rates, latency, positions and their uncertainty.

    TRACKER is the name of one; without it, all are shown. The age of a message is measured by this machine's
    clock. Poses of localized people are compared with those of motion capture, if any. A warning names
    objects that two trackers report. The exit code is 1 if nothing arrived; Ctrl-C ends it with 0. With
    --json each window is one object on one line.

    Example: pointit track conveyor --watch
    """
    loop = asyncio.get_running_loop()
    meters = TrackerMeters(trackers)
    async with site.join() as bus:

        def on_objects(message: TrackedObjects, tracker: str) -> None:
            meters.add(tracker, message, arrived_s=loop.time(), arrived_ns=this_machine().now_ns())

        # Motion capture says in its health and its configuration which bodies it knows
        bus.subscribe(OBJECTS, on_objects)
        bus.subscribe(HEALTH, meters.add_health)
        bus.subscribe(CONFIGURATION, meters.add_configuration)
        bus.subscribe(POSE, lambda pose, user: meters.add_pose(user, pose))
        while True:
            await asyncio.sleep(window_s)
            tracking = meters.take(loop.time(), window_s)
            is_read = show(tracking, window_s, as_json=as_json)
            if not watch or not is_read:
                has_result = bool(tracking.trackers or tracking.bodies)
                return 0 if has_result else EXIT_FAILED


def show(tracking: Tracking, window_s: float, *, as_json: bool) -> bool:
    """Print one window. Return False if the reader of the pipe is gone."""
    if as_json:
        return write_line(to_json({"window_s": window_s, **asdict(tracking)}))
    if not (tracking.trackers or tracking.bodies):
        click.echo(
            f"no tracker sent a message within {window_s:g} s; start one, or see `pointit doctor`", err=True
        )
        return True

    # A table each, as far as there is something in it
    screen = console()
    trackers = tuple(map(_shown_tracker, tracking.trackers))
    section = OutputSection(name="trackers", about=f"over {window_s:g} s", rows=trackers)
    print_table(screen, section)
    objects: list[Row] = [asdict(row) for row in tracking.objects]
    if objects:
        roomy = frozenset(("kind", "yaw_deg"))
        section = OutputSection(name="objects", about="as last reported", rows=tuple(objects), roomy=roomy)
        print_table(screen, section)
    bodies: list[Row] = [asdict(row) for row in tracking.bodies]
    if bodies:
        section = OutputSection(name="bodies", about="in the stream and as configured", rows=tuple(bodies))
        print_table(screen, section)
    print_errors(screen, tracking.truth)
    for sentence in tracking.twins:
        say(f"warning: {sentence}")
    return True


def _shown_tracker(row: TrackerRow) -> Row:
    return {
        "tracker": row.tracker,
        "objects": row.objects,
        "rate_hz": row.rate_hz,
        "age_ms": _scaled(row.age_s, 1e3),
        "p95_ms": _scaled(row.age_p95_s, 1e3),
        "sigma_ms": _scaled(row.latency_sigma_s, 1e3),
    }


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value
