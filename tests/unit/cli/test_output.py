"""`pointit output`: lights that are tried, calibrated and added."""

import fcntl
import io
import json
import math
import os
import pty
import struct
import subprocess
import sys
import termios
from typing import Any, cast

import pytest
import yaml
from click.testing import CliRunner
from hypothesis import example, given
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Text

from pointit.cli import outputs
from pointit.cli.common import site_link
from pointit.cli.common.output import ROOMY_WIDTH, OutputSection, cell, print_table, to_json, to_line
from pointit.cli.inspect.topics import format_message
from pointit.cli.outputs import PrintedWarnings, SiteFrames
from pointit.schemas import LampColor, Message, StripFrame, StripsFrame
from pointit.schemas.base import Rgb
from pointit.schemas.topics import LAMP_COLOR, STRIPS_FRAME, TOPICS
from pointit.services.led_driver.outputs import GuardedOutput
from pointit.site.site_state import SiteState

scalars = (
    st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]))
)
names = st.from_regex(r"x[a-z_]{0,8}", fullmatch=True)
trees = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
    max_leaves=8,
)


def rounded(tree: dict[str, Any]) -> Any:
    """Return `tree` with floats of six digits, as they are shown."""
    return json.loads(json.dumps(tree), parse_float=lambda text: float(f"{float(text):.6g}"))


@given(st.dictionaries(names, trees, max_size=4))
@example({"small": 1e-5, "large": -2e16, "whole": 3.0, "zero": -0.0})
@example({"text": "1e-5", "word": "no", "braces": "{a: [b]}", "empty": ""})
def test_a_line_is_yaml(tree: dict[str, Any]) -> None:
    line = to_line(tree)
    assert "\n" not in line
    assert repr(yaml.safe_load(line)) == repr(rounded(tree))  # repr: 1 is not 1.0, and not true


@pytest.mark.parametrize(
    "code", [0x1B, 0x7F, 0x85, 0x9B, 0x9F, 0x200B, 0x2028, 0x2029, 0x202E, 0x2066, 0xFEFF]
)
def test_control_characters_are_escaped(code: int) -> None:
    """U+009B begins a command as ESC [ does."""
    tree = {"who": f"a{chr(code)}2Jb", f"k{chr(code)}": 1, "plain": "äß→"}
    line = to_line(tree)
    text = to_json(tree)
    assert chr(code) not in line + text
    assert "äß→" in line
    assert "äß→" in text
    assert yaml.safe_load(line) == json.loads(text) == tree


def test_nothing_is_left_out_of_json_and_bytes_are_hexadecimal() -> None:
    assert json.loads(to_json({"rgb": b"\x00\xff", "none": None})) == {"rgb": "00ff", "none": None}
    with pytest.raises(TypeError, match="object"):
        to_json({"x": object()})


def test_numbers_that_json_lacks_are_null() -> None:
    def refuse(constant: str) -> None:
        raise ValueError(constant)

    text = to_json({"a": math.nan, "rows": [(math.inf, 1.0), {"b": -math.inf}]}, indent=2)
    assert json.loads(text, parse_constant=refuse) == {"a": None, "rows": [[None, 1.0], {"b": None}]}


def test_a_message_begins_with_its_key() -> None:
    frame = StripsFrame(stamp_ns=5, strips=(StripFrame(id="left", rgb=bytes(450)),))
    assert (
        format_message(STRIPS_FRAME.key, frame, as_json=False)
        == f'{STRIPS_FRAME.key}: {{stamp_ns: 5, seq: 0, strips: [{{id: "left", rgb: <450 bytes>}}], '
        "light_s: 0.0}"
    )
    parsed = json.loads(format_message(STRIPS_FRAME.key, frame, as_json=True))
    assert list(parsed) == ["key", "stamp_ns", "seq", "strips", "light_s"]
    assert parsed["strips"][0]["rgb"] == "00" * 450


def test_no_message_has_a_field_that_would_hide_the_key() -> None:
    kinds: list[type[Message]] = [topic.message for topic in TOPICS]
    assert not [kind for kind in kinds if "key" in kind.model_fields]


def test_cells_take_text_as_it_is() -> None:
    assert cell("[red]{H}").plain == "[red]{H}"
    nothing: list[Any] = [None, "", [], ()]
    assert [cell(value).plain for value in nothing] == ["-"] * 4
    assert [cell(value).plain for value in (0, 0.0, ["a", "b"])] == ["0", "0", "a, b"]


def test_text_of_others_controls_no_terminal() -> None:
    screen = Console(record=True, width=80, force_terminal=True, color_system=None)
    rows = ({"plain": "a\x1b[2Jb", "styled": Text("c\x9b2Jd", style="red"), "two lines": "e\nf"},)
    with screen.capture() as shown:
        print_table(screen, OutputSection(name="findings", about="", rows=rows))
    assert all(each in shown.get() for each in ("a?[2Jb", "c?2Jd", "e", "f"))
    assert "\x9b" not in shown.get()
    assert "\x1b[2J" not in shown.get()


SECTION = OutputSection(
    name="things", about="of a test", rows=({"name": "a", "detail": "b"},), roomy=frozenset({"detail"})
)


@pytest.mark.parametrize(("width", "shown"), [(ROOMY_WIDTH - 1, False), (ROOMY_WIDTH, True)])
def test_a_narrow_terminal_does_without_the_roomy_columns(*, width: int, shown: bool) -> None:
    text = io.StringIO()
    print_table(Console(file=text, width=width), SECTION)
    assert "name" in text.getvalue()
    assert ("detail" in text.getvalue()) is shown


def test_list_before_a_pager_is_as_wide_as_the_terminal() -> None:
    leader, terminal = pty.openpty()
    try:
        fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        command = [sys.executable, "-m", "pointit", "list"]
        out = subprocess.run(command, stdout=subprocess.PIPE, stderr=terminal, check=True).stdout.decode()
    finally:
        os.close(leader)
        os.close(terminal)
    assert "scenario_4" in out
    assert max(map(len, out.splitlines())) <= 80


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
    monkeypatch.setattr(site_link, "quiet", lambda: None)
    result: Any = CliRunner().invoke(outputs.add, [output, "--strip", "a"])
    assert sentence in str(result.exception)
