"""Adalight: the bytes, and what its wire carries."""

import re
from dataclasses import replace

import pytest
from pydantic import ValidationError

from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output import adalight
from pointit.services.led_driver.output.adalight import AdalightConfig, AdalightOutput
from tests.support.running_source import Health


@pytest.mark.parametrize(
    ("pixels", "header"), [(1, "416461000055"), (2, "416461000154"), (1000, "41646103e7b1")]
)
def test_header_matches_the_golden_bytes(pixels: int, header: str) -> None:
    data = bytes(range(3)) * pixels
    assert adalight.encode_frame(data) == bytes.fromhex(header) + data


def warning(pixels: int, **fields: object) -> str:
    told = Health()
    output = AdalightOutput(
        AdalightConfig.model_validate({"port": "x", **fields}), replace(Surroundings.detached(), health=told)
    )
    strips = [
        Strip(id=f"{first}", line_m=((0, 0, 0), (1, 0, 0)), pixels=min(4096, pixels - first))
        for first in range(0, pixels, 4096)
    ]
    output.set_strips(strips)
    return told.warnings.get("wiring x", "")


def test_rate_beyond_the_wire_is_reported_with_the_fitting_pixels() -> None:
    sentence = warning(300)
    assert "300 pixels at 115200 baud: 88 ms a frame, 11.4 frames a second" in sentence
    fitting = re.search(r"(\d+) pixels fit", sentence)
    assert fitting is not None
    assert warning(int(fitting[1])) == ""
    assert warning(int(fitting[1]) + 1)
    assert warning(300, baud=1_000_000) == ""
    assert sentence.endswith(
        "raise `baud` here and on the controller, use more outputs, or lower `wanted_rate_hz`"
    )


def test_no_more_baud_is_advised_than_can_be_set() -> None:
    sentence = warning(2000, baud=4_000_000)
    assert sentence.endswith(": use more outputs, or lower `wanted_rate_hz`")
    with pytest.raises(ValidationError):
        AdalightConfig(port="x", baud=4_000_001)  # pyrefly: ignore[bad-argument-type]


def test_pixels_beyond_a_two_byte_count_are_refused() -> None:
    assert "69632 pixels are more than Adalight has" in warning(17 * 4096)
    assert "65537 pixels are more than Adalight has" in warning(2**16 + 1)
    assert "more than Adalight has" not in warning(2**16)


async def test_frame_without_pixels_is_not_sent() -> None:
    output = AdalightOutput(AdalightConfig(port="x"), Surroundings.detached())
    output.show(StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=b"\1\2\3"),)))
    assert output._newest is None


async def test_pixels_that_a_new_map_lacks_become_dark() -> None:
    output = AdalightOutput(AdalightConfig(port="x", gamma=1.0), Surroundings.detached())
    for pixels in (2, 1):
        output.set_strips([Strip(id="a", line_m=((0, 0, 0), (1, 0, 0)), pixels=pixels)])
        output.show(StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=b"\1\2\3" * pixels),)))
    assert output._newest is not None
    assert output._newest.data[adalight.HEADER_BYTES :] == b"\1\2\3\0\0\0"
