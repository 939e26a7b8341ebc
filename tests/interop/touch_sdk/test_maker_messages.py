"""Messages of the maker's generated classes, from an environment of their own, read by our decoder."""

import json
import subprocess
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from pointit.services.imu_bridge.ble.touch_sdk_messages import (
    decode_update,
    encode_client_info,
    encode_haptic,
)

HERE = Path(__file__).parent
VALID, DAMAGED = 10_000, 20_000


def lines(python: Path, *arguments: str) -> list[Any]:
    """Return the lines that `maker_messages.py` prints."""
    command = (f"{python}", f"{HERE / 'maker_messages.py'}", *arguments)
    done = subprocess.run(command, capture_output=True, text=True, timeout=300.0, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def text_of(content: object) -> str:
    """Return `content` as a text that tells -0 from 0 and is equal for two NaN."""
    return json.dumps(content, sort_keys=True)


@pytest.mark.timeout(600)
def test_messages_of_the_makers_classes_are_decoded_alike_and_damaged_ones_raise_value_error_at_most(
    touch_sdk_python: Path,
) -> None:
    messages = lines(touch_sdk_python, "1", f"{VALID}", f"{DAMAGED}")
    assert len(messages) == VALID + DAMAGED
    assert all(content is not None for _, content in messages[:VALID])
    both = 0
    for data, content in messages[:VALID]:
        assert text_of(asdict(decode_update(bytes.fromhex(data)))) == text_of(content), data
    for data, content in messages[VALID:]:
        try:
            decoded = asdict(decode_update(bytes.fromhex(data)))
        except ValueError:
            continue
        if content is not None:
            both += 1
            assert text_of(decoded) == text_of(content), data
    assert both > DAMAGED / 20


def test_inputs_are_byte_for_byte_those_of_the_makers_classes(touch_sdk_python: Path) -> None:
    encoders: dict[str, Callable[..., bytes]] = {"haptic": encode_haptic, "client_info": encode_client_info}
    for data, name, arguments in lines(touch_sdk_python, "inputs"):
        assert encoders[name](*arguments).hex() == data
