"""The sections of a report, which the page runs and the notebook repeats."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any

import yaml

from pointit.study_report import comparisons, figures, mixed, scores, sequences, tapping
from pointit.study_report.model import MEASURES, Trials

_FILE = resources.files("pointit.study_report") / "sections.yaml"
ABOUT: Mapping[str, str] = yaml.safe_load(_FILE.read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Step:
    """A call whose result is shown: a table, or a figure."""

    call: Callable[..., Any]
    arguments: tuple[str, ...] = ()

    @property
    def code(self) -> str:
        """The line of Python that makes the result from `trials`."""
        module = "figures." if self.call.__module__ == figures.__name__ else ""
        arguments = "".join(f', "{each}"' for each in self.arguments)
        return f"study_report.{module}{self.call.__name__}(trials{arguments})"

    def run(self, trials: Trials) -> Any:
        """Return the result. Raises: ConfigError: If the study has no data for it."""
        return self.call(trials, *self.arguments)


@dataclass(frozen=True)
class Section:
    """A heading, what its numbers are, and the steps that make them."""

    title: str
    about: str
    steps: tuple[Step, ...]


def sections(trials: Trials) -> Iterator[Section]:
    """Yield the sections of the report of `trials`. Tasks and measures without data are left out."""
    for measure in filter(trials.has, MEASURES):
        about = ABOUT["errors" if measure.startswith("error") else "hits"]
        yield Section(capital(MEASURES[measure]), about, _both("medians", measure))
        if trials.factors:
            about = ABOUT["differences"]
            yield Section(f"Differences: {MEASURES[measure]}", about, _both("differences", measure))
    yield Section("Outcomes", ABOUT["outcomes"], _both("outcomes"))
    yield Section("Learning", ABOUT["learning"], _both("learning"))
    for unit, title in (("m", "Throughput and Fitts' law"), ("deg", "Throughput and Fitts' law of angles")):
        if trials.has(f"target_width_{unit}"):
            steps = [Step(sequences.throughput, (unit,)), Step(sequences.omissions, (unit,))]
            for index in ("m",) if unit == "m" else ("deg", "kopper"):
                steps += [Step(figures.fitts, (index,)), Step(tapping.fitts, (index,))]
            yield Section(title, ABOUT[unit], tuple(steps))
    if trials.answers:
        yield Section("Questionnaires", ABOUT["questionnaires"], (Step(scores.questionnaires),))
    if trials.factors and len(trials.participants) > 1:
        yield Section("Linear mixed model", ABOUT["mixed"], (Step(mixed.mixed_model),))


def _both(name: str, *arguments: str) -> tuple[Step, Step]:
    """Return a figure and its table."""
    return Step(getattr(figures, name), arguments), Step(getattr(comparisons, name), arguments)


def capital(text: str) -> str:
    """Return `text` with a capital letter."""
    return text[0].upper() + text[1:]
