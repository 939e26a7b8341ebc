"""Tables that spreadsheets, statistics programs and editors have rewritten are refused and stay."""

import codecs
import csv
import io
from collections.abc import Sequence
from pathlib import Path

import pytest

from pointit.errors import ConfigError
from pointit.study.append_only_csv import AppendOnlyCsv
from pointit.study.study_folder import read_table

OURS = """\
participant,block,trial,attempt,practice,method,reason,outcome,began_utc,selection_s,error_m,\
target_x_m,target_y_m,target_z_m,selected_x_m,selected_y_m,selected_z_m
ada,1,1,1,0,slow,,hit,2026-02-03T10:00:00.25+00:00,2.5,0.5,1.5,-0.25,0.9,1.5,0.25,0.9
ada,1,2,1,0,slow,"repeated: coughed, twice",skipped,2026-02-03T10:00:04+00:00,,,,,,,,
ada,1,2,2,0,slow,,wrong,2026-02-03T10:00:09+00:00,1.125,0.125,1.25,0.5,0.9,1.25,0.5,1.025
"""
HEADER, *ROWS = csv.reader(OURS.splitlines())
EXPECTED = [dict(zip(HEADER, row, strict=True)) for row in ROWS]
KEY = ("trial", "attempt")


def written(
    lines: Sequence[Sequence[str]] = (HEADER, *ROWS),
    *,
    separator: str = ",",
    end: str = "\r\n",
    quoting: bool = False,
    comma: bool = False,
) -> str:
    """Return a table as another program writes it."""
    text = io.StringIO(newline="")
    rows = [
        [
            cell.replace(".", ",") if comma and lines[0][place].endswith(("_s", "_m")) else cell
            for place, cell in enumerate(line)
        ]
        for line in lines[1:]
    ]
    writer = csv.writer(
        text, delimiter=separator, lineterminator=end, quoting=csv.QUOTE_ALL if quoting else csv.QUOTE_MINIMAL
    )
    writer.writerows([lines[0], *rows])
    return text.getvalue()


def cell_of_each_line(text: str, tail: str) -> str:
    """Return a table of which a spreadsheet with another separator has made one column."""
    lines = text.splitlines()
    return "".join('"' + line.replace('"', '""') + f'"{tail}\r\n' for line in lines)


REWRITTEN = {
    "excel macintosh": written(end="\r").encode(),
    "excel windows": written().encode(),
    "excel utf-8": codecs.BOM_UTF8 + written().encode(),
    "excel german": codecs.BOM_UTF8 + written(separator=";", comma=True).encode(),
    "excel unicode text": written(separator="\t").encode("utf-16"),
    "utf-16 big endian": codecs.BOM_UTF16_BE + written(end="\n").encode("utf-16-be"),
    "utf-16 without a mark": written(end="\n").encode("utf-16-le"),
    "one column": cell_of_each_line(OURS, "").encode(),
    "one column and empty ones": cell_of_each_line(OURS, ";;;").encode(),
    "line for excel": b"sep=;\r\n" + written(separator=";", comma=True).encode(),
    "google sheets": written().rstrip().encode(),
    "libreoffice, all quoted": written(end="\n", quoting=True).encode(),
    "libreoffice, semicolons": written(end="\n", separator=";").encode(),
    "half of the line ends": written().replace("\r\n", "\n", 2).encode(),
    "empty columns": "".join(f"{line},,,\n" for line in OURS.splitlines()).encode(),
    "empty rows": (OURS + "," * 16 + "\n" + "," * 16 + "\n").encode(),
    "spaces": OURS.replace(",1,", ", 1,", 1).encode(),
    "sorted": written([HEADER, *ROWS[::-1]]).encode(),
    "NA of R in texts": OURS.replace("slow,,", "slow,NA,")
    .replace(",,,,,,,,", ",NA,NA,NA,NA,NA,NA,NA,NA")
    .encode(),
    "NaN and missing of MATLAB": OURS.replace("slow,,", "slow,<missing>,")
    .replace(",,,,,,,,", ",NaN,NaN,NaN,NaN,NaN,NaN,NaN,NaN")
    .encode(),
    "dots of SAS": OURS.replace(",,,,,,,,", ",.,.,.,.,.,.,.,.").encode(),
    "columns in another order": written([line[::-1] for line in (HEADER, *ROWS)]).encode(),
    "row names of R": "".join(
        ",".join([f'"{n or ""}"', *(f'"{c}"' if not c[-1:].isdigit() else c for c in row)]) + "\n"
        for n, row in enumerate((HEADER, *ROWS))
    ).encode(),
    "NA of R": OURS.replace(",,,,,,,,", ",NA,NA,NA,NA,NA,NA,NA,NA").encode(),
    "floats of pandas": OURS.replace("ada,1,2,2,0", "ada,1.0,2.0,2.0,0.0").encode(),
    "exponent": written().replace(",0.125,", ",1.25E-01,").encode(),
    "time without a zone": written().replace("09+00:00", "09").encode(),
    "no zeros before the point": written().replace(",0.9", ",.9").replace(",-0.25", ",-.25").encode(),
    "trailing cells are left out": written().replace(",,,,,,,,\r\n", "\r\n").encode(),
}


def refused(path: Path) -> str:
    """Return the sentence with which run, check and report refuse a table, and check that it stays."""
    content = path.read_bytes()
    sentences: set[str] = set()
    for read in (read_table, AppendOnlyCsv):
        with pytest.raises(ConfigError) as error:
            read(path, HEADER)
        sentences.add(str(error.value))
    (sentence,) = sentences
    assert "\n" not in sentence
    assert path.read_bytes() == content
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    return sentence


@pytest.mark.parametrize("program", REWRITTEN)
def test_foreign_table_is_refused_and_a_new_folder_begins_again(tmp_path: Path, program: str) -> None:
    path = tmp_path / "old" / "trials.csv"
    path.parent.mkdir()
    path.write_bytes(REWRITTEN[program])
    sentence = refused(path)
    assert sentence.startswith(str(path))
    assert "another program has rewritten" in sentence
    assert "or begin in a new folder with `pointit study run --to`" in sentence
    table = AppendOnlyCsv(tmp_path / "new" / "trials.csv", HEADER, KEY)
    table.append(*EXPECTED)
    table.close()
    assert read_table(table.path, HEADER) == EXPECTED


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        (",2.5,", ",2. May,", "line 2: selection_s is '2. May', not a number or empty"),
        ("1.125", '"1,125"', "line 4: selection_s is '1,125', not a number or empty"),
        ("2026-02-03T10:00:09+00:00", "03.02.2026 10:00", "line 4: began_utc is '03.02.2026 10:00', not a"),
        ("2026-02-03T10:00:09+00:00", "2026-02-03", "line 4: began_utc is '2026-02-03', not a time such as"),
        ("participant,", "Teilnehmer,", "line 1 has 'Teilnehmer,block,"),
        ("participant,", "participant,participant,", "the study writes 'rticipant,block,"),
        ("outcome,", "outcome,comment,", "line 1 has 'n,outcome,comment,began"),
        ("coughed", "hust\xf6te", "line 3: 'utf-8' codec can't decode"),
        (',"repeated', ',repeated"', "line 3: not 17 values"),
        ("0.9,1.25,0.5,1.025", "0.9", "line 4: not 17 values"),
        ("ada,1,2,2", "ada,1,2.5,2", "line 4: trial is '2.5', not a whole number"),
        ("x_m,target_y", "x_m," + "x" * 200_000, "line 1 has"),
        ("coughed", "x" * 200_000, "line 3: field larger than field limit"),
    ],
)
def test_damage_is_said_with_its_line_and_the_file_stays(
    tmp_path: Path, before: str, after: str, sentence: str
) -> None:
    path = tmp_path / "trials.csv"
    assert before in OURS
    path.write_bytes(OURS.replace(before, after, 1).encode("latin-1"))
    assert sentence in refused(path)


@pytest.mark.parametrize("content", [b"\n", b"\r\n\r\n", codecs.BOM_UTF8, b"x" * 200_000])
def test_table_without_a_header_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "trials.csv"
    path.write_bytes(content)
    assert "another program has rewritten it (line 1 has " in refused(path)


def test_reason_that_statistics_programs_read_as_missing_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    path.write_text(OURS.replace('"repeated: coughed, twice"', "NA"), newline="")
    table = AppendOnlyCsv(path, HEADER, KEY)
    assert [row["reason"] for row in table.rows] == ["", "NA", ""]
    table.append({**EXPECTED[0], "trial": "3"})
    table.close()
    assert [each.name for each in tmp_path.iterdir()] == ["trials.csv"]


def test_zeros_after_a_power_cut_are_moved_to_another_file(tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    zeros = bytes(200_000)
    path.write_bytes(OURS.encode() + zeros)
    AppendOnlyCsv(path, HEADER, KEY).close()
    assert path.read_bytes() == OURS.encode()
    assert (tmp_path / "incomplete_trials.csv").read_bytes() == zeros


def test_table_restored_from_a_backup_is_appended_to(tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    with_one = AppendOnlyCsv(path, HEADER, KEY)
    with_one.append(EXPECTED[0])
    path.write_bytes(path.read_bytes())
    with_one.append(EXPECTED[1])
    with_one.close()
    assert read_table(path, HEADER) == EXPECTED[:2]
    assert [each.name for each in tmp_path.iterdir()] == ["trials.csv"]
