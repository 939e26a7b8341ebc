"""The report of a study as one HTML page that needs nothing else, and as a notebook."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Any

import yaml

from pointit.errors import ConfigError
from pointit.runtime.host.extras import pointit_version
from pointit.study.table_file import SPOKEN
from pointit.study_report import comparisons, figures, table, tapping_movements
from pointit.study_report.reading import MEASURES, Trials
from pointit.study_report.table import RESAMPLES, Table
from pointit.study_report.tapping_movements import omission_notes

_FILE = resources.files("pointit.study_report") / "sections.yaml"
ABOUT: Mapping[str, str] = yaml.safe_load(_FILE.read_text(encoding="utf-8"))

STYLE = (resources.files("pointit.study_report") / "report.css").read_text(encoding="utf-8")
LONG = 15
"""Tables with more rows are folded."""

SETUP = """%matplotlib inline
from pointit import study_report
from pointit.study_report import figures

trials = study_report.trials({folder!r})"""


@dataclass(frozen=True)
class ReportStep:
    """A call whose result is shown: a table, or a figure."""

    call: Callable[..., Any]
    arguments: tuple[str, ...] = ()

    @property
    def code(self) -> str:
        """The line of Python that makes the result from `trials`."""
        module = "figures." if self.call.__module__ == figures.__name__ else ""
        arguments = "".join(f', "{argument}"' for argument in self.arguments)
        return f"study_report.{module}{self.call.__name__}(trials{arguments})"

    def run(self, trials: Trials) -> Any:
        """Return the result. Raises: ConfigError: If the study has no data for it."""
        return self.call(trials, *self.arguments)


@dataclass(frozen=True)
class Section:
    """A heading, what its numbers are, and the steps that make them."""

    title: str
    about: str
    steps: tuple[ReportStep, ...]


def sections(trials: Trials) -> Iterator[Section]:
    """Yield the sections of the report of `trials`. Tasks and measures without data are left out."""
    for measure in filter(trials.has, MEASURES):
        title = MEASURES[measure]
        about = ABOUT["errors" if measure.startswith("error") else "hits"]
        yield Section(capital(title), about, _both("medians", measure))
        if trials.factors:
            about = ABOUT["differences"]
            yield Section(f"Differences: {title}", about, _both("differences", measure))
    yield Section("Outcomes", ABOUT["outcomes"], _both("outcomes"))
    if trials.has(SPOKEN[0]):
        yield Section("Spoken names", ABOUT["names"], (ReportStep(comparisons.names),))
    yield Section("Learning", ABOUT["learning"], _both("learning"))
    if trials.has("target_width_m"):
        yield Section("Throughput and Fitts' law", ABOUT["m"], _tapping_steps("m", "m"))
    if trials.has("target_width_deg"):
        steps = _tapping_steps("deg", "deg", "kopper")
        yield Section("Throughput and Fitts' law of angles", ABOUT["deg"], steps)
    if trials.answers:
        yield Section("Questionnaires", ABOUT["questionnaires"], (ReportStep(table.questionnaires),))
    if trials.factors and len(trials.participants) > 1:
        yield Section("Linear mixed model", ABOUT["mixed"], (ReportStep(comparisons.mixed_model),))


def _tapping_steps(unit: str, *indices: str) -> tuple[ReportStep, ...]:
    """Return the steps of tapping in `unit`, with a regression over each of the indices of difficulty."""
    steps = [
        ReportStep(tapping_movements.throughput, (unit,)),
        ReportStep(tapping_movements.omissions, (unit,)),
    ]
    for index in indices:
        steps.append(ReportStep(figures.fitts, (index,)))
        steps.append(ReportStep(tapping_movements.fitts, (index,)))
    return tuple(steps)


def _both(name: str, *arguments: str) -> tuple[ReportStep, ReportStep]:
    """Return a figure and its table."""
    figure = ReportStep(getattr(figures, name), arguments)
    table = ReportStep(getattr(comparisons, name), arguments)
    return figure, table


def capital(text: str) -> str:
    """Return `text` with a capital letter."""
    return text[0].upper() + text[1:]


def report(trials: Trials, folder: str, tell: Callable[[str], object] = lambda _: None) -> tuple[str, str]:
    """Return the page of `trials`, and a notebook (nbformat 4.5, JSON) without results, which makes the same.

    `folder` is the study's, as seen from the notebook's. `tell` is called with the title of each section.
    """
    parts = [_head(trials)]
    cells = [_cell("markdown", f"# {trials.title}")]
    cells.append(_cell("code", SETUP.format(folder=folder)))
    for place, section in enumerate(sections(trials)):
        tell(section.title)
        title = escape(section.title)
        parts.append(f'<h2>{title}</h2><p class="about">{escape(section.about)}</p>')
        cells.append(_cell("markdown", f"## {section.title}\n\n{section.about}"))
        # What the study has no data for is a sentence, once, and no step.
        missing = dict[str, None]()
        for number, step in enumerate(section.steps):
            try:
                result = step.run(trials)
            except ConfigError as error:
                reason = str(error).removeprefix(f"{trials.folder}: ")
                missing[f"{capital(reason)}."] = None
                continue
            parts.append(_shown(result, f"s{place}-{number}", section.title))
            parts.append(f"<pre><code>{escape(step.code)}</code></pre>")
            cells.append(_cell("code", step.code))
        parts += [f"<p>{escape(sentence)}</p>" for sentence in missing]
        cells += [_cell("markdown", sentence) for sentence in missing]

    read = escape(f"trials = study_report.trials({str(trials.folder)!r})")
    parts.append(
        f"<footer><p>Made by PointIt {escape(pointit_version())}. Bootstrap: {RESAMPLES} draws,"
        " fixed seed. Each grey line makes what is above it, after"
        " <code>from pointit import study_report</code> and"
        f" <code>{read}</code>.</p></footer></body></html>\n"
    )
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    book = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    notebook = json.dumps(book, indent=1, ensure_ascii=False)
    return "\n".join(parts), f"{notebook}\n"


def notes_of(trials: Trials) -> list[str]:
    """Return sentences on all that is left out of the report of `trials`."""
    return [*trials.notes, *omission_notes(trials)]


def _head(trials: Trials) -> str:
    count = len(trials.participants)
    people = "1 participant" if count == 1 else f"{count} participants"
    facts = f"{people}, {len(trials.counted)} trials in {len(trials.conditions)} conditions"
    for factor in trials.factors:
        kind = "within" if trials.is_within(factor) else "between"
        levels = ", ".join(trials.levels(factor))
        facts += f"; factor {factor} ({kind} participants): {levels}"
    notes = notes_of(trials)
    if count == 1:
        notes.append("One participant: there are no intervals over participants and no tests.")
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    notes_list = f"<ul>{items}</ul>" if items else ""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(trials.title)}</title><style>{STYLE}</style></head><body>"
        f"<h1>{escape(trials.title)}</h1><p>{escape(facts)}.</p>{notes_list}"
    )


def _shown(result: Any, name: str, title: str) -> str:
    label = f'aria-label="{escape(title)}"'
    if not isinstance(result, Table):
        picture = figures.svg(result, name).replace("<svg", f'<svg role="img" {label}', 1)
        return f"<figure>{picture}</figure>"
    table_element = f'<div class="wide" tabindex="0" role="region" {label}>{result.html()}</div>'
    if len(result) <= LONG:
        return table_element
    return f"<details><summary>Table of {len(result)} rows</summary>{table_element}</details>"


def _cell(kind: str, text: str) -> dict[str, Any]:
    lines = text.splitlines(keepends=True)
    cell: dict[str, Any] = {"cell_type": kind, "metadata": {}, "source": lines}
    return cell if kind == "markdown" else {**cell, "execution_count": None, "outputs": []}
