"""`pointit output test`: what each step lights, on a controller that takes DDP; and the dark at its end."""

import os
import pty
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest
from click.testing import CliRunner

from pointit.cli import outputs
from pointit.cli.outputs import steps_of
from pointit.schemas import Strip

HEADER = 10
STEPS = 10
"""Steps of the two strips of scenario_3."""
RED = b"\xff\0\0"
GREEN = b"\0\xff\0"
BLUE = b"\0\0\xff"
COUNT = 150
"""Pixels of each of the two strips of scenario_3."""


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound:
        bound.bind(("127.0.0.1", 0))
        bound.settimeout(120.0)
        yield bound


def output_of(bound: socket.socket) -> list[str]:
    port = bound.getsockname()[1]
    return ["--set", f"led-driver.outputs=[{{kind: ddp, host: 127.0.0.1, port: {port}}}]"]


def pixels_of(bound: socket.socket) -> list[bytes]:
    """Return the pixels of the frames that have arrived."""
    bound.setblocking(False)
    frames: list[bytes] = []
    while True:
        try:
            frames.append(bound.recv(2000)[HEADER:])
        except BlockingIOError:
            return frames


@pytest.mark.parametrize("pixels", [1, 2, 7, 150, 4096])
def test_each_strip_shows_ends_a_running_pixel_and_three_colors(pixels: int) -> None:
    line = ((1.0, 2.0, 0.5), (1.0, 3.0, 0.5), (4.0, 3.0, 0.5))
    ends, run, *colors = steps_of(Strip(id="a", line_m=line, pixels=pixels, direction=-1))
    assert ends.text.endswith("at (4, 3, 0.5) m in the map; last red, at (1, 2, 0.5) m")
    (picture,) = ends.pictures
    assert picture[-3:] == RED
    assert pixels == 1 or picture[:3] == GREEN
    assert picture.count(0xFF) == min(pixels, 2)
    lit = [picture.index(0xFF) // 3 for picture in run.pictures]
    assert lit == sorted(set(lit))
    assert (lit[0], lit[-1]) == (0, pixels - 1)
    assert [step.pictures[0][:3] for step in colors] == [RED, GREEN, BLUE]
    assert {len(picture) for step in (ends, run, *colors) for picture in step.pictures} == {3 * pixels}


def test_steps_of_the_named_strip_are_lit_and_told(
    receiver: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ENDS_S", "RUN_S", "COLOR_S"):
        monkeypatch.setattr(outputs, name, 0.4)
    monkeypatch.setattr(outputs, "RUN_PICTURES", 3)
    monkeypatch.setattr(outputs, "CONNECT_S", 0.5)

    arguments = ["scenario_3", "--strip", "1", *output_of(receiver)]
    done = CliRunner().invoke(outputs.command, arguments, catch_exceptions=False)
    assert done.exit_code == 0
    assert done.output.count("strip 1: ") == done.output.count("strip") == 5

    frames = pixels_of(receiver)
    assert {len(frame) for frame in frames} == {2 * 3 * COUNT}
    assert not any(any(frame[: 3 * COUNT]) for frame in frames)  # strip 0

    seen = [frame[3 * COUNT :] for frame in frames]
    wanted = [
        GREEN + bytes(3 * COUNT - 6) + RED,
        b"\xff" * 3 + bytes(3 * COUNT - 3),
        bytes(3 * COUNT - 3) + b"\xff" * 3,
        *(10 * color + bytes(3 * COUNT - 30) for color in (RED, GREEN, BLUE)),
        bytes(3 * COUNT),
    ]
    places = [seen.index(picture) for picture in wanted[:-1]]

    assert places == sorted(places)
    assert seen[-1] == wanted[-1]


def test_enter_goes_on_to_the_next_step(receiver: socket.socket) -> None:
    keyboard, terminal = pty.openpty()
    command = [sys.executable, "-m", "pointit", "output", "test", "scenario_3", *output_of(receiver)]
    with subprocess.Popen(command, stdin=terminal, stdout=subprocess.PIPE, text=True) as process:
        os.close(terminal)
        assert process.stdout is not None
        times_s: list[float] = []
        for _ in range(STEPS):
            assert process.stdout.readline().startswith("strip ")
            times_s.append(time.monotonic())
            os.write(keyboard, b"\n")

        assert process.wait(timeout=90) == 0
    os.close(keyboard)
    unhurried_s = 2 * (outputs.ENDS_S + outputs.RUN_S + 3 * outputs.COLOR_S) - outputs.COLOR_S

    assert times_s[-1] - times_s[0] < unhurried_s / 2, "steps are not waited for"
    assert not any(pixels_of(receiver)[-1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["scenario_3"], "has no output: add --output"),
        (["scenario_3", "--set", "led-driver.outputs=[{kind: none}]"], "has no output: add --output"),
        (["scenario_3", "--output", "ddp:x", "--strip", "9"], "the map has no such strip; it has 0, 1"),
    ],
)
def test_nothing_to_test_is_told(arguments: list[str], message: str) -> None:
    with pytest.raises(Exception, match=message):
        CliRunner().invoke(outputs.command, arguments, catch_exceptions=False)


def test_interrupted_test_leaves_the_strips_dark(receiver: socket.socket) -> None:
    command = [sys.executable, "-m", "pointit", "output", "test", "scenario_3", *output_of(receiver)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        while not any(lit := receiver.recv(2000)[HEADER:]):
            pass
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=90)
    assert lit[:3] == GREEN
    assert not any(pixels_of(receiver)[-1])
