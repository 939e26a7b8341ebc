"""Tables that are damaged are refused with file, line, column and value."""

import os
from pathlib import Path

import numpy as np
import pytest

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.recordings.table_file import read_table


def write(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_lines_are_those_of_the_file(tmp_path: Path) -> None:
    table = read_table(
        write(tmp_path, 'subject,x\n\n\n"a",1\nb,2\n\na,3,\n'), numbers=["x"], texts=["subject"]
    )
    assert table.lines == [4, 5, 7]
    assert table.rows_by("subject") == {("a",): [0, 2], ("b",): [1]}
    part = table.only([0, 2])
    assert (part.lines, part.texts["subject"], len(part)) == ([4, 7], ["a", "a"], 2)
    np.testing.assert_array_equal(part.numbers["x"], [1.0, 3.0])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("subject,x\n\na,1\n\nb,oops\n", "line 5, column 'x': a number was expected"),
        ("subject,x\na,1_5\n", "line 2, column 'x'"),
        ("subject,x\na,nan\n", "line 2, column 'x'"),
        ("subject,x\na,1e10\n", "within 1e+09 either way, got '1e10'"),
        (f"subject,x\na,{'9' * 5000}\n", "(5002 characters)"),
        ("subject,x\na,0,5\n", "line 2: 2 cells were expected, as in the header, got 3; is the line cut off"),
        ("subject,x\nb\n", "line 2: 2 cells were expected, as in the header, got 1"),
        ("subject,x\n,1\n", "line 2, column 'subject': a text of 1 to 255 printable characters"),
        ("subject,x\na\x1b[2J,1\n", "column 'subject': a text of 1 to 255 printable"),
        ("subject,x\nall,1\n", "'all' is reserved for all subjects"),
        (",".join(f"c{i}" for i in range(5000)) + "\n", "line 1: has 5000 columns"),
        ("y,z\n1,2\n", "line 1: one column 'x' was expected, found 'y', 'z'"),
        ("subject,x\n", "line 1: there is a header but no rows"),
        ("", "line 1: one column 'x' was expected, found nothing"),
    ],
)
def test_damage_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        read_table(path, numbers=["x"], texts=["subject"])
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)
    assert len(str(caught.value)) < 500


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
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
