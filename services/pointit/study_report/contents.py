"""The sections of a report, which the page runs and the notebook repeats."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pointit.study_report import comparisons, figures, mixed, scores, tapping
from pointit.study_report.model import MEASURES, Trials


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

    def run(self, study: Trials) -> Any:
        """Return the result. Raises: ConfigError: If the study has no data for it."""
        return self.call(study, *self.arguments)


@dataclass(frozen=True)
class Section:
    """A heading, what its numbers are, and the steps that make them."""

    title: str
    about: str
    steps: tuple[Step, ...]


def sections(study: Trials) -> Iterator[Section]:
    """Yield the sections of the report of `study`. Tasks and measures without data are left out."""
    for measure in filter(study.has, MEASURES):
        yield Section(
            capital(MEASURES[measure]),
            "For each condition the median over participants of their medians (dots), with the 95 %"
            " percentile bootstrap interval over participants; without practice, the last attempt at each"
            " trial" + (", hits and wrong selections." if measure.startswith("error") else ", hits only."),
            (Step(figures.medians, (measure,)), Step(comparisons.medians, (measure,))),
        )
        if study.factors:
            yield Section(
                f"Differences: {MEASURES[measure]}",
                "Differences of participants' medians with 95 % intervals of t distributions: paired"
                " t-tests, two-sided, within participants; Welch's between them. Holm's correction is for"
                " the pairs of a factor.",
                (Step(figures.differences, (measure,)), Step(comparisons.differences, (measure,))),
            )
    yield Section(
        "Outcomes",
        "Means over participants of the share of each outcome. Missed: all but hits, of trials that were not"
        " skipped, with its 95 % bootstrap interval.",
        (Step(figures.outcomes), Step(comparisons.outcomes)),
    )
    yield Section(
        "Learning",
        "Medians as above, by the number of the trial within its condition.",
        (Step(figures.learning), Step(comparisons.learning)),
    )
    for unit, title in (("m", "Throughput and Fitts' law"), ("deg", "Throughput and Fitts' law of angles")):
        if study.has(f"target_width_{unit}"):
            yield Section(title, _TAPPING[unit], tuple(_tapping(unit)))
    if study.answers:
        yield Section(
            "Questionnaires",
            "Means over participants with 95 % bootstrap intervals. SUS: score (Brooke, 1996). NASA-TLX:"
            " mean of the items without weights (Hart, 2006).",
            (Step(scores.questionnaires),),
        )
    if study.factors and len(study.participants) > 1:
        yield Section(
            "Linear mixed model",
            "Logarithm of the time of each hit: main effects of the factors as ratios to the first level, a"
            " random intercept of each participant, restricted maximum likelihood, 95 % Wald intervals"
            " (Pinheiro and Bates, 2000).",
            (Step(mixed.mixed_model),),
        )


_TAPPING = {
    "m": "ISO/TS 9241-411: effective width 4.133 SD of the errors along the movement, log2(De / We + 1) bit"
    " over the mean time, mean over participants of the means of their sequences (Soukoreff and MacKenzie,"
    " 2004). Fitts' regression: means over participants of each distance and width; bootstrap intervals.",
    "deg": "As above with angles seen from the person, which tell more of pointing with rays (Kopper et al.,"
    " 2010, Int. J. Human-Computer Studies 68, 603-615; Lane et al., 2025, arXiv 2505.03027). The second"
    " regression has the index of Kopper et al., log2(D / W³ + 1)².",
}


def _tapping(unit: str) -> Iterator[Step]:
    yield Step(tapping.throughput, (unit,))
    for index in ("m",) if unit == "m" else ("deg", "kopper"):
        yield Step(figures.fitts, (index,))
        yield Step(tapping.fitts, (index,))


def capital(text: str) -> str:
    """Return `text` with a capital letter."""
    return text[0].upper() + text[1:]
