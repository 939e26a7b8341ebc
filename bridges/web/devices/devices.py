"""Devices that pages have connected: each runs in its own process, and is remembered or forgotten.

A wrist is a `pointit person add`, a light a `pointit output add`, so each is a person or an output like those
of a terminal, with the rights of this process.

No core: it starts processes and waits for them.
"""

import asyncio
import contextlib
import logging
import sqlite3
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel

from pointit.bridges.web.devices.wire import MAX_DEVICES, ConnectDevice, ConnectedDevice, StoredDevices
from pointit.bridges.web.model.map_editor import MapEditor
from pointit.bridges.web.wire import DeviceLine
from pointit.maps.edit import Add
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import StateFile, site_folder
from pointit.runtime.host.store import acquire_lock
from pointit.runtime.host.threads import in_daemon_thread
from pointit.schemas import Deployment, Environment, LitPixels, ShowPixels
from pointit.schemas.base import Rgb
from pointit.schemas.system import check_user, instance_of
from pointit.schemas.topics import SHOW_PIXELS

if TYPE_CHECKING:
    from pointit.bridges.web.devices.search import FoundDevices
from pointit.bridges.web.devices.run_command import JsonObject, run_command
from pointit.schemas.text import system_reason

log = logging.getLogger(__name__)

T = TypeVar("T", bound=BaseModel)
LOCK_TIMEOUT_S = 2.0

PATTERN_S = 6.0
"""Time for which the pattern is shown, s."""
ENDS = 0.1
"""Share of the pixels of each end."""
RED: Rgb = (255, 0, 0)
GREEN: Rgb = (0, 255, 0)
BLUE: Rgb = (0, 0, 255)

IMU_BRIDGE = "imu-bridge"
MOUNTINGS = {"metamotion": "metamotion"}
"""Mounting of wrists that are worn differently from the usual, by plug-in."""
HEIGHT_M = 1.0
"""Default height of a strip that is added to the map along x, m."""
LEDS_PER_M = 60.0
"""Default number of its pixels per metre."""


def update_stored(file: StateFile[T], change: Callable[[T | None], T]) -> None:
    """Replace the stored value by `change(value)`. Other processes that update it wait.

    Raises:
        ConfigError: If a value cannot be read, used or written, or is locked for `LOCK_TIMEOUT_S`.
    """
    path = file.path
    lock_path = path.with_suffix(".lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        lock = acquire_lock(lock_path, LOCK_TIMEOUT_S)
    except (OSError, sqlite3.Error) as error:
        raise ConfigError(f"{path}: cannot be locked ({system_reason(error)})") from error
    if lock is None:
        raise ConfigError(f"{path}: another process is changing it; try again in a moment")
    with contextlib.closing(lock):
        value = file.read()
        file.write(change(value))


def pattern(strip: str, pixels: int) -> tuple[LitPixels, ...]:
    """Return the first tenth green, the last tenth red, and between them red, green and blue thirds.

    A dark pixel is between neighbours, where there is room.
    """
    end = max(1, round(ENDS * pixels))
    parts: list[tuple[range, Rgb]] = [(range(end), GREEN)]

    # Each third leaves its last pixel dark
    inner = range(end + 1, pixels - end - 1)
    third = len(inner) // 3
    for number, color in enumerate((RED, GREEN, BLUE)):
        start = number * third
        parts.append((inner[start : start + third - 1], color))

    # A strip of one pixel has no other end
    if pixels > end:
        parts.append((range(pixels - end, pixels), RED))

    patches: list[LitPixels] = []
    for lit, color in parts:
        if lit:
            patches.append(LitPixels(id=strip, pixels=tuple(lit), color=color))
    return tuple(patches)


@dataclass(eq=False)
class _Running:
    """A connected device and its process."""

    device: ConnectedDevice
    task: asyncio.Task[None] | None = None
    has_begun: bool = False
    """Its process has reported that it works. It may warn of something."""
    progress: str = ""
    """Last line of the check of its mounting."""
    problem: str = ""


@dataclass(kw_only=True)
class Devices:
    """Connects and forgets devices."""

    bus: ServiceBus
    maps: MapEditor
    address: str
    """Address at which the processes of devices join the site, or `""` if none may be started here."""
    run_output: str
    """The run's own `--output`, which has its controller to itself, or `""`."""
    present: Callable[[], Collection[str]]
    """Returns the instances that are present."""
    changed: Callable[[], None]
    """Called when the lines have changed."""
    _running: dict[str, _Running] = field(default_factory=dict[str, _Running])
    _found: "FoundDevices | None" = None
    _strips: Mapping[str, int] = field(default_factory=dict[str, int])
    """Number of pixels of each strip of the map."""
    _localizes: bool = False
    _is_damaged: bool = False
    """The stored devices could not be read; their file is kept beside the next one."""
    _searching: asyncio.Lock = field(default_factory=asyncio.Lock)
    _changing: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held while a page connects or forgets a device."""

    def on_map(self, room: Environment) -> None:
        """Set the map's strips."""
        self._strips = {strip.id: strip.pixels for strip in room.strips}

    def on_deployment(self, deployment: Deployment) -> None:
        """Note whether people of the run are localized."""
        if deployment.scenario:
            self._localizes = deployment.localizes

    @property
    def strips(self) -> Mapping[str, int]:
        """Return the number of pixels of each strip of the map."""
        return self._strips

    def lines(self) -> tuple[DeviceLine, ...]:
        """Return the connected devices, in the order of their connection."""
        lines: list[DeviceLine] = []
        for running in self._running.values():
            is_on = self._is_on(running)
            lines.append(running.device.line(is_on=is_on, progress=running.progress, problem=running.problem))
        return tuple(lines)

    async def run(self) -> None:
        """Connect the stored devices, and end the processes of all when cancelled."""
        try:
            if self.address:
                self._start_stored()
            await asyncio.Event().wait()
        finally:
            tasks: list[asyncio.Task[None]] = []
            for running in self._running.values():
                if running.task is not None:
                    tasks.append(running.task)
            # All are cancelled before the first is awaited, so their processes end together
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def find(self) -> dict[str, Any]:
        """Search for devices within reach of this machine.

        Returns:
            `devices`, each with `kind`, `plugin`, `address`, `label`, `pixels` and `use`, the option of
            `pointit run` that chooses it; `homes`, Home Assistants with `label`, `url` and the `command`
            that imports from them; `problems`, a sentence for each search that could not run;
            `can_connect`, True if `connect` is possible here.
        """
        # One search at a time: a second one waits, and then searches again
        async with self._searching:
            from pointit.bridges.web.devices.search import find  # noqa: PLC0415 - see above

            result = await in_daemon_thread(find, "search for devices")
            self._found = result

        shown_fields = {"kind", "plugin", "address", "label", "pixels"}
        devices: list[dict[str, Any]] = []
        for device, use in zip(result.devices, result.uses, strict=True):
            devices.append({**device.model_dump(include=shown_fields), "use": use})
        homes: list[dict[str, str]] = []
        for label, command, address in result.homes:
            homes.append({"label": label, "command": command, "url": address})
        return {
            "devices": devices,
            "homes": homes,
            "problems": list(result.problems),
            "can_connect": bool(self.address),
        }

    async def connect(self, request: ConnectDevice) -> dict[str, Any]:
        """Connect a device that was found, now and at every start, or start that of a connected one again.

        Raises:
            PointItError: If it cannot be connected; the text has the reason.
        """
        if not self.address:
            raise RefusedError(
                "this page belongs to no run, so it starts nothing: use the command shown beside the device"
            )
        async with self._changing:
            return await self._connect(request)

    async def _connect(self, request: ConnectDevice) -> dict[str, Any]:
        """Connect a device as `connect`, while no other one is connected or forgotten."""
        # A device that is connected already, under any name, or one of the last search
        connected = [running.device for running in self._running.values() if running.device.is_like(request)]
        device = connected[0] if connected else None
        if device is None and self._found is not None:
            device = self._found.device(request)
        if device is None:
            raise RefusedError(f"{request.plugin} {request.address} was not found: look for devices first")
        device = device.model_copy(update={"name": request.name})

        # What may forbid it: nothing has been changed until here
        if device.id not in self._running and len(self._running) >= MAX_DEVICES:
            raise RefusedError(f"{MAX_DEVICES} devices are connected, which is the most: forget one first")
        note = ""
        if device.kind == "wrist":
            self._check_wrist(device)
        else:
            note = await self._check_light(device)

        # It is stored before anything ends, so that a file that cannot be written changes nothing
        ended = {device.id}
        ended.update(previous.id for previous in connected)  # a device has one wearer, or one strip
        self._replace_stored(ended, device)
        for device_id in ended:
            await self._stop_device(device_id)
        self._start_device(device)

        if device.kind == "wrist":
            outcome = f"{device.name} joins"
        else:
            outcome = f"strip {device.name} is on {device.label}"
        return {"message": f"{outcome}; it is connected again at the next start{note}", "id": device.id}

    async def forget(self, device_id: str) -> dict[str, Any]:
        """Disconnect a device, and connect it no more.

        Raises:
            RefusedError: If there is none.
        """
        async with self._changing:
            device = self._device(device_id)
            self._replace_stored({device_id})
            await self._stop_device(device_id)
        self.changed()
        return {"message": f"{device.label} is disconnected and forgotten"}

    async def show(self, device_id: str) -> dict[str, Any]:
        """Show the test pattern on the strip of a light.

        Raises:
            RefusedError: If it has no such strip, or led-driver does not answer.
        """
        device = self._device(device_id)
        pixels = self._strips.get(device.name)
        if device.kind != "light" or pixels is None:
            raise RefusedError(f"the map has no strip {device.name}, on which a pattern could be shown")
        if device.pixels:
            pixels = min(pixels, device.pixels)
        lit = pattern(device.name, pixels)
        await self.bus.call(SHOW_PIXELS, ShowPixels(lit=lit, for_s=PATTERN_S))
        return {
            "message": f"for {PATTERN_S:g} s, strip {device.name} begins green and ends red, with "
            "red, green and blue between, in this order"
        }

    async def check_mounting(self, device_id: str) -> dict[str, Any]:
        """Measure how a wrist sits on the arm, by two poses, and use the result.

        Returns:
            That of `pointit person calibrate mounting --json`.

        Raises:
            RefusedError: If it fails; the text has the reason.
        """
        device = self._device(device_id)
        running = self._running[device_id]
        if running.progress:
            raise RefusedError(f"the mounting of {device.name}'s wrist is being checked: {running.progress}")
        # Set before the first await: a second request meanwhile is refused
        running.progress = "the check begins"
        result: JsonObject = {}

        def on_log_line(line: str) -> None:
            running.progress = line
            self.changed()

        measure = ("person", "calibrate", "mounting", "--non-interactive", "--json", *self._site_arguments)
        arguments = (*measure, "--", device.name)
        try:
            problem = await run_command(arguments, on_log_line, result.update)
        finally:
            on_log_line("")
        if problem:
            raise RefusedError(problem)
        return result

    # Processes.

    def _start_stored(self) -> None:
        try:
            stored = self._file.read() or StoredDevices()
        except ConfigError as error:
            self._is_damaged = True
            self.bus.warn("devices", f"connected devices are not known: {error}")
            return
        # A file that was written by hand may have one twice: the last entry counts
        devices = {device.id: device for device in stored.devices}
        for device in devices.values():
            self._start_device(device)

    def _start_device(self, device: ConnectedDevice) -> None:
        running = self._running[device.id] = _Running(device)
        if device.kind == "light" and device.option == self.run_output:
            problem = (
                f"`--output {device.option}` of this run drives it; leave that out, or forget the device"
            )
            self._set_problem(running, problem)
            return
        running.task = asyncio.create_task(self._run_device(running), name=f"device {device.id}")
        self.changed()

    async def _run_device(self, running: _Running) -> None:
        """Run the process of a device until it ends, and report its problems."""
        device = running.device
        arguments = self._arguments(device)

        def on_object(report: JsonObject) -> None:
            running.has_begun = True
            warnings = map(str, report.get("warnings", ()))
            self._set_problem(running, "; ".join(warnings))

        log.info("connecting %s: pointit %s", device.label, " ".join(arguments))
        problem = await run_command(arguments, lambda _line: None, on_object)
        running.has_begun = False
        self._set_problem(running, problem or "it has ended")

    def _set_problem(self, running: _Running, problem: str) -> None:
        running.problem = problem
        warning = f"{running.device.label}: {problem}" if problem else ""
        self.bus.warn("device", warning, running.device.id)
        self.changed()

    def _arguments(self, device: ConnectedDevice) -> tuple[str, ...]:
        """Return the command of `device`. Names follow `=` or `--`: one that begins with `-` is no option."""
        if device.kind == "light":
            return (
                "output",
                "add",
                f"--strip={device.name}",
                "--json",
                *self._site_arguments,
                "--",
                device.option,
            )

        arguments = ["person", "add", f"--imu={device.option}", "--no-view", *self._site_arguments]
        if self._localizes:
            arguments.append("--localize")
        if device.plugin in MOUNTINGS:
            arguments.append(f"--set={IMU_BRIDGE}.mounting={MOUNTINGS[device.plugin]}")
        if device.is_remote:
            arguments.append(f"--set={IMU_BRIDGE}.{device.plugin}.host=0.0.0.0")
        return (*arguments, "--", device.name)

    @property
    def _site_arguments(self) -> tuple[str, ...]:
        return ("--site", self.bus.site, "--connect", self.address)

    async def _stop_device(self, device_id: str) -> None:
        running = self._running.pop(device_id, None)
        if running is not None and running.task is not None:
            running.task.cancel()
            await asyncio.wait({running.task})
        self.bus.clear("device", device_id)

    def _is_on(self, running: _Running) -> bool:
        if running.device.kind == "light":
            return running.has_begun
        return instance_of(IMU_BRIDGE, running.device.name) in self.present()

    # What is stored.

    @property
    def _file(self) -> StateFile[StoredDevices]:
        return StateFile[StoredDevices].at(self._path, StoredDevices)

    @property
    def _path(self) -> Path:
        return site_folder(self.bus.site, "web") / "devices.json"

    def _replace_stored(self, removed_ids: Collection[str], *added: ConnectedDevice) -> None:
        """Store devices without touching those of another run of the site."""
        if self._is_damaged:
            with contextlib.suppress(OSError):
                self._path.replace(self._path.with_name("devices.json.bad"))
            self._is_damaged = False
            self.bus.clear("devices")

        # The file is read again: another run may have changed it since
        def change(stored: StoredDevices | None) -> StoredDevices:
            devices = stored.devices if stored else ()
            remaining = [device for device in devices if device.id not in removed_ids]
            if len(remaining) + len(added) > MAX_DEVICES:
                raise RefusedError(f"{MAX_DEVICES} devices are stored, which is the most: forget one first")
            return StoredDevices(devices=(*remaining, *added))

        update_stored(self._file, change)

    def _device(self, device_id: str) -> ConnectedDevice:
        running = self._running.get(device_id)
        if running is None:
            raise RefusedError(
                f"no device {device_id!r} is connected; connected: {', '.join(self._running) or 'none'}"
            )
        return running.device

    # Checks before a connection.

    def _check_wrist(self, device: ConnectedDevice) -> None:
        check_user(device.name)
        if device.id not in self._running and instance_of(IMU_BRIDGE, device.name) in self.present():
            raise RefusedError(f"{device.name} is there already: choose another name for who wears it")

    async def _check_light(self, device: ConnectedDevice) -> str:
        """Add the strip to the map if it is not there. Return what is to be done next, or `""`."""
        current = self._running.get(device.id)
        if current is not None and current.device.option != device.option:
            raise RefusedError(f"strip {device.name} is on {current.device.label}: forget that one first")

        # A strip of the map stays as it is
        pixels = self._strips.get(device.name)
        if pixels is not None:
            if device.pixels and device.pixels != pixels:
                return f"; the map gives it {pixels} pixels, the controller has {device.pixels}: correct one"
            return ""

        # A new one needs the controller's number of pixels
        if not device.pixels:
            raise RefusedError(
                f"{device.label} does not say how many pixels it has: choose a strip of the map"
            )
        length_m = device.pixels / LEDS_PER_M
        line = [[0.0, 0.0, HEIGHT_M], [length_m, 0.0, HEIGHT_M]]
        strip = Add(section="strips", name=device.name, value={"line": line, "pixels": device.pixels})
        room = await self.maps.read()
        await self.maps.save([strip], room["digest"], "")
        return f"; it is at a default place in the map, {length_m:.2g} m long: move it by Edit the map"
