"""A MetaMotion over a complete Bluetooth stack that is not ours, in virtual time."""

import asyncio
import itertools
import logging
from collections.abc import Callable, Sequence
from typing import Any, Literal

import pytest
from bleak.exc import BleakError

from pointit.plugins import Quaternion
from pointit.runtime.virtual_time import run_virtually
from pointit.schemas import Feedback
from pointit.services.imu_bridge.ble.ble_source import SHORT_S
from pointit.services.imu_bridge.ble.metamotion import METAMOTION, MetaMotion
from pointit.services.imu_bridge.sources import Battery, Disconnected, Press, Reading, Reconnected, Signal
from pointit.testing.imu import is_near
from pointit_lab.devices.wrists.metamotion import SimulatedMetaMotion
from tests.devices.ble_session import POSTURE, Session, require_selection, worn
from tests.devices.bumble_radio import BumbleClient
from tests.devices.bumble_wrist import BumbleWrist
from tests.support.bench import in_virtual_time

HARDWARE_START = [
    *("19020213", "0303280c", "13032800", "190701", "03020100", "13020100"),
    *("030101", "130101", "19030800", "190101"),
]
"""Commands of a board with a BMI160, as in the maker's tests."""
FAST_INTERVAL = "1109060006000000" + "5802"


def second_serial_number(_wrists: Sequence[BumbleWrist]) -> str:
    return "05e1f3"


def second_address(wrists: Sequence[BumbleWrist]) -> str:
    return wrists[1].address.lower()


async def send_button(session: Session, *changes: tuple[float, bool]) -> None:
    """Press the button: pauses, s, each with the state after it."""
    board = session.wrist.wrist
    assert isinstance(board, SimulatedMetaMotion)
    for pause_s, is_down in changes:
        await asyncio.sleep(pause_s)
        for answer in board.button(is_down=is_down):
            await session.wrist.send(*answer)


@pytest.mark.parametrize("chip", ["BMI160", "BMI270"])
@pytest.mark.parametrize("magnetometer", [False, True])
@in_virtual_time
async def test_configured_board_delivers_100_quaternions_per_second_and_its_battery(
    chip: Literal["BMI160", "BMI270"], *, magnetometer: bool
) -> None:
    async with worn(
        METAMOTION, SimulatedMetaMotion(chip), parameters={"magnetometer": magnetometer}
    ) as session:
        await session.until(lambda: len(session.of(Reading)) >= 500)
        times_s = session.times_s(Reading)
        assert times_s[-1] - times_s[0] == pytest.approx(4.99, abs=0.05)
        assert max(b - a for a, b in itertools.pairwise(times_s)) < 0.03
        assert all(is_near(each.world_from_sensor, POSTURE) for each in session.of(Reading))
        assert session.items[0][1] == Reconnected(keeps_yaw=False)
        assert session.of(Battery) == [Battery(0.99, 4.148)]
        assert session.of(Signal)
        assert not session.health.all


@in_virtual_time
async def test_leftovers_are_removed_first_and_a_fast_connection_is_requested() -> None:
    board = SimulatedMetaMotion()
    async with worn(METAMOTION, board) as session:
        await session.until(lambda: bool(session.of(Reading)))
        commands = [each.hex() for each in board.commands]
        begun = commands.index(HARDWARE_START[0])
        assert commands[begun : begun + len(HARDWARE_START)] == HARDWARE_START
        assert {"0908", "0a05", "0b0a", "190100"} <= set(commands[:begun])
        assert FAST_INTERVAL in commands


@in_virtual_time
async def test_changes_of_the_button_become_gestures() -> None:
    async with worn(METAMOTION, SimulatedMetaMotion()) as session:
        await session.until(lambda: bool(session.of(Reading)))
        await send_button(session, (0.0, True), (0.1, False), (0.5, True), (1.0, False))
        await asyncio.sleep(1.0)
        assert [each.gesture for each in session.of(Press)] == ["press", "hold"]


@in_virtual_time
async def test_cue_drives_motor_and_led_until_a_newer_cue_starts() -> None:
    board = SimulatedMetaMotion()
    loop = asyncio.get_running_loop()
    async with worn(METAMOTION, board) as session:
        await session.until(lambda: bool(session.of(Reading)))
        board.commands.clear()
        asked_s = loop.time()
        session.source.cue(
            Feedback(stamp_ns=1, seq=1, cue="selected", haptic_ms=(150, 100, 50), color=(255, 0, 0))
        )
        await session.until(lambda: len(board.commands) >= 4)
        assert loop.time() - asked_s <= 0.05
        assert [each.hex() for each in board.commands] == [
            "0801f8960000",
            "020201",
            "020301021f00000" + "02c010000" + "2c010000" + "01",
            "020101",
        ]
        await session.until(lambda: len(board.commands) >= 5)
        assert board.commands[4].hex() == "0801f8320000"
        assert loop.time() - asked_s == pytest.approx(0.25, abs=0.03)

        board.commands.clear()
        session.source.cue(Feedback(stamp_ns=1, seq=2, cue="target", haptic_ms=(50, 400, 50)))
        await asyncio.sleep(0.1)
        session.source.cue(Feedback(stamp_ns=1, seq=3, cue="target", haptic_ms=(70,)))
        await asyncio.sleep(1.0)
        assert [each.hex() for each in board.commands] == ["0801f8320000", "0801f8460000"]


@in_virtual_time
async def test_failed_cue_is_logged_and_the_next_one_is_played(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "pointit.services.imu_bridge.ble.ble_source")

    async def fail(*_: object) -> None:
        raise BleakError("out of reach")

    board = SimulatedMetaMotion()
    async with worn(METAMOTION, board) as session:
        await session.until(lambda: bool(session.of(Reading)))
        board.commands.clear()
        with monkeypatch.context() as broken:
            broken.setattr(MetaMotion, "play", fail)
            session.source.cue(Feedback(stamp_ns=1, seq=1, cue="target", haptic_ms=(50,)))
            await session.until(lambda: "cannot play a cue: Bluetooth failed" in caplog.text)
        session.source.cue(Feedback(stamp_ns=1, seq=2, cue="target", haptic_ms=(70,)))
        await session.until(lambda: [each.hex() for each in board.commands] == ["0801f8460000"])


@pytest.mark.parametrize("is_restarted", [False, True])
@in_virtual_time
async def test_lost_board_reconnects_and_keeps_its_yaw_unless_restarted(*, is_restarted: bool) -> None:
    board = SimulatedMetaMotion()
    async with worn(METAMOTION, board) as session:
        await session.until(lambda: len(session.of(Reading)) > 10)
        await session.wrist.vanish()
        await session.until(lambda: bool(session.of(Disconnected)))

        address = session.wrist.address
        (lost,) = session.of(Disconnected)
        assert lost.reason.startswith(f"MetaMotion {address} has lost the connection: bring it near")
        assert not session.health.warnings  # of `Disconnected`, imu-bridge makes a warning

        await asyncio.sleep(30.0)
        assert "no MetaMotion is heard; searching" in session.health.warnings["link"]
        if is_restarted:
            board.restart()
        board.commands.clear()
        count = len(session.of(Reading))
        await session.wrist.appear()
        await session.until(lambda: len(session.of(Reading)) > count)
        assert session.of(Reconnected)[1:] == [Reconnected(keeps_yaw=not is_restarted)]
        assert FAST_INTERVAL in [each.hex() for each in board.commands]
        assert not session.health.warnings


@in_virtual_time
async def test_board_keeps_its_yaw_over_attempts_to_connect_that_fail(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    connect = BumbleClient.connect
    failures = iter([BleakError("le-connection-abort-by-local"), TimeoutError()])

    async def connect_at_the_edge_of_reach(client: BumbleClient, *arguments: Any, **options: Any) -> None:
        if (failure := next(failures, None)) is not None:
            raise failure
        await connect(client, *arguments, **options)

    async with worn(METAMOTION, SimulatedMetaMotion()) as session:
        await session.until(lambda: bool(session.of(Reading)))
        monkeypatch.setattr(BumbleClient, "connect", connect_at_the_edge_of_reach)
        await session.wrist.vanish()
        await session.wrist.appear()
        await session.until(lambda: len(session.of(Reconnected)) > 1)
        assert next(failures, None) is None
        assert session.of(Reconnected)[1:] == [Reconnected(keeps_yaw=True)]


@in_virtual_time
async def test_silent_board_is_configured_again_and_then_reset(monkeypatch: pytest.MonkeyPatch) -> None:
    write = BumbleClient.write_gatt_char

    async def write_slowly(client: BumbleClient, *arguments: Any) -> None:
        await write(client, *arguments)
        await asyncio.sleep(0.02)

    monkeypatch.setattr(BumbleClient, "write_gatt_char", write_slowly)
    board = SimulatedMetaMotion()
    async with worn(METAMOTION, board) as session:
        await session.until(lambda: bool(session.of(Reading)))
        board.restart()
        count = len(session.of(Reading))
        await session.until(lambda: len(session.of(Reading)) > count)
        assert session.health.all == ["MetaMotion is connected but silent; it is configured again"]
        assert not session.health.warnings
        assert (board.resets, session.wrist.connections) == (0, 1)
        assert session.of(Reconnected) == [Reconnected(keeps_yaw=False)] * 2

        (again,) = [at for at, (_, item) in enumerate(session.items) if isinstance(item, Reconnected)][1:]
        assert sum(isinstance(item, Reading) for _, item in session.items[:again]) == count
        board.restart()
        board.wants_reset = True
        count = len(session.of(Reading))
        await session.until(lambda: len(session.of(Reading)) > count)
        assert (board.resets, session.wrist.connections) == (1, 2)

        (lost,) = session.of(Disconnected)
        assert "is connected but is still silent, and was reset; searching again" in lost.reason
        assert session.of(Reconnected)[-1] == Reconnected(keeps_yaw=False)


class ZeroingMetaMotion(SimulatedMetaMotion):
    """A board whose fusion sends zeros until it is reset."""

    def frame(self, orientation_xyzw: Quaternion) -> bytes:
        return super().frame(orientation_xyzw if self.resets else (0.0, 0.0, 0.0, 0.0))


@in_virtual_time
async def test_board_that_sends_zeros_is_named_and_reset() -> None:
    async with worn(METAMOTION, ZeroingMetaMotion()) as session:
        await session.until(lambda: bool(session.of(Reading)))
        (configured,) = session.health.all
        assert "is connected but without readings in " in configured
        (lost,) = session.of(Disconnected)
        assert "notifications, and was reset" in lost.reason
        assert not session.health.warnings


@in_virtual_time
async def test_board_dropping_each_connection_is_named_and_not_hammered() -> None:
    async with worn(METAMOTION, SimulatedMetaMotion()) as session:
        await session.until(lambda: bool(session.of(Reading)))
        session.wrist.drops_at_once = True
        await session.wrist.vanish()
        await session.wrist.appear()
        before = session.wrist.connections
        await asyncio.sleep(60.0)
        assert 3 <= session.wrist.connections - before <= 20
        assert "times now; searching again" in session.health.warnings["link"]
        session.wrist.drops_at_once = False
        count = len(session.of(Reading))
        await session.until(lambda: len(session.of(Reading)) > count)
        await asyncio.sleep(SHORT_S)
        assert not session.health.warnings


@pytest.mark.parametrize("wanted", [second_serial_number, second_address])
@in_virtual_time
async def test_wrist_is_chosen_among_several(wanted: Callable[[Sequence[BumbleWrist]], str]) -> None:
    boards = SimulatedMetaMotion(serial_number="05E1F2"), SimulatedMetaMotion(serial_number="05E1F3")
    async with worn(METAMOTION, *boards, parameters={"sensor": wanted}) as session:
        await session.until(lambda: bool(session.of(Reading)))
        assert [each.is_connected for each in session.wrists] == [False, True]
        assert not boards[0].commands


@in_virtual_time
async def test_first_of_same_named_boards_stays_used_and_all_are_named() -> None:
    async with worn(METAMOTION, SimulatedMetaMotion(), SimulatedMetaMotion()) as session:
        await session.until(lambda: bool(session.of(Reading)))
        (used,) = [each for each in session.wrists if each.is_connected]
        (other,) = [each for each in session.wrists if each is not used]
        warning = session.health.warnings["sensors"]
        assert f"MetaWear ({used.address}, " in warning
        assert f"not MetaWear ({other.address}, " in warning
        assert "--set imu-bridge.metamotion.sensor=ADDRESS" in warning
        await used.vanish()
        await session.until(
            lambda: f"{used.address.lower()} is not heard" in session.health.warnings.get("link", "")
        )
        assert not other.is_connected
        assert len(session.of(Reconnected)) == 1


@in_virtual_time
async def test_board_is_stopped_and_disconnected_at_the_end() -> None:
    board = SimulatedMetaMotion()
    async with worn(METAMOTION, board) as session:
        await session.until(lambda: bool(session.of(Reading)))
        await session.end()
        assert not board.is_streaming
        assert not session.wrist.is_connected


def test_person_with_a_metamotion_selects_red_segments_and_feels_it() -> None:
    board = SimulatedMetaMotion()
    run_virtually(require_selection("metamotion", board))
    assert any(command.startswith(b"\x08\x01") for command in board.commands)
