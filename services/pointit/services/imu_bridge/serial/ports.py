"""Serial ports of this machine, asked for what answers on them."""

import asyncio
import errno
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import serial

from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.host.serial_port import (
    PortSettings,
    SerialPort,
    describe_error,
    is_open_in_another_process,
    open_port,
    serial_ports,
)
from pointit.services.imu_bridge.serial.config import SerialConfig
from pointit.services.imu_bridge.serial.detection import DetectedSensor, Detection

NOTHING_S = 4.0
"""Time after which a port that sends nothing is released, s. Some boards need 2 s to start."""


@dataclass(frozen=True)
class PortAnswer:
    """A port, and what answers on it."""

    path: str
    description: str
    found: DetectedSensor | None
    problem: str
    """Reason why nothing was recognized, or `""`."""

    def __str__(self) -> str:
        return f"{self.path} ({self.description}): {self.found or self.problem}"


async def ask_ports(ports: Iterable[SerialPort], config: SerialConfig, duration_s: float) -> list[PortAnswer]:
    """Listen on those `ports` that nobody else has open, side by side. Return what answers on each.

    Nothing is sent, but opening its port restarts some boards.
    """
    stopping = threading.Event()
    try:
        return await asyncio.gather(
            *(asyncio.to_thread(_ask, port, config, duration_s, stopping) for port in ports)
        )
    finally:
        stopping.set()


async def discover(duration_s: float) -> Sequence[FoundDevice]:
    """Return all serial ports, each with what answers on it."""
    return [
        FoundDevice(
            address=answer.path,
            label=f"{answer.description}: {answer.found or answer.problem}",
            details={"format": answer.found.format, "baud": answer.found.baud} if answer.found else {},
        )
        for answer in await ask_ports(await asyncio.to_thread(serial_ports), SerialConfig(), duration_s)
    ]


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


def _ask(port: SerialPort, config: SerialConfig, duration_s: float, stopping: threading.Event) -> PortAnswer:
    if is_open_in_another_process(port.path):
        return PortAnswer(port.path, port.description, None, "another program has it open")
    detection = Detection(config)
    count = 0
    try:
        with open_port(PortSettings(port=port.path, baud=detection.baud)) as opened:
            begin_s = time.monotonic()
            while not stopping.is_set() and time.monotonic() - begin_s < (
                duration_s if count else min(duration_s, NOTHING_S)
            ):
                if opened.baudrate != detection.baud:
                    set_speed(opened, detection.baud)
                data = opened.read(max(1, opened.in_waiting))
                count += len(data)
                detection.feed(data, 0, time.monotonic())
                if detection.found is not None and detection.good:
                    return PortAnswer(port.path, port.description, detection.found, "")
    except OSError as error:
        return PortAnswer(port.path, port.description, None, describe_error(error, port.path))
    problem = f"{count} bytes, none readable" if count else "silent"
    return PortAnswer(port.path, port.description, None, problem)
