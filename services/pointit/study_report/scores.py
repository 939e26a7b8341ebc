"""Scores of questionnaires, with intervals over participants."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from pointit.errors import ConfigError
from pointit.study.questionnaires import NASA_TLX, SUS
from pointit.study.table_file import NUMBER
from pointit.study_report.table import Table, summary
from pointit.study_report.trial_row import Trials


def system_usability(values: Sequence[float]) -> float:
    """Return the score of the System Usability Scale, 0 to 100, of its ten items from 1 to 5, in their order.

    Brooke, J. (1996). SUS: a quick and dirty usability scale. Raises: ConfigError: If an item is missing or
    not from 1 to 5.
    """
    if len(values) != len(SUS.items):
        raise ConfigError(f"SUS has {len(SUS.items)} items, not {len(values)}; complete its answers")
    if wrong := [value for value in values if not SUS.points[0] <= value <= SUS.points[1]]:
        raise ConfigError(f"SUS: answer {wrong[0]:g} is not from 1 to 5; correct it")
    return 2.5 * sum(value - 1 if item % 2 else 5 - value for item, value in enumerate(values, 1))


def questionnaires(trials: Trials) -> Table:
    """Return scores by questionnaire and condition: means over participants, with bootstrap intervals.

    SUS becomes its score. NASA-TLX becomes the mean of its items, the raw TLX (Hart, 2006), followed by its
    items. Of other questionnaires, each item with numbers is a row. Further answers, such as text, stay in
    `answers.csv`. The last answer to an item counts.

    Raises: ConfigError: If there is no answer that is a number, or one of SUS cannot be used.
    """
    sheets: dict[tuple[str, ...], dict[str, float]] = defaultdict(dict)
    for row in trials.answers:
        if NUMBER.fullmatch(row["value"]):
            key = tuple(row[name] for name in ("questionnaire", "condition", "block", "participant"))
            sheets[key][row["item"]] = float(row["value"])
    if not sheets:
        raise ConfigError(f"{trials.folder}: no answer to a questionnaire that is a number")
    scores: dict[tuple[str, str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for (name, condition, _, participant), answers in sheets.items():
        items = dict(answers)
        if name == SUS.name:
            numbers = map(str, range(1, len(SUS.items) + 1))
            values = [answers[number] for number in numbers if number in answers]
            items = {"score, 0 to 100": system_usability(values)}
        elif name == NASA_TLX.name:
            items = {"raw TLX": float(np.mean([*answers.values()])), **answers}
        for item, value in items.items():
            scores[name, item, condition][participant].append(value)
    table = Table()
    for (name, item, condition), people in scores.items():
        means = [float(np.mean(values)) for values in people.values()]
        row = {"questionnaire": name, "item": item, "condition": condition or "all"}
        table.append({**row, **summary(means, "mean", np.mean)})
    return table
