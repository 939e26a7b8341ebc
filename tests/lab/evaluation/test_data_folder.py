"""The index beside recordings: what it says is within bounds, and names files of its folder."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.datasets import read_trials
from pointit_lab.evaluation.recordings.data_folder import read_index
from pointit_lab.evaluation.recordings.table_file import read_table
from tests.support.published_recordings import Stand, write_motion, write_track

YAW = "ref_yaw_deg_human_minus_world"
EYES = "eye_height_guess_m"


def write_entry(recordings: Path, key: str, value: str) -> Path:
    """Write a track whose index says the JSON `value` for `key`; the file still has its name."""
    path = write_track(recordings, Stand()).parent / "index.json"
    index = json.loads(path.read_text())
    index["files"][1][key] = "@"
    path.write_text(json.dumps(index).replace('"@"', value))
    return path


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        (EYES, "1" + "0" * 400, "from 0.3 to 3 metres was expected, got 1000"),
        (EYES, "-1.6", "from 0.3 to 3 metres was expected, got -1.6"),
        (EYES, "NaN", "from 0.3 to 3 metres"),
        (EYES, "true", "from 0.3 to 3 metres"),
        (YAW, "-721", "from -720 to 720 degrees"),
        ("subject", "1" + "0" * 4250, "'subject': a text was expected"),
        ("subject", '"all"', "'all' is reserved for all subjects"),
        ("subject", '"\\u001b[2J"', "printable"),
        ("file", '"track_' + "x" * 5000 + '"', "(5008 characters)"),
        ("file", '"track_\\u0000"', "printable"),
        ("file", '"track_/../../secret.csv"', "leads out of the folder"),
        ("file", "[1]", "'file': a text was expected, got [1]"),
    ],
)
def test_damaged_index_entry_is_refused_in_one_sentence(
    tmp_path: Path, key: str, value: str, said: str
) -> None:
    path = write_entry(tmp_path, key, value)
    with pytest.raises(ConfigError) as caught:
        read_trials(tmp_path)
    assert str(caught.value).startswith(str(path))
    assert f"'{key}'" in str(caught.value)
    assert said in str(caught.value)
    assert len(str(caught.value)) < 600
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo], ids=["folder", "pipe"])
@pytest.mark.parametrize(
    ("name", "write"), [("motion_relloc/lost.csv", write_motion), ("proximity_waypoints/track_9.csv", None)]
)
def test_folder_or_pipe_in_place_of_a_file_is_refused(
    tmp_path: Path, make: Callable[[Path], None], name: str, write: Callable[..., Path] | None
) -> None:
    (write or write_track)(tmp_path, Stand())
    (tmp_path / name).unlink(missing_ok=True)
    make(tmp_path / name)
    with pytest.raises(ConfigError, match="a file was expected"):
        read_trials(tmp_path)


def test_a_file_is_listed_once(tmp_path: Path) -> None:
    path = write_motion(tmp_path, Stand()).parent / "index.json"
    path.write_text(json.dumps([*json.loads(path.read_text()), {"file": "circle.csv"}]))
    with pytest.raises(ConfigError, match=r"'circle\.csv' is listed twice"):
        read_trials(tmp_path)


@pytest.mark.parametrize(
    "raw", [b"", b"\xff\xfe", b"[" * 100_000, b'{"files": null}', b"[1]", b"{", b'[{"a": "\\ud800"}]']
)
def test_damaged_index_is_refused_in_one_sentence(tmp_path: Path, raw: bytes) -> None:
    (tmp_path / "index.json").write_bytes(raw)
    with pytest.raises(ConfigError) as caught:
        read_index(tmp_path)
    assert str(caught.value).startswith(str(tmp_path / "index.json"))
    assert len(str(caught.value)) < 600


def test_index_that_is_no_file_or_too_long_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        read_index(tmp_path)
    (tmp_path / "index.json").write_bytes(b" " * 10_000_001)
    with pytest.raises(ConfigError, match="limit 10 MB"):
        read_index(tmp_path)
    (tmp_path / "index.json").unlink()
    (tmp_path / "index.json").mkdir()
    with pytest.raises(ConfigError, match="this is a folder"):
        read_index(tmp_path)


def write(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_lines_are_those_of_the_file(tmp_path: Path) -> None:
    table = read_table(
        write(tmp_path, 'subject,x\n\n\n"a",1\nb,2\n\na,3,\n'), numbers=["x"], texts=["subject"]
    )
    assert (table.lines, table.rows_by("subject")) == ([4, 5, 7], {("a",): [0, 2], ("b",): [1]})
    part = table.only([0, 2])
    assert (part.lines, part.texts["subject"], len(part)) == ([4, 7], ["a", "a"], 2)
    np.testing.assert_array_equal(part.numbers["x"], [1.0, 3.0])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("subject,x\n\na,1\n\nb,oops\n", "line 5, column 'x': a number was expected"),
        ("subject,x\na,nan\n", "line 2, column 'x'"),
        ("subject,x\na,1e10\n", "within 1e+09 either way, got '1e10'"),
        (f"subject,x\na,{'9' * 5000}\n", "(5002 characters)"),
        ("subject,x\na,0,5\n", "line 2: 2 cells were expected, as in the header, got 3; is the line cut off"),
        ("subject,x\na\x1b[2J,1\n", "column 'subject': a text of 1 to 255 printable"),
        ("subject,x\nall,1\n", "'all' is reserved for all subjects"),
        (",".join(f"c{i}" for i in range(5000)) + "\n", "line 1: has 5000 columns"),
        ("y,z\n1,2\n", "line 1: one column 'x' was expected, found 'y', 'z'"),
        ("subject,x\n", "line 1: there is a header but no rows"),
    ],
)
def test_damage_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        read_table(path, numbers=["x"], texts=["subject"])
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)
    assert len(str(caught.value)) < 500


def test_table_that_is_no_regular_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        read_table(tmp_path / "none.csv", numbers=["x"])
    with pytest.raises(ConfigError, match="this is a folder"):
        read_table(tmp_path, numbers=["x"])
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(ConfigError, match="a device or a pipe"):  # reading it would wait for ever
        read_table(tmp_path / "pipe.csv", numbers=["x"])
    with pytest.raises(ConfigError, match="cannot be accessed") as caught:
        read_table(tmp_path / ("x" * 5000), numbers=["x"])
    assert len(str(caught.value)) < 500
