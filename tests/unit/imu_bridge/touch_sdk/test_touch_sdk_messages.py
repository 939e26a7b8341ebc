"""Messages of watches with the Touch SDK, the times of their frames, and their events on the bus."""

import contextlib
import json
import struct
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas.topics import BUTTON, IMU, STEP
from pointit.services.imu_bridge.ble.touch_sdk import NS_PER_MS, FrameTimes
from pointit.services.imu_bridge.ble.touch_sdk_messages import (
    MAX_HAPTIC_MS,
    MessageFields,
    SensorFrame,
    Update,
    decode_update,
    encode_bytes,
    encode_client_info,
    encode_float,
    encode_haptic,
    encode_text,
    encode_varint,
    signed,
)
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit_lab.devices.ble import BleDevice
from pointit_lab.devices.wrists.touch_sdk_watch import SimulatedTouchSdkWatch
from tests.support.bench import in_virtual_time, memory_bench, until

MAKER = [
    json.loads(line)
    for line in (Path(__file__).parent / "maker_messages.jsonl").read_text(encoding="utf-8").splitlines()
]


@pytest.mark.parametrize(("data", "content"), MAKER)
def test_messages_of_the_makers_classes_are_decoded_alike(data: str, content: object) -> None:
    decoded = asdict(decode_update(bytes.fromhex(data)))
    assert json.dumps(decoded, sort_keys=True) == json.dumps(content, sort_keys=True)


@given(st.sampled_from(MAKER), st.data())
def test_damaged_messages_raise_value_error_at_most(maker: tuple[str, object], data: st.DataObject) -> None:
    message = bytearray.fromhex(maker[0])
    start = data.draw(st.integers(0, len(message)))
    end = data.draw(st.integers(start, len(message)))
    message[start:end] = data.draw(st.binary(max_size=12))
    with contextlib.suppress(ValueError):
        decode_update(bytes(message))


@pytest.mark.parametrize("length", range(1, 68))
def test_message_cut_within_its_frame_raises_an_error(length: int) -> None:
    frame = encode_bytes(1, encode_bytes(2, b"".join(encode_float(n, 1.0) for n in (1, 2, 3))) * 4)
    assert len(frame) == 70
    with pytest.raises(ValueError, match="cut"):
        decode_update(frame[:length])


def test_vibration_and_its_cancellation_are_the_published_bytes() -> None:
    assert encode_haptic(0.5, 300).hex() == "0a0a0801150000003f18ac02"
    assert encode_haptic(1.0, 60_000) == encode_haptic(1.0, MAX_HAPTIC_MS)


def test_introduction_has_app_device_and_system() -> None:
    assert encode_client_info("ab", "é", "") == b"\x12\x08\x0a\x02ab\x12\x02\xc3\xa9"


def test_quaternion_is_read_scalar_first_with_absent_numbers_as_zero() -> None:
    quaternion = encode_float(1, 0.6) + encode_float(3, 0.8)
    (frame,) = decode_update(encode_bytes(1, encode_bytes(4, quaternion))).frames
    assert frame.orientation_xyzw == pytest.approx((0.0, 0.8, 0.0, 0.6))
    assert frame.angular_velocity_radps == (0.0, 0.0, 0.0)
    assert frame.delta_ms == 0


def test_step_back_is_a_number_of_ten_bytes() -> None:
    event = b"\x08" + b"\xff" * 9 + b"\x01"
    assert decode_update(encode_bytes(5, event)).rotary_steps == (-1,)


@pytest.mark.parametrize("signals", ["320101", "3001", "32020301", "30033001", "3209818080808080808000"])
def test_signals_are_read_packed_and_one_by_one(signals: str) -> None:
    assert 1 in decode_update(bytes.fromhex(signals)).signals


def test_field_of_an_unspecified_wire_type_is_skipped() -> None:
    message = encode_text(7, "x") + encode_varint(8, 5) + encode_varint(1, 3) + encode_float(6, 1.0)
    update = decode_update(message)
    assert (update.delta_ms, update.unix_ms, update.frames, update.signals) == (0, 5, (), ())


@pytest.mark.parametrize(
    "data",
    [
        "00",
        "0b0c",
        "80",
        "ffffffffffffffffffff01",
        "0aff",
        "0d0000",
        "0900",
        "0e",
        "0f",
        "07",
        "808080808001",
    ],
)
def test_bytes_that_are_no_message_are_refused(data: str) -> None:
    with pytest.raises(ValueError, match=r"field|number"):
        MessageFields(bytes.fromhex(data))


Field = st.one_of(
    st.tuples(st.integers(1, 2**29 - 1), st.integers(1, 2**64 - 1)),
    st.tuples(st.integers(1, 2**29 - 1), st.floats(width=32).filter(bool)),
    st.tuples(st.integers(1, 2**29 - 1), st.binary(max_size=300)),
)


@given(st.lists(Field, max_size=12, unique_by=lambda field: field[0]))
def test_encoded_fields_are_read_back(fields: list[tuple[int, int | float | bytes]]) -> None:
    encoded = b"".join(
        encode_bytes(number, value)
        if isinstance(value, bytes)
        else encode_varint(number, value)
        if isinstance(value, int)
        else encode_float(number, value)
        for number, value in fields
    )
    read = MessageFields(encoded)
    for number, value in fields:
        if isinstance(value, bytes):
            assert read.message(number) == value
        elif isinstance(value, int):
            assert read.integer(number, 64) == signed(value, 64)
        else:
            assert struct.pack("<d", read.real(number)) == struct.pack("<d", value)


@given(st.integers(-(2**63), 2**63 - 1))
def test_signed_numbers_keep_their_lowest_bits(value: int) -> None:
    assert signed(value, 64) == value
    assert signed(value, 32) == (value + 2**31) % 2**32 - 2**31


def update(*deltas_ms: int, unix_ms: int = 0, delta_ms: int = 0) -> Update:
    frames = tuple(SensorFrame((0, 0, 0), (0, 0, 9.8), (0, 0, 0, 1), each) for each in deltas_ms)
    return Update(frames, (), (), (), (), delta_ms, unix_ms, None)


def read(*updates: Update) -> list[list[int | None]]:
    """Return the times of the frames of successive messages, ms."""
    times = FrameTimes()
    return [
        [None if each is None else each // NS_PER_MS for each in times.read(message)] for message in updates
    ]


@pytest.mark.parametrize(
    ("updates", "times_ms"),
    [
        ([update(20, unix_ms=1000), update(20, 20, unix_ms=1040)], [[1000], [1020, 1040]]),
        ([update(20), update(20, 10), update(10)], [[20], [40, 50], [60]]),
        ([update(0, delta_ms=20), update(0, 0, delta_ms=30)], [[20], [50, 50]]),
        ([update(20, unix_ms=1000), update(20), update(20, unix_ms=1041)], [[1000], [1020], [1041]]),
        ([update(20, unix_ms=1000), update(20, 90, unix_ms=1040)], [[1000], [1000, 1040]]),
        ([update(20, unix_ms=9000), update(20, unix_ms=1000)], [[9000], [1000]]),
        ([update(20, unix_ms=1000), update(), update(20, unix_ms=1020)], [[1000], [], [1020]]),
        ([update(0), update(0, 0)], [[None], [None, None]]),
        ([update(-5), update(2**31 - 1)], [[None], [None]]),
        ([update(20, unix_ms=-1), update(20, unix_ms=2**63 - 1)], [[20], [40]]),
    ],
)
def test_frame_times_end_at_the_time_of_their_message(updates: Sequence[Update], times_ms: object) -> None:
    assert read(*updates) == times_ms


Integers = st.integers(-(2**31), 2**31 - 1)


@given(
    st.lists(
        st.builds(update, Integers, Integers, unix_ms=st.integers(-(2**63), 2**63 - 1), delta_ms=Integers)
    )
)
def test_frame_times_fit_messages_for_any_times_of_a_watch(updates: list[Update]) -> None:
    for times_ms in read(*updates):
        assert len(times_ms) == 2
        assert all(each is None or 0 <= each < 2**62 // NS_PER_MS for each in times_ms)


PINCH = "12020801"
CLOCKWISE = "2a0b08ffffffffffffffffff01"
COUNTERCLOCKWISE = "2a020801"


@in_virtual_time
async def test_pinch_and_crown_are_numbered_events_of_the_person() -> None:
    device = BleDevice(SimulatedTouchSdkWatch())
    try:
        async with memory_bench() as bench:
            samples, presses = bench.collect(IMU, "anna"), bench.collect(BUTTON, "anna")
            steps = bench.collect(STEP, "anna")
            config = ImuBridgeConfig.model_validate({"source": "touch_sdk", "touch_sdk": device.address})
            bench.start(ImuBridge, config, user="anna")
            await device.plug()
            await until(lambda: device.peripheral.wrist.is_streaming)
            await device.send(SimulatedTouchSdkWatch().frame((0.0, 0.0, 0.0, 1.0)))
            for message in (CLOCKWISE, PINCH, COUNTERCLOCKWISE, PINCH):
                await device.send(bytes.fromhex(message))
            await until(lambda: len(steps) == 2 and len(presses) == 2 and bool(samples))
            assert [(each.by, each.seq, each.source) for each in steps] == [
                (1, 1, "device"),
                (-1, 2, "device"),
            ]
            assert [(each.gesture, each.seq) for each in presses] == [("press", 1), ("press", 2)]
    finally:
        device.close()
