# (touch_sdk is in .venv-touch-sdk only)
"""Prints random messages of the maker's generated classes as lines of JSON; in .venv-touch-sdk.

    maker_messages.py SEED VALID DAMAGED

Each line is [bytes as hex, content]. The content is null if the maker's classes refuse the bytes. `inputs` as
the only argument prints messages to a watch instead, each with the arguments that they were made of.
"""

import json
import random
import struct
import sys
from typing import Any

from google.protobuf.message import DecodeError  # pyrefly: ignore[missing-import]
from touch_sdk.protobuf.watch_input_pb2 import HapticEvent, InputUpdate  # pyrefly: ignore[missing-import]
from touch_sdk.protobuf.watch_output_pb2 import Update  # pyrefly: ignore[missing-import]

FLOATS = (0.0, -0.0, 1.0, -1.0, 9.80665, float("inf"), float("-inf"), float("nan"), 1e-45, 3.4e38)
INTEGERS = (0, 1, -1, 127, 128, 20, 10_000, 2**31 - 1, -(2**31))
EXTRA = ("f83f05", "f93f0102030405060708", "fd3f01020304", "fa3f03616263", "5a00", "a00501")
"""Fields that no message has, of each wire type."""


class Maker:
    """Makes messages of one seed."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)

    def has(self, share: float = 0.7) -> bool:
        return self.random.random() < share

    def float32(self) -> float:
        if self.has(0.3):
            return self.random.choice(FLOATS)
        if self.has(0.2):
            return float(struct.unpack("<f", self.random.randbytes(4))[0])
        return self.random.uniform(-20.0, 20.0)

    def integer(self) -> int:
        return self.random.choice(INTEGERS) if self.has(0.5) else self.random.randrange(0, 300)

    def vector(self, target: Any) -> None:
        target.SetInParent()  # a vector of zeros is sent without content
        for field in target.DESCRIPTOR.fields:
            if self.has(0.9):
                setattr(target, field.name, self.float32())

    def info(self, target: Any) -> None:
        target.SetInParent()
        if self.has():
            target.hand = self.random.choice((0, 1, 2, 7))
        if self.has():
            target.batteryPercentage = self.random.choice((0, 1, 50, 100, -1))
        for name in ("appId", "appVersion", "modelInfo", "manufacturer", "deviceName"):
            if self.has(0.3):
                setattr(target, name, self.random.choice(("", "a", "Galaxy Watch6", "Ö" * 70)))
        if self.has(0.5):
            self.vector(target.touchScreenResolution)
        if self.has(0.5):
            target.hapticsAvailable = True
        for _ in range(self.random.randrange(3)):
            target.availableModels.add().gestures.extend(self.random.choices(range(12), k=3))
        if self.has(0.3):
            target.activeModel.gestures.append(1)

    def frame(self, target: Any) -> None:
        for name in ("gyro", "acc", "grav", "quat", "mag", "magCal"):
            if self.has(0.8):
                self.vector(getattr(target, name))
        if self.has():
            target.deltaTime = self.integer()

    def touch(self, target: Any) -> None:
        target.eventType, target.actionIndex = self.random.choice((0, 1, 2, 3, 4, 9)), self.integer()
        for index in range(self.random.choice((0, 1, 1, 2))):
            target.pointerIds.append(index)
            self.vector(target.coords.add())

    def events(self, update: Any) -> None:
        for _ in range(self.random.choice((0, 0, 1, 3))):
            gesture = update.gestures.add()
            gesture.type, gesture.deltaTime = self.random.choice((0, 1, 2, 4, 8, 9, 11, -3)), self.integer()
        for _ in range(self.random.choice((0, 0, 1, 2))):
            self.touch(update.touchEvents.add())
        for _ in range(self.random.choice((0, 0, 1))):
            update.buttonEvents.add().id = self.integer()
        for _ in range(self.random.choice((0, 0, 1, 2))):
            update.rotaryEvents.add().step = self.integer()
        for _ in range(self.random.choice((0, 1, 2))):
            entry = update.probabilities.add()
            entry.label, entry.probability = 1, self.random.random()

    def update(self) -> Any:
        update = Update()
        for _ in range(self.random.choice((0, 1, 1, 1, 2, 3))):
            self.frame(update.sensorFrames.add())
        self.events(update)
        update.signals.extend(self.random.choices((0, 1, 2, 3, 200, -1), k=self.random.choice((0, 0, 1, 3))))
        if self.has():
            update.deltaTime = self.integer()
        if self.has():
            update.unixTime = self.random.choice((0, 1, -1, 2**63 - 1, 1_800_000_000_123))
        if self.has(0.3):
            self.info(update.info)
        if self.has(0.3):
            update.pressure = 1013.25
        return update

    def message(self) -> bytes:
        data: bytes = self.update().SerializeToString()
        if self.has(0.2):
            data += bytes.fromhex(self.random.choice(EXTRA))
        if self.has(0.05):  # parts of one message are put together
            data += self.update().SerializeToString()
        return data

    def damaged(self) -> bytes:
        data = bytearray(self.message())
        kind = self.random.randrange(4)
        if kind == 0:
            return self.random.randbytes(self.random.randrange(1, 120))
        if not data:
            return b"\x0a"
        if kind == 1:
            return bytes(data[: self.random.randrange(len(data))])
        for _ in range(self.random.randrange(1, 5)):
            at = self.random.randrange(len(data))
            if kind == 2:
                data[at] = self.random.randrange(256)
            else:
                data[at:at] = self.random.randbytes(self.random.randrange(1, 4))
        return bytes(data)


def content(data: bytes) -> Any:
    """Return the content that the maker's classes read, or None if they refuse it."""
    update = Update()
    try:
        update.ParseFromString(data)
    except DecodeError:
        return None
    info = update.info

    def vector(value: Any, names: str = "xyz") -> list[float]:
        return [getattr(value, name) for name in names]

    return {
        "frames": [
            {
                "angular_velocity_radps": vector(frame.gyro),
                "acceleration_mps2": vector(frame.acc),
                "orientation_xyzw": vector(frame.quat, "xyzw"),
                "delta_ms": frame.deltaTime,
            }
            for frame in update.sensorFrames
        ],
        "gestures": [each.type for each in update.gestures],
        "touches": [
            {"kind": each.eventType, "coordinates_px": [vector(each_px, "xy") for each_px in each.coords]}
            for each in update.touchEvents
        ],
        "rotary_steps": [each.step for each in update.rotaryEvents],
        "signals": [*update.signals],
        "delta_ms": update.deltaTime,
        "unix_ms": update.unixTime,
        "info": {
            "hand": info.hand,
            "battery_percent": info.batteryPercentage,
            "screen_width_px": info.touchScreenResolution.x,
        }
        if update.HasField("info")
        else None,
    }


def print_inputs() -> None:
    """Print inputs, each with the name of its encoder and the arguments."""
    for intensity, duration_ms in ((0.5, 300), (1.0, 150), (0.0, 5000), (0.25, 0)):
        update = InputUpdate()
        update.hapticEvent.type = HapticEvent.HapticType.ONESHOT
        update.hapticEvent.intensity = intensity
        update.hapticEvent.length = duration_ms
        line = [update.SerializeToString().hex(), "haptic", [intensity, duration_ms]]
        print(json.dumps(line))  # noqa: T201 - the answer
    for texts in (("PointIt", "desk", "Linux"), ("", "", ""), ("a", "Ö" * 100, "Darwin")):
        update = InputUpdate()
        update.clientInfo.appName, update.clientInfo.deviceName, update.clientInfo.os = texts
        update.clientInfo.SetInParent()
        print(json.dumps([update.SerializeToString().hex(), "client_info", texts]))  # noqa: T201


def main() -> None:
    """Print what the arguments ask for."""
    if sys.argv[1] == "inputs":
        print_inputs()
        return
    seed, valid, damaged = map(int, sys.argv[1:])
    maker = Maker(seed)
    for index in range(valid + damaged):
        data = maker.message() if index < valid else maker.damaged()
        print(json.dumps([data.hex(), content(data)]))  # noqa: T201 - the answer


if __name__ == "__main__":
    main()
