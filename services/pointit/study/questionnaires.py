"""Questionnaires: NASA-TLX, SUS, and Likert scales of one's own."""

from pydantic import Field

from pointit.runtime.config.config import Config


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

NASA_TLX = Scale(
    name="nasa-tlx",
    items=(
        "Mental demand: how mentally demanding was the task?",
        "Physical demand: how physically demanding was the task?",
        "Temporal demand: how hurried or rushed was the pace of the task?",
        "Performance: how successful were you in accomplishing what you were asked to do? (low is perfect)",
        "Effort: how hard did you have to work to accomplish your level of performance?",
        "Frustration: how insecure, discouraged, irritated, stressed and annoyed were you?",
    ),
    points=(0, 100),
    step=5,
    ends=("very low", "very high"),
)
"""Raw task load index (Hart and Staveland 1988)."""

SUS = Scale(
    name="sus",
    items=(
        "I think that I would like to use this system frequently.",
        "I found the system unnecessarily complex.",
        "I thought the system was easy to use.",
        "I think that I would need the support of a technical person to be able to use this system.",
        "I found the various functions in this system were well integrated.",
        "I thought there was too much inconsistency in this system.",
        "I would imagine that most people would learn to use this system very quickly.",
        "I found the system very cumbersome to use.",
        "I felt very confident using the system.",
        "I needed to learn a lot of things before I could get going with this system.",
    ),
    points=(1, 5),
)
"""System usability scale (Brooke 1996)."""

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
