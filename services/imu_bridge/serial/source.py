"""A wrist on a serial port: read in its own thread, recognized, reconnected forever, watched for silence.

No core: it waits for a serial port in a thread.
"""

import asyncio
import collections
import contextlib
import errno
import logging
import math
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import serial

from pointit.runtime.clock import Clock
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.host.serial_port import (
    PortSettings,
    SerialPort,
    SerialThread,
    describe_error,
    is_open_in_another_process,
    open_port,
    serial_ports,
)
from pointit.runtime.service.plugin_guard import HealthSink
from pointit.schemas import Feedback
from pointit.services.imu_bridge.serial.detection import (
    DetectedSensor,
    Detection,
    SerialConfig,
    sensor_choice,
)
from pointit.services.imu_bridge.serial.framers import FLASH_S, SerialFramer
from pointit.services.imu_bridge.sources import Deliver, Disconnected, ImuSource, Item, Reconnected
from pointit.services.imu_bridge.streams import quoted

log = logging.getLogger(__name__)

NOTHING_S = 4.0
"""Time after which a port that sends nothing is released, s. Some boards need 2 s to start."""

SHOWN_BYTES = 32
"""Number of first bytes in the warning."""

CAPACITY = 1024
"""Items buffered while the event loop is busy; the oldest are dropped."""
CLEAR_BAD_AFTER_S = 10.0
"""Time without unreadable data after which its warning is cleared."""
COMMAND_PAUSE_S = 0.1
"""Pause between two commands to a device, s."""
SEARCH_S = (4.0, 11.0)
"""Times for which a port is listened to when it is new, and later: all speeds take 9 s."""
SEARCH_PAUSE_S = (6.0, 60.0)
"""Pauses before all ports are listened to again, doubled from the first to the most, so that other programs
can open them: led-driver tries every 2 s."""
SEARCH_STEP_S = 1.0
"""Time between two looks for new ports, s."""


@dataclass(frozen=True)
class PortAnswer:
    """A serial port, and the device on it."""

    path: str
    description: str
    found: DetectedSensor | None
    problem: str
    """Reason why nothing was recognized, or `""`."""

    def __str__(self) -> str:
        return f"{self.path} ({self.description}): {self.found or self.problem}"


async def ask_ports(ports: Iterable[SerialPort], config: SerialConfig, duration_s: float) -> list[PortAnswer]:
    """Listen on all `ports` that no other program has open, concurrently. Return the device on each.

    Nothing is sent, but opening the port restarts some boards.
    """
    stopping = threading.Event()
    try:
        asks = [asyncio.to_thread(_ask_port, port, config, duration_s, stopping) for port in ports]
        return await asyncio.gather(*asks)
    finally:
        stopping.set()


async def discover(duration_s: float) -> Sequence[FoundDevice]:
    """Return all serial ports with their devices."""
    ports = await asyncio.to_thread(serial_ports)
    devices: list[FoundDevice] = []
    for answer in await ask_ports(ports, SerialConfig(), duration_s):
        sensor = answer.found
        details: dict[str, str | float] = {}
        if sensor is not None:
            details = {"format": sensor.format, "baud": sensor.baud}
        label = f"{answer.description}: {sensor or answer.problem}"
        devices.append(FoundDevice(address=answer.path, label=label, details=details))
    return devices


def set_speed(port: serial.Serial, baud: int) -> None:
    """Change the speed of an open port, and forget what has arrived at the speed before.

    Raises:
        OSError: If the port is gone.
    """
    try:
        port.baudrate = baud
        port.reset_input_buffer()
    except OSError:
        raise
    except Exception as error:  # termios.error, which Windows does not have
        raise OSError(errno.EIO, str(error)) from error


def several(answers: Sequence[PortAnswer]) -> str:
    """Return `answers` for a sentence."""
    return ", ".join(map(str, answers)) or "none"


def _ask_port(
    port: SerialPort, config: SerialConfig, duration_s: float, stopping: threading.Event
) -> PortAnswer:
    if is_open_in_another_process(port.path):
        return PortAnswer(port.path, port.description, None, "another program has it open")
    detection = Detection(config)
    count = 0
    try:
        with open_port(PortSettings(port=port.path, baud=detection.baud)) as opened:
            begin_s = time.monotonic()
            while not stopping.is_set():
                # A port that sends nothing is not waited for as long
                limit_s = duration_s if count else min(duration_s, NOTHING_S)
                if time.monotonic() - begin_s >= limit_s:
                    break
                if opened.baudrate != detection.baud:
                    set_speed(opened, detection.baud)
                data = opened.read(max(1, opened.in_waiting))
                count += len(data)
                detection.feed(data, 0, time.monotonic())
                if detection.found is not None and detection.good:
                    return PortAnswer(port.path, port.description, detection.found, "")
    except OSError as error:
        return PortAnswer(port.path, port.description, None, describe_error(error, port.path))

    # Nothing was recognized
    problem = detection.text_problem
    if not problem:
        problem = "silent" if count == 0 else f"{count} bytes, none readable"
    return PortAnswer(port.path, port.description, None, problem)


class SilenceWatch:
    """Detects that nothing readable arrives."""

    def __init__(self, port: str, timeout_s: float, now_s: float) -> None:
        self._port = port
        self._timeout_s = timeout_s
        self._received_s = now_s
        self._good = 0
        self._first = b""
        self._silent = False
        self.received_bytes = 0
        """Number of bytes since the last readable ones."""

    def step(self, data: bytes, now_s: float, detection: Detection) -> str | None:
        """Return the warning when silence begins, `""` when it ends, else None.

        Args:
            data: that has arrived.
            now_s: time of the clock of the first `now_s`, s.
            detection: that `data` was fed to.
        """
        good = detection.good
        self.received_bytes += len(data)
        if len(self._first) < SHOWN_BYTES:
            self._first = (self._first + data)[:SHOWN_BYTES]
        if good != self._good:
            self._good = good
            self._received_s = now_s
            self.received_bytes = 0
            self._first = b""
            if self._silent:
                self._silent = False
                return ""
        elif not self._silent and now_s - self._received_s > self._timeout_s:
            self._silent = True
            return self._message(detection)
        return None

    def _message(self, detection: Detection) -> str:
        silence = f"{self._port} is connected but sent nothing readable for {self._timeout_s:g} s"
        if not self.received_bytes:
            return f"{silence}, not one byte: check the cable and that the device sends"
        if detection.passed_over:
            return f"{silence}, but {detection.passed_over}"
        if detection.text_problem:
            return f"the lines from {self._port} are not read, the last: {detection.text_problem}"
        return (
            f"{silence}: {self.received_bytes} bytes, the first {quoted(self._first)}; {detection.tried}; "
            "check baud and format, or what the device sends"
        )


class SerialSource:
    """Converts the bytes of a port to readings stamped with their arrival."""

    def __init__(self, config: SerialConfig, clock: Clock, health: HealthSink) -> None:
        self._config = config
        self._clock = clock
        self._health = health
        self._name = config.port
        """Port that is used."""
        self._first: DetectedSensor | None = None
        """Format and speed of the last connection."""
        self._lost = asyncio.Event()
        """Set when a port that a search has found is gone: the wrist may come back at another."""
        self._port: serial.Serial | None = None
        self._sensors = sensor_choice(config)
        self._others = ""
        """Warning about other sensors that is shown."""
        self._detection = Detection(config)
        self._ready: collections.deque[Item] = collections.deque(maxlen=CAPACITY)
        self._urgent: collections.deque[bytes] = collections.deque(maxlen=4)
        self._awake = False
        self._bad_s: float | None = None
        self._bad_reported = True
        self.bad_lines = 0
        """Number of unreadable lines, or bytes of a binary format, since the start."""

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        self._deliver = deliver
        while True:
            self._name = self._config.port or await self._search_port()
            await self._use_port()

    async def _use_port(self) -> None:
        self._lost.clear()
        baud = self._config.baud or self._detection.baud
        self._thread = SerialThread(
            PortSettings(port=self._name, baud=baud), self._read_port, self._on_change
        )
        port = asyncio.create_task(self._thread.run())
        lost = asyncio.create_task(self._lost.wait())
        try:
            await asyncio.wait((port, lost), return_when=asyncio.FIRST_COMPLETED)
            if port.done():
                port.result()  # raises the thread's error
        finally:
            port.cancel()
            lost.cancel()
            await asyncio.gather(port, lost, return_exceptions=True)

    def cue(self, cue: Feedback) -> None:
        """Show `cue` on the device, if it has a signal and is connected."""
        framer = self._detection.framer
        if framer is None:
            return
        begin, end = framer.cue(cue)
        if begin:
            self._send(begin)
            asyncio.get_running_loop().call_later(FLASH_S, self._send, end)

    def _send(self, command: bytes) -> None:
        """Send `command` at once in the port's thread, if the device is connected."""
        port = self._port
        if port is not None:
            self._urgent.append(command)
            with contextlib.suppress(OSError, TypeError):  # it is being closed
                port.cancel_read()

    async def _search_port(self) -> str:
        """Return the only port that answers; wait until there is one."""
        time_s = asyncio.get_running_loop().time
        answers: dict[str, PortAnswer] = {}
        pause_s = SEARCH_PAUSE_S[0]
        due_s = math.inf
        while True:
            # Listen to new ports at once, and again to all of them when that is due
            ports = await asyncio.to_thread(serial_ports)
            answers = {port.path: answers[port.path] for port in ports if port.path in answers}
            is_due = time_s() > due_s
            if is_due:
                ports_to_ask = ports
                duration_s = SEARCH_S[1]
            else:
                ports_to_ask = [port for port in ports if port.path not in answers]
                duration_s = SEARCH_S[0]
            for answer in await ask_ports(ports_to_ask, self._config, duration_s):
                answers[answer.path] = answer
            if ports_to_ask:
                due_s = time_s() + pause_s
            if is_due:  # let other programs open the ports
                pause_s = min(2 * pause_s, SEARCH_PAUSE_S[1])

            # Use the only one. Of several, a person must choose.
            detected_answers = [answer for answer in answers.values() if answer.found is not None]
            if len(detected_answers) == 1:
                self._first = detected_answers[0].found
                self._health.clear("port")
                return detected_answers[0].path
            self._health.warn("port", _choice_message(detected_answers, [*answers.values()]))
            await asyncio.sleep(SEARCH_STEP_S)

    def _on_change(self, problem: str) -> None:
        self._health.warn("port", problem)
        if problem:
            self._health.clear("silent")
            self._deliver(Disconnected(""))  # the reason is a warning already
            if not self._config.port:
                self._lost.set()

    def _read_port(self, port: serial.Serial, stopping: threading.Event) -> None:
        """Read until requested to stop; runs in the port's thread."""
        self._post(Reconnected())
        self._detection = detection = Detection(self._config, self._first, self._sensors)
        self._port = port
        watch = SilenceWatch(self._name, self._config.timeout_s, time.monotonic())
        detected: DetectedSensor | None = None
        command_s = 0.0
        try:
            while not stopping.is_set():
                # Follow the speed that is tried, and send at once what a person waits for
                if port.baudrate != detection.baud:
                    set_speed(port, detection.baud)
                while self._urgent:
                    port.write(self._urgent.popleft())

                # A read ends after the port's timeout, so that commands are not held up
                data = port.read(max(1, port.in_waiting))
                now_s = time.monotonic()
                for item in detection.feed(data, self._clock.now_ns(), now_s):
                    self._post(item)
                if detection.found != detected:
                    detected = detection.found
                    self._on_detected(detected)

                # Configure the device step by step, and report what is unreadable
                framer = detection.framer
                if framer is not None:
                    if framer.commands and now_s > command_s:
                        command_s = now_s + COMMAND_PAUSE_S
                        self._send_command(port, framer)
                    self._watch_bad(framer, now_s)

                # Report silence. Bytes without sense may be those of another format.
                change = watch.step(data, now_s, detection)
                if change is not None:
                    self._thread.post(self._health.warn, "silent", change)
                    if change and watch.received_bytes:
                        detection.forget()
        finally:
            self._port = None

    def _on_detected(self, sensor: DetectedSensor | None) -> None:
        if sensor is not None and sensor != self._first:
            log.info("%s: %s", self._name, sensor)
        self._first = sensor or self._first
        self._thread.post(self._set_port_metrics, sensor)

    def _set_port_metrics(self, sensor: DetectedSensor | None) -> None:
        for label in DetectedSensor.labels():
            baud: float | None = None
            if sensor is not None and sensor.label == label:
                baud = float(sensor.baud)
            self._health.set_metric(f"port of {label}", baud, "baud")

    def _send_command(self, port: serial.Serial, framer: SerialFramer) -> None:
        port.write(framer.commands.popleft())
        if framer.notice and not framer.commands:
            log.info("%s: the device was %s", self._name, framer.notice)
            framer.notice = ""

    def _post(self, item: Item) -> None:
        """Pass `item` to the event loop for delivery; runs in the port's thread."""
        self._ready.append(item)
        if not self._awake:
            self._awake = True
            self._thread.post(self._deliver_items)

    def _deliver_items(self) -> None:
        self._awake = False  # first: later items wake the loop again
        while self._ready:
            self._deliver(self._ready.popleft())

    def _watch_bad(self, framer: SerialFramer, now_s: float) -> None:
        if self._sensors.warning != self._others:
            self._others = self._sensors.warning
            self._thread.post(self._health.warn, "sensors", self._others)
        if framer.bad:
            self.bad_lines += framer.bad
            framer.bad = 0
            self._bad_s = now_s
            if self._bad_reported:  # limits calls while much garbage arrives
                self._bad_reported = False
                self._thread.post(self._warn_bad, framer.UNIT, framer.reason, framer.HINT)
        if self._bad_s is not None and now_s - self._bad_s > CLEAR_BAD_AFTER_S:
            self._bad_s = None
            self._thread.post(self._health.clear, "lines")

    def _warn_bad(self, unit: str, reason: str, hint: str) -> None:
        self._bad_reported = True
        self._health.warn(
            "lines",
            f"{self.bad_lines} {unit} from {self._name} could not be read, the last: {reason}; {hint}",
        )


def _choice_message(detected: list[PortAnswer], answers: list[PortAnswer]) -> str:
    if detected:
        example = f"--imu serial:{detected[0].path}"
        return f"{len(detected)} serial ports answer: {several(detected)}; name one, as in {example}"
    return f"no serial port answers: plug the wrist in, or name its port; ports found: {several(answers)}"


SERIAL = ImuSource(
    summary="a device on a serial port: lines of text, WitMotion, BNO085 (UART-RVC) or x-IMU3",
    config=SerialConfig,
    make=lambda config, around: SerialSource(config, around.clock, around.health),
    argument="port",
    argument_optional=True,
    discover=discover,
)
