"""Messages of serial errors, and start and end of a port's thread."""

import asyncio
import errno
import os
import termios
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial
from serial.tools import list_ports

from pointit.runtime.host.serial_port import PortSettings, SerialPort, SerialThread, describe_error, open_port
from pointit.services.imu_bridge.serial.detection import SerialConfig
from pointit.services.imu_bridge.serial.source import ask_ports
from tests.support.bench import repeated, until
from tests.support.pty_device import pty_device

pytestmark = pytest.mark.wall_time


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (serial.SerialException(errno.ENOENT, "could not open port"), "plug the device in; ports found:"),
        (serial.SerialException(errno.EACCES, "could not open port"), "dialout"),
        (PermissionError(errno.EACCES, "denied"), "uucp"),
        (serial.SerialException(errno.EAGAIN, "Could not exclusively lock port"), "held by another program"),
        (OSError(errno.EBUSY, "busy"), "held by another program"),
        (OSError(errno.EIO, "Input/output error"), "went away"),
        (serial.SerialException("device reports readiness to read but returned no data"), "went away"),
        (serial.SerialTimeoutException("Write timeout"), "takes no more data"),
        (serial.SerialException("strange"), "failed (strange)"),
    ],
)
def test_each_error_says_what_to_do(error: OSError, words: str) -> None:
    said = describe_error(error, "/dev/ttyUSB7")
    assert said.startswith("/dev/ttyUSB7 ")
    assert words in said


def test_what_is_no_serial_port_is_said(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("")
    with pytest.raises(OSError, match=r".") as caught:
        open_port(PortSettings(port=str(path), baud=9600))
    assert "is not a serial port" in describe_error(caught.value, str(path))


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (termios.error(errno.EIO, "Input/output error"), "went away"),
        (ValueError("Failed to set custom baud rate"), "does not do this baud rate"),
    ],
)
def test_what_pyserial_raises_otherwise_is_an_error_of_the_port_too(
    monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(OSError, match=r".") as caught:
        open_port(PortSettings(port="x", baud=9600))
    assert words in describe_error(caught.value, "x")


def test_the_ports_there_are_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [
        SimpleNamespace(device="/dev/ttyUSB1", description="CP2102"),
        SimpleNamespace(device="/dev/ttyS0", description="n/a"),
        SimpleNamespace(device="/dev/ttyACM0", description="Feather"),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    said = describe_error(FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT)), "/dev/x")
    assert said.endswith("ports found: /dev/ttyACM0 (Feather), /dev/ttyUSB1 (CP2102)")


async def test_a_fault_of_the_work_is_raised_and_not_retried(tmp_path: Path) -> None:
    def work(_port: serial.Serial, _stopping: threading.Event) -> None:
        raise ZeroDivisionError

    with pty_device(tmp_path / "port") as device:
        running = SerialThread(PortSettings(port=str(device.path), baud=9600), work, lambda _why: None)
        with pytest.raises(ZeroDivisionError):
            await running.run()


async def test_a_port_that_opens_and_fails_at_once_is_not_hammered(tmp_path: Path) -> None:
    opened: list[float] = []

    def work(_port: serial.Serial, _stopping: threading.Event) -> None:
        opened.append(loop.time())
        raise OSError(errno.EIO, "gone")

    loop = asyncio.get_running_loop()
    reasons: list[str] = []
    with pty_device(tmp_path / "port") as device:
        thread = SerialThread(PortSettings(port=str(device.path), baud=9600), work, reasons.append)
        running = asyncio.create_task(thread.run())
        await until(lambda: len(opened) == 3)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    assert opened[1] - opened[0] >= 0.2
    assert opened[2] - opened[1] >= 0.4
    assert reasons[:2] == ["", f"{device.path} went away: plug the device in again"]
    assert not any(thread.name.startswith("serial ") for thread in threading.enumerate())


async def test_search_of_ports_names_the_line_that_is_not_read(tmp_path: Path) -> None:
    with pty_device(tmp_path / "imu") as device:
        async with repeated(0.02, lambda: device.send(b"3,0.6,0.64,0,-0.48\n")):
            (answer,) = await ask_ports([SerialPort(str(device.path), "a board")], SerialConfig(), 1.0)
    assert answer.found is None
    assert 'describe it by imu-bridge.serial.line="{_},{_},{_},{_},{_}"' in answer.problem
