"""A serial wrist over pseudo-terminals: port, speed and format found, cues; errors and threads of ports."""

import asyncio
import contextlib
import errno
import os
import random
import subprocess
import termios
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial
from serial import Serial
from serial.tools import list_ports

from pointit.geometry import rotation
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.host.serial_port import (
    PortSettings,
    SerialPort,
    SerialThread,
    describe_error,
    is_open_in_another_process,
    open_port,
)
from pointit.schemas import Feedback
from pointit.services.imu_bridge.serial import source as serial_source
from pointit.services.imu_bridge.serial.detection import SerialConfig
from pointit.services.imu_bridge.serial.source import SERIAL, ask_ports, discover, set_speed
from pointit.services.imu_bridge.sources import Disconnected, Reading, Reconnected
from pointit_lab.devices.serial_formats import (
    bno085_orientation,
    witmotion_packet,
    witmotion_quaternion,
    ximu3_text,
)
from tests.support.bench import repeated, until
from tests.support.pty_device import PtyDevice, pty_device
from tests.support.running_source import running

pytestmark = pytest.mark.wall_time
POSTURE = rotation.from_azimuth_elevation(0.7, -0.3)
LINE = b"1,0,0,0\n"
PERIOD_S = 0.01
"""Period of a device's packets, s."""


class FreshWitMotion:
    """A WT901 as it is sold: 9600 baud, no quaternions."""

    def __init__(self, device: PtyDevice) -> None:
        self._device = device
        self._noise = random.Random(1)
        self._sends_both = self._sends_quaternions = False
        self.received = bytearray()

    def step(self) -> None:
        self.received += self._device.receive(0)
        if termios.tcgetattr(self._device.master)[5] != termios.B9600:
            self._device.send(self._noise.randbytes(44))
            return
        self._sends_both = bytes.fromhex("ff aa 02 08 02") in self.received
        self._sends_quaternions = bytes.fromhex("ff aa 02 00 02") in self.received
        if not self._sends_quaternions:
            for kind in (0x53,) if self._sends_both else (0x51, 0x52, 0x53, 0x54):
                self._device.send(witmotion_packet(kind, 0, 0, 0, 0))
        if self._sends_both or self._sends_quaternions:
            self._device.send(witmotion_quaternion(POSTURE))


async def test_device_as_sold_is_found_and_switched_to_quaternions(tmp_path: Path) -> None:
    with pty_device(tmp_path / "imu") as device:
        wrist = FreshWitMotion(device)
        async with running(SERIAL, port=str(device.path)) as run, repeated(PERIOD_S, wrist.step):
            await until(lambda: wrist.received.endswith(bytes.fromhex("ff aa 03 08 00")))
            assert run.metrics == {"port of WitMotion": 9600.0}
            run.items.clear()
            await until(lambda: len(run.of(Reading)) > 5)
            assert run.of(Reading)[-1].world_from_sensor == pytest.approx(POSTURE, abs=1e-3)
            assert not run.warnings


async def test_changed_format_is_recognized_after_the_time_limit(tmp_path: Path) -> None:
    with pty_device(tmp_path / "imu") as device:
        packets = [LINE]
        async with (
            running(SERIAL, port=str(device.path), timeout_s=0.2) as run,
            repeated(PERIOD_S, lambda: device.send(packets[-1])),
        ):
            await until(lambda: "port of lines of text" in run.metrics)
            packets.append(bno085_orientation(POSTURE))
            await until(lambda: "port of BNO085 (UART-RVC)" in run.metrics)
            await until(lambda: "silent" not in run.warnings)
            assert [type(item) for item in run.items].count(Reconnected) == 1


async def test_forced_format_is_kept_and_named_in_the_warning(tmp_path: Path) -> None:
    with pty_device(tmp_path / "imu") as device:
        async with (
            running(SERIAL, port=str(device.path), timeout_s=0.2, format="witmotion", baud=57600) as run,
            repeated(PERIOD_S, lambda: device.send(LINE)),
        ):
            await until(lambda: "tried WitMotion at 57600 baud" in run.warnings.get("silent", ""))
            assert termios.tcgetattr(device.master)[5] == termios.B57600
            assert not run.of(Reading)


async def test_cue_flashes_the_led_of_an_ximu3(tmp_path: Path) -> None:
    with pty_device(tmp_path / "imu") as device:
        received = bytearray()

        def step() -> None:
            device.send(ximu3_text("Q", 1, 1, 0, 0, 0))
            received.extend(device.receive(0))

        async with running(SERIAL, port=str(device.path)) as run:
            cue = Feedback(stamp_ns=0, seq=1, cue="selected", color=(0, 255, 0))
            run.source.cue(cue)  # not connected yet: dropped
            async with repeated(PERIOD_S, step):
                await until(lambda: bool(run.of(Reading)))
                run.source.cue(cue)
                await until(lambda: bytes(received) == b'{"colour":"00FF00"}\n{"colour":null}\n')


def terminal(device: PtyDevice) -> str:
    """Return the path of the device without links."""
    return os.path.realpath(device.path)


def present(monkeypatch: pytest.MonkeyPatch, *devices: PtyDevice) -> None:
    """Have the machine's serial ports be `devices`."""
    ports = [SimpleNamespace(device=terminal(each), description="UART") for each in devices]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    monkeypatch.setattr(serial_source, "SEARCH_S", (0.3, 0.3))
    monkeypatch.setattr(serial_source, "SEARCH_PAUSE_S", (0.05, 0.05))
    monkeypatch.setattr(serial_source, "SEARCH_STEP_S", 0.05)


async def test_answering_port_is_used_when_none_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pty_device(tmp_path / "one") as silent, pty_device(tmp_path / "two") as wrist:
        present(monkeypatch, silent, wrist)
        async with running(SERIAL, port="") as run:
            await until(lambda: "no serial port answers" in run.warnings.get("port", ""))
            async with repeated(PERIOD_S, lambda: wrist.send(LINE)):
                await until(lambda: bool(run.of(Reading)))
            assert not run.warnings


async def test_wrist_is_found_at_another_port_when_none_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pty_device(tmp_path / "one") as first, pty_device(tmp_path / "two") as second:
        present(monkeypatch, first)
        async with running(SERIAL, port="") as run:
            async with repeated(PERIOD_S, lambda: first.send(LINE)):
                await until(lambda: bool(run.of(Reading)))
            present(monkeypatch, second)
            first.unplug()
            await until(lambda: any(isinstance(item, Disconnected) for item in run.items))
            run.items.clear()
            async with repeated(PERIOD_S, lambda: second.send(LINE)):
                await until(lambda: bool(run.of(Reading)))
            assert not run.warnings


async def test_silent_port_is_released_while_a_new_one_is_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []

    def opening(settings: PortSettings) -> Serial:
        opened.append(settings.port)
        return open_port(settings)

    with pty_device(tmp_path / "one") as silent, pty_device(tmp_path / "two") as wrist:
        present(monkeypatch, silent)
        monkeypatch.setattr(serial_source, "SEARCH_PAUSE_S", (600.0, 600.0))
        monkeypatch.setattr(serial_source, "open_port", opening)
        async with repeated(PERIOD_S, lambda: wrist.send(LINE)), running(SERIAL, port="") as run:
            await until(lambda: "no serial port answers" in run.warnings.get("port", ""))
            with open_port(PortSettings(port=terminal(silent), baud=9600)):
                present(monkeypatch, silent, wrist)
                monkeypatch.setattr(serial_source, "SEARCH_PAUSE_S", (600.0, 600.0))
                await until(lambda: bool(run.of(Reading)))
        assert opened.count(terminal(silent)) == 1


def test_port_lost_while_its_speed_changes_is_an_os_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(_port: Serial) -> None:
        raise termios.error(errno.EIO, "Input/output error")

    monkeypatch.setattr(Serial, "reset_input_buffer", gone)
    with pty_device(tmp_path / "one") as device:
        port = Serial(terminal(device))
        with contextlib.closing(port), pytest.raises(OSError, match="Input/output error"):
            set_speed(port, 115200)


async def test_ports_are_named_when_several_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pty_device(tmp_path / "one") as first, pty_device(tmp_path / "two") as second:
        present(monkeypatch, first, second)

        def step() -> None:
            first.send(LINE)
            second.send(bno085_orientation(POSTURE))

        async with repeated(PERIOD_S, step), running(SERIAL, port="") as run:
            await until(lambda: "2 serial ports answer" in run.warnings.get("port", ""))
            said = run.warnings["port"]
            for device in (first, second):
                assert terminal(device) in said
            assert "--imu serial:/dev/" in said


async def test_search_lists_all_ports_and_opens_none_of_other_programs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        pty_device(tmp_path / "wrist") as wrist,
        pty_device(tmp_path / "silent") as silent,
        pty_device(tmp_path / "held") as held,
    ):
        present(monkeypatch, wrist, silent, held)
        with (tmp_path / "held").open("rb") as port:
            holder = subprocess.Popen(["sleep", "600"], stdin=port)  # noqa: ASYNC220, S607
        try:
            assert is_open_in_another_process(str(held.path))
            assert not is_open_in_another_process(str(silent.path))

            def step() -> None:
                wrist.send(LINE)
                held.send(LINE)

            details: object = {}
            found: dict[str, FoundDevice] = {}
            async with repeated(PERIOD_S, step):
                while not details:  # on a busy machine, one search may be too short
                    found = {device.address: device for device in await discover(0.3)}
                    details = found[terminal(wrist)].details
        finally:
            holder.kill()
            holder.wait()

        assert {address: device.label for address, device in found.items()} == {
            terminal(wrist): "UART: lines of text at 115200 baud",
            terminal(silent): "UART: silent",
            terminal(held): "UART: another program has it open",
        }
        assert details == {"format": "text", "baud": 115200}


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
def test_port_errors_state_their_remedy(error: OSError, words: str) -> None:
    said = describe_error(error, "/dev/ttyUSB7")
    assert said.startswith("/dev/ttyUSB7 ")
    assert words in said


def test_file_that_is_no_serial_port_is_reported(tmp_path: Path) -> None:
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
def test_other_errors_of_pyserial_are_errors_of_the_port(
    monkeypatch: pytest.MonkeyPatch, error: Exception, words: str
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(OSError, match=r".") as caught:
        open_port(PortSettings(port="x", baud=9600))
    assert words in describe_error(caught.value, "x")


def test_missing_port_error_lists_the_ports_found(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [
        SimpleNamespace(device="/dev/ttyUSB1", description="CP2102"),
        SimpleNamespace(device="/dev/ttyS0", description="n/a"),
        SimpleNamespace(device="/dev/ttyACM0", description="Feather"),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    said = describe_error(FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT)), "/dev/x")
    assert said.endswith("ports found: /dev/ttyACM0 (Feather), /dev/ttyUSB1 (CP2102)")


async def test_error_of_the_work_is_raised_and_not_retried(tmp_path: Path) -> None:
    def work(_port: serial.Serial, _stopping: threading.Event) -> None:
        raise ZeroDivisionError

    with pty_device(tmp_path / "port") as device:
        running = SerialThread(PortSettings(port=str(device.path), baud=9600), work, lambda _why: None)
        with pytest.raises(ZeroDivisionError):
            await running.run()


async def test_port_that_fails_at_once_is_opened_less_often(tmp_path: Path) -> None:
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
