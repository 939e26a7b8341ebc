"""Remedies that `pointit import` and `pointit map import` print are followed: then the file is read.

The files have the forms of other programs: DOT exports, PlotJuggler, MetaBase, spreadsheets, xLights.
"""

import math
import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from pointit.cli.main import command

ROWS = 40
MOST_STEPS = 4
"""Maximum number of remedies that are followed one after the other."""
_REMEDY = re.compile(r"\b(t=[^\s;,']+(?: \([^)/]*\)/\w+)?(?:/\w+)*)")


def table(times: list[str], names: str = "time,w,x,y,z") -> str:
    lines = [names]
    for number, time in enumerate(times):
        half = 0.3 * math.sin(number / 30)
        lines.append(f"{time},{math.cos(half):.9f},0,0,{math.sin(half):.9f}")
    return "\n".join(lines) + "\n"


def imported(path: Path, columns: str) -> Result:
    words = ["import", str(path), "--columns", columns, "--to", str(path.with_suffix(".mcap")), "--overwrite"]
    return CliRunner().invoke(command, words, standalone_mode=False)


FILES: dict[str, tuple[str, str]] = {
    "counter of 32 bits": (
        table([f"{(2**32 - 200_000 + 16_667 * each) % 2**32}" for each in range(ROWS)]),
        "t=time/us",
    ),
    "counter of 16 bits": (
        table([f"{(2**16 - 200 + 20 * each) % 2**16}" for each in range(ROWS)]),
        "t=time/ms",
    ),
    "times without a unit": (table([f"{20 * each}" for each in range(ROWS)]), "t=time"),
    "times of another form": (
        table(
            [f"10h53m20.{20 * each:03d},{20 * each}" for each in range(ROWS)],
            "clock,elapsed,w,x,y,z",
        ),
        "t=clock/iso",
    ),
    "times that fall": (
        table([f"{0.02 * (each % 30):.2f},{20 * each}" for each in range(ROWS)], "time,elapsed,w,x,y,z"),
        "t=time",
    ),
    "times with few digits": (
        table([f"{each // 5},{20 * each}" for each in range(ROWS)], "time,elapsed,w,x,y,z"),
        "t=time",
    ),
}
"""Content and the declaration of the time."""


@pytest.mark.parametrize("name", FILES)
def test_file_is_read_after_the_remedies_of_its_refusals(name: str, tmp_path: Path) -> None:
    content, time = FILES[name]
    path = tmp_path / "arm.csv"
    path.write_text(content)
    refusals: list[str] = []
    result = imported(path, f"{time},qw=w,qx=x,qy=y,qz=z")
    while result.exception is not None and len(refusals) < MOST_STEPS:
        refusals.append(str(result.exception))
        remedies = _REMEDY.findall(refusals[-1].partition("; ")[2])
        assert remedies, refusals[-1]
        result = imported(path, f"{remedies[0]},qw=w,qx=x,qy=y,qz=z")

    assert result.exception is None, refusals
    assert refusals
    assert len({*refusals}) == len(refusals)
    assert f"{ROWS + 2} entries" in result.output


def test_columns_with_slashes_are_read_by_their_names(tmp_path: Path) -> None:
    path = tmp_path / "plot.csv"
    path.write_text(table([f"{0.02 * each:.2f}" for each in range(ROWS)], "/t/s,/o/w,/o/x,/o/y,/o/z"))
    result = imported(path, "t=/t/s,qw=/o/w,qx=/o/x,qy=/o/y,qz=/o/z")
    assert result.exception is None
    result = imported(path, "t=/t/s,qw=/o/v,qx=/o/x,qy=/o/y,qz=/o/z")
    assert "write its number, such as qw=1" in str(result.exception)
    assert imported(path, "t=/t/s,qw=2,qx=/o/x,qy=/o/y,qz=/o/z").exception is None


def test_times_of_metabase_with_points_are_read(tmp_path: Path) -> None:
    path = tmp_path / "metabase.csv"
    times = [f"2026-11-29T10.53.20.{20 * each:03d}" for each in range(ROWS)]
    path.write_text(table(times, "timestamp (+0100),w,x,y,z"))
    assert imported(path, "t=timestamp (+0100)/iso,qw=w,qx=x,qy=y,qz=z").exception is None


def test_number_beyond_a_counter_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "arm.csv"
    path.write_text(table([f"{20 * each}" for each in range(ROWS)]))
    result = imported(path, "t=time/ms/8bit,qw=w,qx=x,qy=y,qz=z")
    assert "has 260, which no counter of 8 bits has" in str(result.exception)


def test_pixels_have_columns_with_slashes(tmp_path: Path) -> None:
    path = tmp_path / "pixels.csv"
    path.write_text("pos/x,pos/y,pos/z\n" + "".join(f"{number / 50},0,1\n" for number in range(30)))
    words = ["map", "import", str(path), "--as", "csv", "--columns", "x=pos/x,y=pos/y,z=pos/z"]
    result = CliRunner().invoke(command, words, standalone_mode=False)
    assert result.exception is None
    assert "pixels: 30" in result.output
