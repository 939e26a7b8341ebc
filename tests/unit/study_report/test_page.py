"""The page, the notebook and the tables that `pointit study report` writes."""

import csv
import importlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from pointit import study_report
from pointit.cli.study import power as power_command
from pointit.cli.study import report as report_command
from pointit.study.table_file import COUNTS, NUMBERS
from pointit.study_report import figures
from tests.unit.study_report.generated import RINGS, write_answers, write_study

parquet: Any = importlib.import_module("pyarrow.parquet")  # it has no types
NUMERIC = {*COUNTS, *NUMBERS}


class Page(HTMLParser):
    """Collects what a page is made of."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.ids += [given["id"] or ""] if "id" in given else []
        self.links += [given[name] or "" for name in ("src", "href", "xlink:href") if name in given]
        self.open.append(tag)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("study")
    write_study(made, {"dwell": 1.0, "<press>": 0.8}, people=6, rings=RINGS)
    write_answers(made, "P01", {("sus", "dwell"): [3] * 10})
    return made


@pytest.fixture(scope="module")
def written(folder: Path) -> str:
    done = CliRunner().invoke(report_command, [str(folder)])
    assert done.exit_code == 0, done.output
    names = ("report.html", "report.ipynb", "all_trials.csv")
    assert [Path(line).name for line in done.stdout.splitlines()][:3] == [*names]
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_page_needs_nothing_else_and_is_well_formed(written: str) -> None:
    page = Page(written)
    assert page.ids
    assert len(page.ids) == len(set(page.ids)), "ids of several figures"
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links)
    assert not re.search(r"https?://", written.replace("http://www.w3.org/", ""))
    assert "<press>" not in written
    assert "<h1>made</h1>" in written
    assert "&lt;press&gt;" in written
    assert "prefers-color-scheme: dark" in written
    assert "currentColor" in written


def test_each_result_on_the_page_has_its_code(folder: Path, written: str) -> None:
    codes = re.findall(r"<pre><code>(.*?)</code></pre>", written)
    results = len(re.findall(r"<figure>|<table>", written))
    assert len(codes) == results >= 20
    names: dict[str, Any] = {"study_report": study_report, "trials": study_report.trials(folder)}
    table = eval('study_report.medians(trials, "selection_s")', names)  # noqa: S307 - our own line
    assert "study_report.medians(trials, &quot;selection_s&quot;)" in codes
    assert table.html() in written


def test_notebook_is_valid_and_runs_where_it_stands(
    folder: Path, written: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    book = json.loads((folder / "report.ipynb").read_text(encoding="utf-8"))
    assert (book["nbformat"], book["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in book["cells"]}) == len(book["cells"])

    names: dict[str, Any] = {}
    run = 0
    for cell in book["cells"]:
        assert set(cell) >= {"id", "cell_type", "metadata", "source"}
        if cell["cell_type"] == "code":
            assert (cell["execution_count"], cell["outputs"]) == (None, [])
            source = "".join(cell["source"]).replace("%matplotlib inline\n", "")
            if "figures." not in source:  # the page has drawn them
                exec(source, names)  # noqa: S102 - our own cells
                run += 1

    assert run >= 12
    assert written.count("<h2>") == sum("## " in "".join(cell["source"]) for cell in book["cells"])


def test_all_trials_table_has_every_participants_rows_in_order(folder: Path, written: str) -> None:
    assert written
    with (folder / "all_trials.csv").open(encoding="utf-8") as file:
        joined = [*csv.DictReader(file)]
    own: list[dict[str, str]] = []
    for path in sorted(folder.glob("P*/trials.csv")):
        with path.open(encoding="utf-8") as file:
            own += [*csv.DictReader(file)]
    own.sort(key=lambda row: (row["participant"], int(row["trial"]), int(row["attempt"])))
    assert joined == own


def test_table_of_all_trials_has_no_formulas(tmp_path: Path) -> None:
    write_study(tmp_path, {"-5": 1.0, "=SUM(A1)": 0.8}, people=2, rings=RINGS[:1])
    study_report.write_all_trials(tmp_path, tmp_path)
    with (tmp_path / "all_trials.csv").open(encoding="utf-8") as file:
        joined = [*csv.DictReader(file)]
    assert {row["method"] for row in joined} == {"'-5", "'=SUM(A1)"}
    assert any(row["target_y_m"].startswith("-") for row in joined)
    assert {*parquet.read_table(tmp_path / "all_trials.parquet").to_pydict()["method"]} == {"-5", "=SUM(A1)"}


def test_parquet_has_the_same_rows_with_numbers_as_numbers(folder: Path, written: str) -> None:
    assert written
    table = parquet.read_table(folder / "all_trials.parquet")
    with (folder / "all_trials.csv").open(encoding="utf-8") as file:
        rows = [*csv.DictReader(file)]
    assert table.column_names == [*rows[0]]

    kinds = {
        name: str(table.schema.field(name).type)
        for name in ("participant", "method", "trial", "error_m", "reason")
    }
    assert kinds == {
        "participant": "string",
        "method": "string",
        "trial": "int64",
        "error_m": "double",
        "reason": "string",
    }
    for read, row in zip(table.to_pylist(), rows, strict=True):
        assert {name: "" if value is None else value for name, value in read.items()} == {
            name: float(value) if value and name in NUMERIC else value for name, value in row.items()
        }


def test_page_of_a_study_without_factors_names_what_is_missing(tmp_path: Path) -> None:
    write_study(tmp_path, {"dwell": 1.0}, people=1, rings=RINGS[:1])
    path = tmp_path / "P01/trials.csv"
    path.write_text(path.read_text(encoding="utf-8").replace(",method,", ",").replace(",dwell,", ","))
    done = CliRunner().invoke(report_command, [str(tmp_path), "--to", str(tmp_path / "new" / "place")])
    assert done.exit_code == 0, done.output
    text = (tmp_path / "new/place/report.html").read_text(encoding="utf-8")
    assert "One participant: there are no intervals over participants and no tests." in text
    assert "No condition has three different distances or widths" in text
    assert "Linear mixed model" not in text
    book = (tmp_path / "new/place/report.ipynb").read_text(encoding="utf-8")
    assert "study_report.fitts(" not in book, "a cell would fail"
    assert "No condition has three" in book


def test_power_says_how_many_participants_are_needed(folder: Path) -> None:
    arguments = ["--pilot", str(folder), "--factor", "method", "--runs", "500", "--effect"]
    done = CliRunner().invoke(power_command, [*arguments, "-10%"])
    assert done.exit_code == 0, done.output
    assert "paired t-test, two-sided, selection_s: <press> - dwell = -0." in " ".join(done.stdout.split())
    assert re.search(r"80% of studies: \d+ participants \(\d+ to \d+\)\n90% of studies: \d+ ", done.stdout)
    again = CliRunner().invoke(power_command, [*arguments, "-10%"])
    assert again.stdout == done.stdout
    done = CliRunner().invoke(power_command, [*arguments, "0.0001", "--most", "6"])
    assert "80% of studies: not with 6 participants; try --most" in done.stdout
    done = CliRunner().invoke(power_command, [*arguments, "much"])
    assert str(done.exception) == "--effect much: not a number or a share such as -10%"


STUDY = """
name: small
participants: 4
task: {kind: reach, width_m: 0.3}
factors: {method: {levels: {hold: {selector.method: hold}, gauge: {selector.method: gauge}}}}
"""


@pytest.mark.slow
def test_simulated_participants_run_a_study_for_its_power(tmp_path: Path) -> None:
    file = tmp_path / "small.yaml"
    file.write_text(STUDY, encoding="utf-8")
    arguments = [str(file), "--factor", "method", "--runs", "200", "--effect", "-1", "--most", "12", "--json"]
    done = CliRunner().invoke(power_command, arguments)
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["power"]
    assert rows[0]["participants"] == 4
    assert rows[-1]["power"] > rows[0]["power"]
    done = CliRunner().invoke(power_command, ["--factor", "method"])
    assert str(done.exception) == "give either the FILE of a study or --pilot FOLDER"


def test_names_in_any_script_are_drawn_without_a_warning() -> None:
    figure: Any = Figure()
    figure.text(0.1, 0.5, "\U000f0001 \u53a8\u623f")
    assert "\u53a8\u623f" in figures.svg(figure, "names")
