"""Questionnaires of items that are answered on one scale; NASA-TLX and SUS."""

from importlib import resources

import yaml
from pydantic import Field

from pointit.runtime.config.config import Config

_FILE = resources.files("pointit.study") / "texts" / "questionnaires.yaml"


class Scale(Config):
    """A questionnaire of items that are answered on one scale."""

    name: str = Field(description="in answers.csv")
    items: tuple[str, ...] = Field(min_length=1, description="statements or questions")
    points: tuple[int, int] = Field(default=(1, 7), description="lowest and highest answer")
    step: int = Field(default=1, ge=1, description="between answers")
    ends: tuple[str, str] = Field(
        default=("strongly disagree", "strongly agree"), description="meaning of the lowest and the highest"
    )


Questionnaire = str | Scale

NASA_TLX, SUS = (Scale.model_validate(each) for each in yaml.safe_load(_FILE.read_text(encoding="utf-8")))
KNOWN = {scale.name: scale for scale in (NASA_TLX, SUS)}


def scale_of(questionnaire: Questionnaire) -> Scale:
    """Return the scale of a questionnaire, which may be named."""
    return KNOWN[questionnaire] if isinstance(questionnaire, str) else questionnaire


def check_questionnaire(questionnaire: Questionnaire) -> None:
    """Check that a named questionnaire is known, and that a scale goes up. Raises: ValueError: If not."""
    if isinstance(questionnaire, str):
        if questionnaire not in KNOWN:
            raise ValueError(f"use one of {', '.join(KNOWN)} or write items (got {questionnaire!r})")
    elif questionnaire.points[0] >= questionnaire.points[1]:
        raise ValueError(f"{questionnaire.name}: points must go up (got {list(questionnaire.points)})")
