"""Tables that spreadsheets, statistics programs and editors have rewritten are read, or refused in words."""

import codecs
import contextlib
import csv
import io
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pointit.errors import ConfigError
from pointit.study.append_only_csv import AppendOnlyCsv
from pointit.study.study_folder import read_table
from pointit.study.table_file import ADDED

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
    "sorted by a script": written([HEADER, *ROWS[::-1]], end="\n").rstrip().encode(),
    "sorted by pandas": written([HEADER, *ROWS[::-1]], end="\n").encode(),
    "sorted by selection time": written([HEADER, ROWS[2], ROWS[0], ROWS[1]], end="\n").encode(),
    "last row first": written([HEADER, ROWS[2], *ROWS[:2]], end="\n").encode(),
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
NUMBERS = [name for name in HEADER if name.endswith(("_s", "_m"))]


def same(rows: Sequence[dict[str, str]]) -> list[dict[str, object]]:
    """Return rows of the study's columns, with numbers as numbers."""
    return [
        {name: float(row[name]) if name in NUMBERS and row[name] else row[name] for name in HEADER}
        for row in sorted(rows, key=lambda row: (row["trial"], row["attempt"]))
    ]


@pytest.mark.parametrize("program", REWRITTEN)
def test_table_of_another_program_is_read_and_rows_go_on_beside_it(tmp_path: Path, program: str) -> None:
    path = tmp_path / "trials.csv"
    path.write_bytes(REWRITTEN[program])
    assert same(read_table(path, HEADER)) == same(EXPECTED)
    notes: list[str] = []
    table = AppendOnlyCsv(path, HEADER, KEY, notes.append)
    assert same(table.rows) == same(EXPECTED)
    assert "another program has rewritten it" in notes[0]
    assert "New rows go to trials_2.csv" in notes[0]
    assert not (tmp_path / "trials_2.csv").exists()
    new = {**EXPECTED[0], "trial": "3", "reason": ""}
    table.append(new)
    table.close()
    assert path.read_bytes() == REWRITTEN[program]
    assert same(read_table(path, HEADER)) == same([*EXPECTED, new])
    again = AppendOnlyCsv(path, HEADER, KEY)
    again.append({**new, "trial": "4"})
    again.close()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["trials.csv", "trials_2.csv"]
    assert len((tmp_path / "trials_2.csv").read_text().splitlines()) == 3


@settings(max_examples=150, deadline=None)
@given(
    order=st.permutations(range(len(HEADER))),
    rows=st.permutations(ROWS),
    separator=st.sampled_from([",", ";", "\t", "|"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-32"]),
    quoting=st.booleans(),
    comma=st.booleans(),
    empty=st.integers(0, 2),
)
def test_any_mixture_of_dialects_has_the_same_values(
    tmp_path_factory: pytest.TempPathFactory,
    *,
    order: list[int],
    rows: list[list[str]],
    separator: str,
    end: str,
    encoding: str,
    quoting: bool,
    comma: bool,
    empty: int,
) -> None:
    lines = [[line[place] for place in order] + [""] * empty for line in (HEADER, *rows)]
    text = written(lines, separator=separator, end=end, quoting=quoting, comma=comma)
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(text.encode(encoding))
    assert same(read_table(path, HEADER)) == same(EXPECTED)


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        (
            ",2.5,",
            ",2. May,",
            "line 2: selection_s is '2. May', not a number or empty; correct or delete the",
        ),
        ("1.125", '"1,125"', "line 4: selection_s is '1,125', not a number or empty"),
        (",0.5,1.5", ",5,1.5", "line 2: error_m is 5, but target and selected point are 0.5 m apart"),
        ("2026-02-03T10:00:09+00:00", "03.02.2026 10:00", "line 4: began_utc is '03.02.2026 10:00', not a"),
        ("2026-02-03T10:00:09+00:00", "2026-02-03", "line 4: began_utc is '2026-02-03', not a time such as"),
        ("participant,", "Teilnehmer,", "no column participant; restore the table as the study wrote it"),
        ("reason,outcome", "outcome,outcome", "no column reason; restore the table"),
        ("participant,", "participant,participant,", "column participant is there twice; delete the one"),
        ("coughed", "hust\xf6te", "cannot be read: line 3 is not UTF-8, another program has saved it in an"),
        (',"repeated', ',repeated"', "line 3: selection_s is '2026-02-03T10:00:04+00:00', not a"),
        ("0.9,1.25,0.5,1.025", "0.9", "line 4: not 17 values"),
        ("ada,1,2,2", "ada,1,2.5,2", "line 4: trial is '2.5', not a whole number"),
    ],
)
def test_damage_is_said_with_its_line_and_the_file_stays(
    tmp_path: Path, before: str, after: str, sentence: str
) -> None:
    path = tmp_path / "trials.csv"
    assert before in OURS
    path.write_bytes(OURS.replace(before, after, 1).encode("latin-1"))
    content = path.read_bytes()
    for read in (read_table, AppendOnlyCsv):
        with pytest.raises(ConfigError) as refused:
            read(path, HEADER)
        assert sentence in str(refused.value)
        assert "\n" not in str(refused.value)
    assert path.read_bytes() == content
    assert [each.name for each in tmp_path.iterdir()] == ["trials.csv"]


def test_reason_of_an_experimenter_is_kept_although_statistics_programs_write_it_for_nothing(
    tmp_path: Path,
) -> None:
    path = tmp_path / "trials.csv"
    path.write_text(OURS.replace('"repeated: coughed, twice"', "NA"), newline="")
    table = AppendOnlyCsv(path, HEADER, KEY)
    assert [row["reason"] for row in table.rows] == ["", "NA", ""]
    table.append({**EXPECTED[0], "trial": "3"})
    table.close()
    assert [each.name for each in tmp_path.iterdir()] == ["trials.csv"]


def test_answers_that_another_program_has_sorted_are_not_appended_to(tmp_path: Path) -> None:
    path = tmp_path / "answers.csv"
    columns = ("participant", "questionnaire", "item", "condition", "block", "value")
    rows = [
        f"ada,sus,{item},slow,{block},{value}\n" for block, item, value in ((2, 1, 1), (1, 1, 3), (1, 2, 5))
    ]
    path.write_text(",".join(columns) + "\n" + "".join(rows), newline="")
    notes: list[str] = []
    AppendOnlyCsv(path, columns, ("questionnaire", "block", "item"), notes.append).close()
    assert "another program has rewritten it (rows in another order)" in notes[0]


@pytest.mark.parametrize("content", [b"\n", b"\r\n\r\n", codecs.BOM_UTF8, codecs.BOM_UTF8 + b"\n"])
def test_rows_go_on_beside_a_table_without_a_header(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "trials.csv"
    path.write_bytes(content)
    table = AppendOnlyCsv(path, HEADER, KEY)
    table.append(*EXPECTED)
    table.close()
    assert path.read_bytes() == content
    assert same(read_table(path, HEADER)) == same(EXPECTED)


@pytest.mark.parametrize(
    "content", [b"x" * 200_000, OURS.replace("\n", "," + "x" * 200_000 + "\n", 1).encode()]
)
def test_value_that_no_table_has_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "trials.csv"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="line 1: field larger than field limit"):
        AppendOnlyCsv(path, HEADER, KEY)
    assert path.read_bytes() == content


def test_zeros_that_a_power_cut_has_left_are_moved_to_a_file_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    zeros = bytes(200_000)
    path.write_bytes(OURS.encode() + zeros)
    AppendOnlyCsv(path, HEADER, KEY).close()
    assert path.read_bytes() == OURS.encode()
    assert (tmp_path / "incomplete_trials.csv").read_bytes() == zeros


def test_column_that_people_have_added_is_named_and_left_out(tmp_path: Path) -> None:
    path = tmp_path / "ada" / "trials.csv"
    path.parent.mkdir()
    lines = [[*HEADER, "comment", ""], *([*row, "tired", "x"] for row in ROWS)]
    path.write_text(written(lines, end="\n"), newline="")
    notes: list[str] = []
    read_table(path, HEADER, notes.append)
    assert notes == ["Column comment, 19 of ada/trials.csv is not of the study and left out."]
    changes: list[str] = []
    AppendOnlyCsv(path, HEADER, KEY, changes.append).close()
    assert "added column comment" in changes[0]


def test_table_of_an_earlier_version_is_read_and_continued_in_a_further_file(tmp_path: Path) -> None:
    path = tmp_path / "trials.csv"
    path.write_text(OURS, encoding="utf-8")
    columns = (*HEADER[:9], *ADDED, *HEADER[9:])
    unknown = dict.fromkeys(ADDED, "")
    assert read_table(path, columns) == [row | unknown for row in EXPECTED]
    notes: list[str] = []
    with contextlib.closing(AppendOnlyCsv(path, columns, KEY, notes.append)) as table:
        table.append({**EXPECTED[-1], "attempt": 3, "announced": 4, "stepped": 1, "confirmed": 1})
    (note,) = notes
    assert "no column announced, as in earlier versions" in note
    assert path.read_text(encoding="utf-8") == OURS
    rows = read_table(path, columns)
    assert [row["announced"] for row in rows] == ["", "", "", "4"]
