"""Lines are YAML, JSON is JSON, and a pipe that closes is no error."""

import json
import subprocess
import sys
from typing import Any

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from pointit.cli.echo import format_message
from pointit.cli.output import cell, to_json, to_line
from pointit.schemas import Message, StripFrame, StripsFrame
from pointit.schemas.topics import STRIPS_FRAME, TOPICS

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


def test_nothing_is_left_out_of_json_and_bytes_are_hexadecimal() -> None:
    assert json.loads(to_json({"rgb": b"\x00\xff", "none": None})) == {"rgb": "00ff", "none": None}
    with pytest.raises(TypeError, match="object"):
        to_json({"x": object()})


def test_a_message_begins_with_its_key() -> None:
    frame = StripsFrame(stamp_ns=5, strips=(StripFrame(id="left", rgb=bytes(450)),))
    assert (
        format_message(STRIPS_FRAME.key, frame, as_json=False)
        == f'{STRIPS_FRAME.key}: {{stamp_ns: 5, seq: 0, strips: [{{id: "left", rgb: <450 bytes>}}]}}'
    )
    parsed = json.loads(format_message(STRIPS_FRAME.key, frame, as_json=True))
    assert list(parsed) == ["key", "stamp_ns", "seq", "strips"]
    assert parsed["strips"][0]["rgb"] == "00" * 450


def test_no_message_has_a_field_that_would_hide_the_key() -> None:
    kinds: list[type[Message]] = [topic.message for topic in TOPICS]
    assert not [kind for kind in kinds if "key" in kind.model_fields]


def test_cells_take_text_as_it_is() -> None:
    assert cell("[red]{H}").plain == "[red]{H}"
    nothing: list[Any] = [None, "", [], ()]
    assert [cell(value).plain for value in nothing] == ["-"] * 4
    assert [cell(value).plain for value in (0, 0.0, ["a", "b"])] == ["0", "0", "a, b"]


def test_a_reader_that_leaves_is_no_error() -> None:
    script = (
        "from pointit.cli.output import write_line\n"
        "import sys\n"
        "sys.stdin.readline()\n"
        "print(write_line('x'), file=sys.stderr)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdin and process.stdout and process.stderr  # noqa: PT018 - for the type checkers
    process.stdout.close()
    process.stdin.write("go\n")
    process.stdin.close()
    with process.stderr as stderr:
        assert stderr.read() == "False\n"
    assert process.wait(timeout=20) == 0
