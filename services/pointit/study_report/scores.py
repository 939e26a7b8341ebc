"""Scores of questionnaires, with intervals over participants."""

import re
from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from pointit.runtime.errors import ConfigError
from pointit.study_report.model import Answer, Trials
from pointit.study_report.table import Table, summary

SUS_ITEMS = 10


def system_usability(values: Mapping[int, float]) -> float:
    """Return the score of the System Usability Scale, 0 to 100, of its ten items from 1 to 5, by number.

    Brooke, J. (1996). SUS: a quick and dirty usability scale. Raises: ConfigError: If an item is missing or
    not from 1 to 5.
    """
    if sorted(values) != [*range(1, SUS_ITEMS + 1)]:
        raise ConfigError(f"SUS has {SUS_ITEMS} items, not {len(values)}; complete or remove its answers")
    if wrong := [value for value in values.values() if not 1 <= value <= 5]:
        raise ConfigError(f"SUS: answer {wrong[0]:g} is not from 1 to 5; correct it")
    return 2.5 * sum(value - 1 if item % 2 else 5 - value for item, value in values.items())


def questionnaires(study: Trials) -> Table:
    """Return scores by questionnaire and condition: means over participants, with bootstrap intervals.

    SUS becomes its score. NASA-TLX becomes the mean of its items, the raw TLX (Hart, 2006), followed by its
    items. Of other questionnaires, each item with numbers is a row. Further answers, such as text, stay in
    `answers.csv`.

    Raises: ConfigError: If there is no answer that is a number, or one of SUS cannot be used.
    """
    scores: dict[tuple[str, str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for (participant, name, condition, _), answers in _sheets(study.answers).items():
        numbers = {item: float(value) for item, value in answers.items() if _is_number(value)}
        if not numbers:
            continue
        if name.lower() == "sus":
            score = system_usability(
                {_number(item, place): value for place, (item, value) in enumerate(numbers.items(), 1)}
            )
            scores[name, "score, 0 to 100", condition][participant].append(score)
            continue
        if "tlx" in name.lower():
            scores[name, "raw TLX", condition][participant].append(float(np.mean([*numbers.values()])))
        for item, value in numbers.items():
            scores[name, item, condition][participant].append(value)
    if not scores:
        raise ConfigError(f"{study.folder}: no answer to a questionnaire that is a number")
    table = Table()
    for (name, item, condition), people in scores.items():
        means = [float(np.mean(values)) for values in people.values()]
        row = {"questionnaire": name, "item": item, "condition": condition or "all"}
        table.append({**row, **summary(means, "mean", np.mean)})
    return table


def _sheets(answers: tuple[Answer, ...]) -> dict[tuple[str, str, str, str], dict[str, str]]:
    """Return the answers of each sheet, by item; the last answer to an item counts."""
    sheets: dict[tuple[str, str, str, str], dict[str, str]] = defaultdict(dict)
    for one in answers:
        sheets[one.participant, one.questionnaire, one.condition, one.block][one.item] = one.value
    return sheets


def _is_number(value: str) -> bool:
    return re.fullmatch(r"[+-]?\d+(\.\d+)?", value.strip()) is not None


def _number(item: str, place: int) -> int:
    """Return the number in the name of an item, such as `sus_3`, else its place on the sheet."""
    found = re.search(r"(\d+)$", item)
    return int(found[1]) if found else place
