"""A watch with the Touch SDK over a complete Bluetooth stack that is not ours, in virtual time."""

import asyncio
import itertools
import math
import struct
from collections.abc import Sequence
from dataclasses import replace

import pytest
from bleak.exc import BleakError
from bumble.att import ATT_Error

from pointit.geometry import rotation
from pointit.plugins import Surroundings
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import Feedback
from pointit.services.imu_bridge.arm_frame import MOUNTINGS
from pointit.services.imu_bridge.ble.ble_source import discover_ble
from pointit.services.imu_bridge.ble.touch_sdk import DECLINED_S, ENDED_S, TOUCH_SDK, TouchSdkWatch
from pointit.services.imu_bridge.ble.touch_sdk_messages import OUTPUT
from pointit.services.imu_bridge.sources import (
    Battery,
    Disconnected,
    Press,
    RawReading,
    Reading,
    Reconnected,
    StepGesture,
)
from pointit.testing.imu import is_near
from pointit_lab.devices.wrists.touch_sdk_watch import DISCONNECT, PERIOD_MS, SimulatedTouchSdkWatch
from tests.devices.ble_session import POSTURE, Session, worn
from tests.devices.bumble_radio import BumbleClient, air
from tests.support.bench import background, in_virtual_time, until

RATE_HZ = 50.0
PINCH = bytes.fromhex("12020801")
CLOCKWISE = bytes.fromhex("2a0b08ffffffffffffffffff01")
"""The maker's client turns the sign: the watch sends -1 for clockwise."""
COUNTERCLOCKWISE = bytes.fromhex("2a020801")
CONNECT_APPROVED = bytes.fromhex("320102")


def touch(kind: int, *places: tuple[float, float]) -> bytes:
    """Return a message of fingers on the screen, without a frame."""
    coordinates = b"".join(b"\x22\x0a" + struct.pack("<BfBf", 0x0D, x, 0x15, y) for x, y in places)
    content = bytes((0x08, kind)) + coordinates
    return bytes((0x1A, len(content))) + content


async def send(session: Session, *messages: bytes) -> None:
    for message in messages:
        await session.wrist.send(OUTPUT, message)
    await asyncio.sleep(0.2)


def watch_of(session: Session) -> SimulatedTouchSdkWatch:
    watch = session.wrist.wrist
    assert isinstance(watch, SimulatedTouchSdkWatch)
    return watch


@in_virtual_time
async def test_known_watch_streams_at_once_with_its_time_and_battery() -> None:
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ) as session:
        await session.until(lambda: len(session.of(Reading)) >= 100)
        readings = session.of(Reading)
        assert all(is_near(each.world_from_sensor, POSTURE) for each in readings)
        times_ns = [each.device_time_ns or 0 for each in readings]
        assert {b - a for a, b in itertools.pairwise(times_ns)} == {PERIOD_MS * 1_000_000}
        assert session.of(Battery) == [Battery(0.74)]
        assert session.of(Reconnected) == [Reconnected(keeps_yaw=False)]
        assert not session.health.all
        assert watch_of(session).inputs[0][:4] == b"\x12" + bytes(
            (len(watch_of(session).inputs[0]) - 2, 10, 7)
        )


@in_virtual_time
async def test_watch_waiting_for_approval_is_named_until_the_person_confirms() -> None:
    watch = SimulatedTouchSdkWatch("pending")
    async with worn(TOUCH_SDK, watch, rate_hz=RATE_HZ) as session:
        await session.until(lambda: "waits for approval" in session.health.warnings.get("link", ""))
        await asyncio.sleep(30.0)
        assert len(watch.inputs) == 1  # a second introduction would open a second dialog
        assert session.wrist.connections == 1
        watch.approve()
        await session.until(lambda: len(session.of(Reading)) > 10)
        assert not session.health.warnings
        await session.until(lambda: bool(session.of(Battery)))


@in_virtual_time
async def test_approval_without_a_frame_counts_as_no_long_silence() -> None:
    watch = SimulatedTouchSdkWatch("pending")
    async with worn(TOUCH_SDK, watch, rate_hz=RATE_HZ) as session:
        await session.until(lambda: bool(session.health.warnings))
        await asyncio.sleep(40.0)
        await send(session, CONNECT_APPROVED)
        await asyncio.sleep(5.0)
        watch.approve()
        await session.until(lambda: len(session.of(Reading)) > 10)
        assert session.wrist.connections == 1


@in_virtual_time
async def test_connection_that_is_never_approved_is_closed_and_made_again() -> None:
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch("pending"), rate_hz=RATE_HZ) as session:
        await asyncio.sleep(50.0)
        assert not session.of(Disconnected)
        await session.until(lambda: session.wrist.connections == 2)
        assert "waits for approval" in session.of(Disconnected)[0].reason


@in_virtual_time
async def test_introduction_whose_write_fails_has_arrived_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write = SimulatedTouchSdkWatch.write

    def write_and_fail(
        watch: SimulatedTouchSdkWatch, characteristic: str, data: bytes
    ) -> Sequence[tuple[str, bytes]]:
        assert not [*write(watch, characteristic, data)]
        raise ATT_Error(0x01)

    monkeypatch.setattr(SimulatedTouchSdkWatch, "write", write_and_fail)
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ) as session:
        await session.until(lambda: len(session.of(Reading)) > 10)
        assert session.wrist.connections == 1


@in_virtual_time
async def test_declined_connection_is_named_and_not_requested_again_soon() -> None:
    watch = SimulatedTouchSdkWatch("declined")
    async with worn(TOUCH_SDK, watch, rate_hz=RATE_HZ) as session:
        await session.until(lambda: bool(session.of(Disconnected)))
        (lost,) = session.of(Disconnected)
        assert f"{session.wrist.address} has declined the connection: confirm it" in lost.reason
        assert lost.reason.endswith("searching again after 60 s")
        await asyncio.sleep(DECLINED_S - 5.0)
        assert session.wrist.connections == 1
        watch.approval = "given"
        await session.until(lambda: len(session.of(Reading)) > 10)
        assert session.wrist.connections == 2


@in_virtual_time
async def test_app_that_ends_is_disconnected_and_found_after_its_restart() -> None:
    watch = SimulatedTouchSdkWatch()
    async with worn(TOUCH_SDK, watch, rate_hz=RATE_HZ) as session:
        await session.until(lambda: len(session.of(Reading)) > 10)
        await send(session, DISCONNECT)
        await session.until(lambda: bool(session.of(Disconnected)))
        assert "has ended the connection: its app was closed" in session.of(Disconnected)[0].reason
        assert not session.wrist.is_connected

        await session.wrist.vanish()
        watch.unix_ms += 60_000
        await asyncio.sleep(ENDED_S + 10.0)
        assert (
            "is not heard" in session.health.warnings["link"] or "no Touch" in session.health.warnings["link"]
        )

        count = len(session.of(Reading))
        await session.wrist.appear()
        await session.until(lambda: len(session.of(Reading)) > count + 10)
        assert session.of(Reconnected) == [Reconnected(keeps_yaw=False)] * 2
        assert not session.health.warnings


@in_virtual_time
async def test_sleeping_watch_is_named_and_wakes_with_another_yaw_origin() -> None:
    watch = SimulatedTouchSdkWatch()
    async with worn(TOUCH_SDK, watch, rate_hz=RATE_HZ) as session:
        await session.until(lambda: len(session.of(Reading)) > 10)
        watch.is_streaming = False
        await session.until(lambda: "battery optimisation" in session.health.warnings.get("link", ""))

        await asyncio.sleep(5.0)
        assert len(watch.inputs) == 1
        count = len(session.of(Reading))
        watch.is_streaming = True
        await session.until(lambda: len(session.of(Reading)) > count + 10)
        assert session.wrist.connections == 1
        assert session.of(Reconnected) == [Reconnected(keeps_yaw=False)] * 2
        assert not session.health.warnings

        watch.is_streaming = False
        await session.until(lambda: session.wrist.connections == 2)
        assert "battery optimisation" in session.of(Disconnected)[0].reason


@pytest.mark.parametrize("mtu", [23, 48, 70])
@in_virtual_time
async def test_connection_that_cuts_messages_is_named_with_the_remedy(mtu: int) -> None:
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ) as session:
        session.wrist.device.gatt_server.max_mtu = mtu
        await session.until(lambda: bool(session.of(Disconnected)))
        assert f"messages that are cut at {mtu - 3} bytes" in session.of(Disconnected)[0].reason
        assert "ExchangeMTU" in session.of(Disconnected)[0].reason
        assert not session.of(Reading)


@in_virtual_time
async def test_pinch_is_a_press_and_crown_and_swipe_are_steps() -> None:
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ) as session:
        await session.until(lambda: bool(session.of(Reading)))
        await send(session, PINCH, PINCH + PINCH, bytes.fromhex("12020802"), bytes.fromhex("1202080b"))
        assert [each.gesture for each in session.of(Press)] == ["press"] * 3
        await send(session, CLOCKWISE, COUNTERCLOCKWISE, CLOCKWISE + CLOCKWISE)
        assert [each.by for each in session.of(StepGesture)] == [1, -1, 1, 1]
        await send(session, touch(1, (300, 200)), touch(3, (200, 200)), touch(2, (60, 220)))
        await send(session, touch(1, (60, 200)), touch(2, (300, 200)))
        assert [each.by for each in session.of(StepGesture)[4:]] == [-1, 1]
        assert not session.health.all


@pytest.mark.parametrize(
    "touches",
    [
        [touch(1, (200, 200)), touch(2, (230, 200))],
        [touch(1, (200, 60)), touch(2, (300, 400))],
        [touch(1, (60, 200)), touch(4, (300, 200)), touch(2, (300, 200))],
        [touch(1, (60, 200)), touch(3, (100, 200), (150, 200)), touch(2, (300, 200))],
        [touch(2, (300, 200))],
        [touch(1), touch(2)],
        [touch(1, (math.nan, 200)), touch(2, (300, 200))],
        [touch(1, (60, 200)), touch(2)],
    ],
)
@in_virtual_time
async def test_touches_that_are_no_swipe_are_no_step(touches: Sequence[bytes]) -> None:
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ) as session:
        await session.until(lambda: bool(session.of(Reading)))
        await send(session, *touches)
        assert not session.of(StepGesture)


@in_virtual_time
async def test_crown_steps_by_the_set_sign_up_to_five_at_once() -> None:
    parameters = {"crown_sign": -1}
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ, parameters=parameters) as session:
        await session.until(lambda: bool(session.of(Reading)))
        await send(session, CLOCKWISE, bytes.fromhex("2a0608ffffffff07"))
        assert [each.by for each in session.of(StepGesture)] == [-1, 1, 1, 1, 1, 1]


@in_virtual_time
async def test_cue_vibrates_in_its_rhythm() -> None:
    watch = SimulatedTouchSdkWatch()
    async with worn(TOUCH_SDK, watch, rate_hz=RATE_HZ) as session:
        await session.until(lambda: bool(session.of(Reading)))
        watch.inputs.clear()
        session.source.cue(Feedback(stamp_ns=1, seq=1, cue="selected", haptic_ms=(150, 100, 50)))
        await asyncio.sleep(1.0)
        assert [each.hex() for each in watch.inputs] == ["0a0a0801150000803f189601", "0a090801150000803f1832"]


@in_virtual_time
async def test_all_frames_of_a_message_are_delivered_with_their_times() -> None:
    watch = SimulatedTouchSdkWatch("pending")
    async with worn(TOUCH_SDK, watch, rate_hz=RATE_HZ) as session:
        await session.until(lambda: session.wrist.connections == 1 and bool(watch.inputs))
        single = watch.frame(POSTURE)
        frame = single[: 2 + single[1]]
        await send(session, frame * 3 + single[len(frame) :])
        times_ns = [each.device_time_ns or 0 for each in session.of(Reading)]
        assert times_ns == [(watch.unix_ms - back_ms) * 1_000_000 for back_ms in (40, 20, 0)]


@pytest.mark.parametrize("hand", ["right", "left"])
@in_virtual_time
async def test_watch_on_either_wrist_has_x_towards_the_fingers(hand: str) -> None:
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ) as session:
        await session.until(lambda: bool(session.of(Battery)))
        watch_of(session).describe("right" if hand == "right" else "left", 74)
        await asyncio.sleep(63.0)
        turned = rotation.multiply(POSTURE, (0.0, 0.0, 1.0, 0.0))
        expected = turned if hand == "right" else POSTURE
        assert is_near(session.of(Reading)[-1].world_from_sensor, expected)
        assert len(session.of(Reconnected)) == (2 if hand == "right" else 1)


@in_virtual_time
async def test_mounting_of_a_right_wrist_is_not_turned_again() -> None:
    async with air() as around:
        wrist = await around.wrist(SimulatedTouchSdkWatch(hand="right"))
        await wrist.appear()
        surroundings = replace(
            Surroundings.detached(), clock=VirtualClock(), sensor_from_arm=MOUNTINGS["watch_right"]
        )
        items: list[object] = []
        config = TOUCH_SDK.config.model_validate({"adapter": around.adapter})
        source = TOUCH_SDK.make(config, surroundings)
        async with background(wrist.stream(RATE_HZ, lambda: POSTURE)), background(source.run(items.append)):
            await until(lambda: Battery(0.74) in items)
            await asyncio.sleep(1.0)
        reading = next(each for each in reversed(items) if isinstance(each, Reading))
        assert is_near(reading.world_from_sensor, POSTURE)


@in_virtual_time
async def test_description_that_cannot_be_read_does_not_end_the_connection(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def fail(*_arguments: object, **_options: object) -> bytearray:
        raise BleakError("Unlikely Error")

    monkeypatch.setattr(BumbleClient, "read_gatt_char", fail)
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ) as session:
        await asyncio.sleep(65.0)
        assert session.wrist.connections == 1
        assert len(session.of(Reading)) > 60 * RATE_HZ
        assert not session.of(Battery)


@in_virtual_time
async def test_messages_of_many_lengths_that_cannot_be_read_are_named() -> None:
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch("pending"), rate_hz=RATE_HZ) as session:
        await session.until(lambda: bool(watch_of(session).inputs))
        await send(session, *(b"\x0a\x7f" + bytes(length) for length in range(6)))
        await session.until(lambda: "cannot be read: update" in session.health.warnings.get("link", ""))


@in_virtual_time
async def test_fusion_gets_rates_and_accelerations_of_the_watch() -> None:
    parameters = {"orientation": "fusion", "hand": "right"}
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ, parameters=parameters) as session:
        await session.until(lambda: len(session.of(RawReading)) > 10)
        up = rotation.rotate(rotation.inverse(POSTURE), (0.0, 0.0, 9.80665))
        assert session.of(RawReading)[-1].acceleration_mps2 == pytest.approx(
            (-up[0], -up[1], up[2]), abs=1e-5
        )
        assert not session.of(Reading)


@in_virtual_time
async def test_watch_without_orientation_is_named_with_the_remedy() -> None:
    watch = SimulatedTouchSdkWatch()
    async with worn(TOUCH_SDK, watch, rate_hz=0.01) as session:
        await session.until(lambda: bool(watch.inputs))
        for _ in range(50):
            await session.wrist.send(OUTPUT, bytes.fromhex("0a0912070d0000803f2814"))
            await asyncio.sleep(0.1)
        assert "--set imu-bridge.touch_sdk.orientation=fusion" in session.health.warnings["link"]


@in_virtual_time
async def test_search_lists_a_watch_by_an_id_that_outlives_addresses() -> None:
    async with air() as around:
        wrist = await around.wrist(SimulatedTouchSdkWatch())
        await wrist.appear()
        (found,) = await discover_ble(TouchSdkWatch.kind, around.adapter)(2.0)
        assert found.address == "a1b2"
    parameters = {"sensor": "A1B2"}
    async with worn(
        TOUCH_SDK, SimulatedTouchSdkWatch(), SimulatedTouchSdkWatch(), rate_hz=RATE_HZ, parameters=parameters
    ) as session:
        await session.until(lambda: len(session.of(Reading)) > 10)
        used = next(each for each in session.wrists if each.is_connected)
        await used.vanish()
        await session.until(lambda: len(session.of(Reconnected)) == 2)
        assert not used.is_connected


@in_virtual_time
async def test_watch_that_is_not_the_wanted_one_is_left_alone() -> None:
    parameters = {"sensor": "c3d4"}
    async with worn(TOUCH_SDK, SimulatedTouchSdkWatch(), rate_hz=RATE_HZ, parameters=parameters) as session:
        await session.until(
            lambda: "Touch SDK watch c3d4 is not heard" in session.health.warnings.get("link", "")
        )
        assert session.wrist.connections == 0
