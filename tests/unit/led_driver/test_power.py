"""Values sent to LEDs: gamma, and the current limit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.led_driver.output.power import Power
from pointit.services.led_driver.outputs import OutputConfig


def test_with_gamma_1_and_no_limit_bytes_are_sent_as_they_are() -> None:
    sent, load = Power(OutputConfig(gamma=1.0)).send(bytes(range(255)))
    assert sent == bytes(range(255))
    assert not load.limited


def test_gamma_makes_the_middle_darker_and_keeps_both_ends() -> None:
    sent, _ = Power(OutputConfig()).send(bytes((0, 128, 255)))
    assert list(sent) == [0, 56, 255]  # 255 · (128 / 255)^2.2 = 55.98


def test_the_current_is_that_of_the_bytes_that_are_sent() -> None:
    power = Power(OutputConfig(current_per_pixel_ma=60.0))
    _, load = power.send(b"\xff" * 30 + b"\xff\x00\x00" * 10)
    assert load.wanted_a == load.drawn_a == pytest.approx(10 * 0.06 + 10 * 0.02)


@given(st.binary(max_size=360), st.floats(0.01, 2.0), st.floats(1.0, 3.0))
def test_no_frame_ever_draws_more_than_the_limit(pixels: bytes, limit_a: float, gamma: float) -> None:
    power = Power(OutputConfig(max_current_a=limit_a, gamma=gamma))
    sent, load = power.send(pixels)
    drawn_a = sum(sent) / 765 * 0.06
    assert drawn_a <= limit_a + 1e-9
    assert load.drawn_a == pytest.approx(drawn_a)
    free, unlimited = Power(OutputConfig(gamma=gamma)).send(pixels)
    assert load.wanted_a == pytest.approx(unlimited.drawn_a)
    if unlimited.drawn_a <= limit_a:
        assert sent == free
        assert not load.limited
    else:  # all is scaled alike, rounded down
        scale = limit_a / unlimited.drawn_a
        for ours, theirs in zip(sent, free, strict=True):
            assert ours <= theirs * scale + 1e-6
            assert ours > theirs * scale - 1 - 1e-6
