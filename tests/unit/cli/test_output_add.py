"""`pointit output add`: what its output is given, and what it prints."""

import json
from typing import Any, cast

import pytest
from click.testing import CliRunner

from pointit.cli import outputs
from pointit.cli.outputs import PrintedWarnings, SiteFrames
from pointit.schemas import LampColor, StripFrame, StripsFrame
from pointit.schemas.base import Rgb
from pointit.schemas.topics import LAMP_COLOR, STRIPS_FRAME
from pointit.services.led_driver.outputs import GuardedOutput
from pointit.site.site_state import SiteState


class Shown:
    """The frames that an output is given."""

    def __init__(self) -> None:
        self.rgb: list[bytes] = []
        self.lamps: dict[str, Rgb] = {}

    def show(self, frame: StripsFrame) -> None:
        self.rgb.append(b"".join(strip.rgb for strip in frame.strips))

    def show_lamp(self, name: str, color: Rgb) -> None:
        self.lamps[name] = color


def test_all_is_dark_while_no_led_driver_runs() -> None:
    shown = Shown()
    site = SiteState(SiteFrames(cast("GuardedOutput", shown)).on_change)
    for instance in ("led-driver", "pui"):
        site.set_service(instance, present=True)
    site.take(STRIPS_FRAME, "", StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=b"\1\2\3"),)), 0.0)
    site.take(LAMP_COLOR, "door", LampColor(stamp_ns=1, color=(1, 2, 3)), 0.0)
    site.set_service("pui", present=False)
    assert (shown.rgb, shown.lamps) == ([b"\1\2\3"], {"door": (1, 2, 3)})
    site.set_service("led-driver", present=False)
    assert (shown.rgb, shown.lamps) == ([b"\1\2\3", b"\0\0\0"], {"door": (0, 0, 0)})


def test_warnings_are_printed_whenever_they_change(capsys: pytest.CaptureFixture[str]) -> None:
    health = PrintedWarnings("all is well", as_json=True)
    for topic, sentence in (("a", "dark"), ("a", "dark"), ("b", "slow"), ("c", ""), ("a", ""), ("b", "")):
        health.warn(topic, sentence)
    lines = [json.loads(line)["warnings"] for line in capsys.readouterr().out.splitlines()]
    assert lines == [["dark"], ["dark", "slow"], ["slow"], []]


@pytest.mark.parametrize(
    ("output", "sentence"), [("no-such:x", "no-such"), ("ddp", "write ddp:HOST"), ("ddp:", "write ddp:HOST")]
)
def test_wrong_outputs_are_refused_in_a_sentence(
    output: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outputs, "quiet", lambda: None)
    result: Any = CliRunner().invoke(outputs.add, [output, "--strip", "a"])
    assert sentence in str(result.exception)
