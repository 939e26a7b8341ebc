"""Maps beside the files of WLED and xLights."""

import contextlib
import json
import time
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import example, given
from hypothesis import strategies as st

from pointit.cli.maps.exchange import import_
from pointit.maps import exchange
from pointit.maps.model import MapFile
from pointit.runtime.errors import ConfigError

BENT = MapFile.model_validate(
    {
        "strips": {
            "desk": {"line": [[0, 0, 1], [1.2, 0, 1], [1.2, 0.8, 1]], "pixels": 60},
            "wall": {"line": [[0, 2, 0], [0, 2, 1.5]], "pixels": 45, "direction": -1},
        }
    }
)


NAMES = ("Living room", "Living room", "../x", "..", "Livi\ud800")
BEYOND = "x,y,z\n0,0,0\n1e9,0,0\n2e9,0,0\n"
LONG = f"x,y,z\n0,0,0\n{'1' * 200_000},0,0\n"
INDEX = "x,y,z,pixel\n0,0,0,nan\n0.1,0,0,1\n"


def test_csv_gives_back_lines_pixels_and_corners() -> None:
    back = exchange.from_csv(exchange.to_csv(BENT))
    assert [strip.pixels for strip in back.values()] == [60, 45]
    assert back["desk"].line[0] == pytest.approx((0, 0, 1), abs=0.02)
    assert back["desk"].line[1] == pytest.approx((1.2, 0, 1), abs=0.03)
    assert back["desk"].line[-1] == pytest.approx((1.2, 0.8, 1), abs=0.02)
    assert len(back["desk"].line) == 3


def test_distant_pixels_are_refused_until_gap_or_strips_are_declared() -> None:
    places = [f"{0.1 * n},0,0" for n in range(10)] + [f"{5 + 0.1 * n},1,0" for n in range(5)]
    text = "x,y,z\n" + "\n".join(places)
    with pytest.raises(
        ConfigError,
        match=r"pixels 9 and 10 are 4\.22 m apart, and others 0\.1 m; name strips in .* such as 0\.2$",
    ):
        exchange.from_csv(text)
    assert [strip.pixels for strip in exchange.from_csv(text, gap_m=0.2).values()] == [10, 5]
    named = ["x,y,z,strip", *(f"{place},{'a' if at < 10 else 'b'}" for at, place in enumerate(places))]
    assert [strip.pixels for strip in exchange.from_csv("\n".join(named)).values()] == [10, 5]


def test_csv_strips_with_and_without_names_are_all_read() -> None:
    text = "x,y,z,strip\n0,0,0,\n0.1,0,0,\n0,1,0,strip_1\n0.1,1,0,strip_1\n0.2,1,0,strip_1\n"
    pixels = {name: strip.pixels for name, strip in exchange.from_csv(text).items()}
    assert pixels == {"strip_1_2": 2, "strip_1": 3}


@pytest.mark.parametrize("text", ["", "x,y,z\n0,0,0\n", BEYOND, LONG, INDEX])
def test_csv_of_something_else_is_an_error_of_one_sentence(text: str) -> None:
    with pytest.raises(ConfigError):
        exchange.from_csv(text)


@given(st.text(max_size=60))
@example("[" * 100_000)
def test_any_text_is_an_error_of_one_sentence_or_strips(text: str) -> None:
    with contextlib.suppress(ConfigError):
        assert exchange.from_csv(text)
    with contextlib.suppress(ConfigError):
        assert exchange.from_segments(text)
    with contextlib.suppress(ConfigError):
        assert exchange.from_ledmap(text, 0.05)


def test_segments_get_valid_map_names_and_none_is_lost() -> None:
    named = [{"start": 10 * n, "stop": 10 * n + 9 + n, "n": name} for n, name in enumerate(NAMES)]
    segments = exchange.from_segments(json.dumps({"seg": named}))
    counts = {name: each.pixels for name, each in segments.items()}
    assert counts == {"Living_room": 9, "Living_room_2": 10, "_x": 11, "segment_3": 12, "Livi_": 13}
    MapFile.model_validate({"strips": exchange.laid_out(segments, 0.1)})


@pytest.mark.parametrize("stop", [5000, 200_000])
def test_segments_with_more_pixels_than_a_strip_are_refused(stop: int) -> None:
    counts = exchange.from_segments(json.dumps({"seg": [{"start": 0, "stop": stop}]}))
    with pytest.raises(ConfigError, match=f"a strip of {stop} pixels"):
        exchange.laid_out(counts, 0.01)


ALIKE = ["".join("!?"[number >> bit & 1] for bit in range(13)) for number in range(4500)]
LIMITED = {
    "segments": (json.dumps({"seg": [{"start": 0, "stop": 9}] * 30_000}), "more than 1000 segments"),
    "digits": ('{"seg": [{"stop": ' + "9" * 400 + "}]}", "stop of segment 0 is 9{20}.*; write a whole"),
    "wire": (json.dumps({"seg": [{"start": 0, "stop": 10**6}]}), "a whole number from 0 to 262143"),
    "a ledmap": (json.dumps({"width": 20_000, "height": 1, "map": [*range(20_000)]}), "has 20000 pixels"),
    "a comment": ("x,y,z\n0,0,0\n#" + "a," * 6_000_000 + "\n1,0,0\n", "line 3: has 12000001 characters"),
    "strips": (
        "x,y,z,strip\n" + "".join(f"{x},0,{z},{name}\n" for z, name in enumerate(ALIKE) for x in (0, 1)),
        "gives 4500 strips, limit 4000"),
}  # fmt: skip


def read_any(text: str) -> None:
    if not text.startswith("{"):
        exchange.from_csv(text)
    elif "width" in text:
        exchange.from_ledmap(text, 0.05)
    else:
        exchange.from_segments(text)


@pytest.mark.parametrize("name", LIMITED)
def test_files_beyond_a_limit_are_refused_in_one_sentence(name: str) -> None:
    text, message = LIMITED[name]
    began_s = time.process_time()
    with pytest.raises(ConfigError, match=message) as caught:
        read_any(text)
    assert len(str(caught.value)) < 200
    assert time.process_time() - began_s < 4.0


def test_ledmap_with_too_many_cells_is_refused() -> None:
    with pytest.raises(ConfigError, match="too many"):
        exchange.to_ledmap(BENT, "side", 0.0001)


def imported(folder: Path, content: bytes, *options: str) -> tuple[str, int]:
    source = folder / "source.json"
    source.write_bytes(content)
    result = CliRunner().invoke(import_, [str(source), "--as", "segments", *options])
    return (str(result.exception) if result.exception else result.output), result.exit_code


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_segments_are_imported_in_any_unicode(tmp_path: Path, encoding: str) -> None:
    text, code = imported(tmp_path, '{"seg": [{"start": 0, "stop": 64, "n": "Küche"}]}'.encode(encoding))
    assert code == 0
    assert "pixels: 64" in text


def test_file_in_another_encoding_is_refused_with_line_and_remedy(tmp_path: Path) -> None:
    text, _ = imported(tmp_path, '{"seg": [\n{"start": 0, "stop": 9, "n": "Küche"}]}'.encode("latin-1"))
    assert text.endswith("source.json: line 2 is not UTF-8; save the file as UTF-8")


USED: list[dict[str, Any]] = [
    {"id": 0, "start": 0, "stop": 30, "grp": 1, "n": "Desk"},
    {"id": 1, "start": 30, "stop": 60},
]
FILLER = {"stop": 0}


@pytest.mark.parametrize(
    "other",
    [
        [*USED, *[FILLER] * 30],
        [*USED, {"id": 2, "start": 0, "stop": 0, "n": "old"}],
        [{**USED[0], "fx": 9, "stopY": 1}, {"id": 4, "start": 30, "len": 30}],
        [USED[0], FILLER, {**USED[1], "n": ""}],
        USED[::-1],
    ],
)
def test_presets_that_differ_only_in_unused_segments_are_the_same(other: list[dict[str, Any]]) -> None:
    presets: dict[str, Any] = {
        "0": {},
        "1": {"seg": [*USED, *[FILLER] * 14], "n": "A"},
        "2": {"seg": other, "n": "B"},
    }
    presets["3"] = {"playlist": {"ps": [1, 2]}, "on": True, "n": "Loop"}
    segments = exchange.from_segments(json.dumps(presets))
    assert [(each.start, each.pixels) for each in segments.values()] == [(0, 30), (30, 30)]
