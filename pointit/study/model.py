"""The YAML file of a study: people, factors, order and task."""

import itertools
import math
import re
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    PrivateAttr,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    field_validator,
    model_validator,
)

from pointit.errors import ConfigError
from pointit.runtime.address_config import described_error
from pointit.runtime.config.config import Config, Layers
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.config.yaml_file import WrittenFloat, WrittenInt, read_yaml
from pointit.schemas import KeyNameError
from pointit.schemas.base import Name
from pointit.schemas.topics import check_name
from pointit.study.order import Order, square
from pointit.study.questionnaire import Questionnaire, check_questionnaire, scale_of
from pointit.study.study_step import StudyStep
from pointit.study.table_file import FIXED
from pointit.study.tasks import Localize, Steer, Tapping, TargetPackages, TargetPlaces, TargetReach

Task = Annotated[
    TargetReach | Tapping | TargetPackages | TargetPlaces | Steer | Localize, Field(discriminator="kind")
]

NAME = re.compile(r"[a-z][a-z0-9_]*")
FUNCTION = re.compile(r"[\w/.-]+\.py:[A-Za-z_]\w*")
TASK = "task."
"""Prefix of a parameter of the task among those of services."""

SHIPPED = ("belts", "robots", "space", "strips")
"""Scenarios of this room."""

MAX_CELLS = 1000
"""Largest number of combinations of levels."""


def _with_text(value: object, validate_value: ValidatorFunctionWrapHandler) -> object:
    """Return `value` if it is valid. A number stays one that has its text, for a service's field of text."""
    valid: object = validate_value(value)
    return value if isinstance(value, WrittenInt | WrittenFloat) else valid


Value = Annotated[bool | int | float | str, WrapValidator(_with_text)]
PRESS: dict[str, Value] = {"selector.confirm": "press", "supervisor.press_while_pointing": "confirms"}
"""Parameters with which a press ends a trial."""


class Factor(Config):
    """A factor with its levels."""

    vary: Literal["between", "block", "trial"] = Field(
        default="block",
        description="between: each participant has one level; block: one block for each level; trial: levels "
        "alternate at random inside a block",
    )
    levels: dict[str, dict[str, Value]] = Field(
        min_length=2,
        description="parameters by level: of services, such as selector.method, or of the task, task.width_m",
    )

    @model_validator(mode="after")
    def _same_parameters(self) -> Self:
        (first, wanted), *others = self.levels.items()
        for level, parameters in others:
            if different := wanted.keys() ^ parameters.keys():
                raise described_error(
                    f"level {level} and level {first} must set the same parameters; {min(different)} is "
                    "only in one"
                )
        for name in wanted:
            if "." not in name:
                raise described_error(f"{name} is no parameter: write SERVICE.PARAMETER, or task.PARAMETER")
            if self.vary == "trial" and not name.startswith(TASK):
                raise described_error(f"{name} cannot change from trial to trial: use vary: block")
        return self


class Study(Config):
    """An experiment: people, factors, order, task."""

    name: str = Field(description="lower case letters, digits and _; also the usual name of the data folder")
    about: str = Field(default="", description="one sentence")
    participants: int | tuple[str, ...] = Field(description="number, or pseudonyms")
    seed: int = Field(default=0, ge=0, description="seed of orders, targets and simulated people")
    scenario: str = Field(
        default="strips", description=f"services and room: {', '.join(SHIPPED)}, or the path of a .yaml file"
    )
    truth: Name | Literal[""] = Field(
        default="",
        description="tracker that sees the participant's true pose, such as mocap with `truth: true`; trials "
        "wait for it, unless people are simulated. Empty if there is none",
    )
    settings: dict[str, Value] = Field(default={}, description="parameters of services in all conditions")
    task: Task
    factors: dict[str, Factor] = Field(default={}, description="factors by name")
    order: Order = Field(
        default="williams",
        description="of blocks: latin_square, williams (balances sequences, too), blocked_random (by seed) "
        "or as_written",
    )
    repetitions: int = Field(default=1, ge=1, le=1000, description="trials of each cell of a block")
    practice: int = Field(default=0, ge=0, le=1000, description="practice trials at the start of each block")
    break_s: float = Field(default=0.0, ge=0, le=3600, description="shortest break between blocks, s")
    pause_s: float = Field(default=1.0, ge=0.1, le=60, description="time between trials, s")
    timeout_s: float = Field(default=10.0, gt=0, le=600, description="longest duration of a trial, s")
    end: str = Field(
        default="selection",
        description="end of a trial: selection, press (of the person's button), timeout, or FILE.py:FUNCTION",
    )
    consent: StudyStep = Field(default=StudyStep(), description="text that the participant has to agree to")
    instruction: StudyStep = Field(default=StudyStep(), description="text at the start")
    instructions: dict[str, StudyStep] = Field(
        default={}, description="text before a block, by level of a factor"
    )
    questionnaires: tuple[Questionnaire, ...] = Field(
        default=(), description="after each block: nasa-tlx, sus, or one of your own"
    )
    _folder: Path = PrivateAttr(default=Path())

    @property
    def folder(self) -> Path:
        """The folder of the file, to which paths in it are relative."""
        return self._folder

    def place_in(self, folder: Path) -> None:
        """Set the folder of the file."""
        self._folder = folder

    @property
    def steps(self) -> tuple[StudyStep, ...]:
        """All texts for the participant."""
        return (self.consent, self.instruction, *self.instructions.values())

    @property
    def people(self) -> tuple[str, ...]:
        """Pseudonyms of all participants."""
        if isinstance(self.participants, int):
            return tuple(f"P{number:02}" for number in range(1, self.participants + 1))
        return self.participants

    def factors_of(self, vary: str) -> dict[str, Factor]:
        """Return the factors that vary as `vary` says, in the order of the file."""
        return {name: factor for name, factor in self.factors.items() if factor.vary == vary}

    def cells(self, vary: str) -> list[dict[str, str]]:
        """Return all combinations of levels of those factors, each as level by factor."""
        chosen = self.factors_of(vary)
        levels = (factor.levels for factor in chosen.values())
        return [dict(zip(chosen, cell, strict=True)) for cell in itertools.product(*levels)]

    def parameters(self, cell: dict[str, str]) -> dict[str, Value]:
        """Return the parameters that the levels of `cell` set."""
        parameters: dict[str, Value] = {}
        for factor, level in cell.items():
            parameters |= self.factors[factor].levels[level]
        return parameters

    def services(self, cell: dict[str, str]) -> dict[str, Value]:
        """Return the parameters of services in the condition `cell`."""
        settings: dict[str, Value] = dict(self.settings)
        if self.end == "press":
            settings |= PRESS
        for name, value in self.parameters(cell).items():
            if not name.startswith(TASK):
                settings[name] = value
        return settings

    def task_in(self, cell: dict[str, str]) -> Task:
        """Return the task with the parameters of the condition `cell`.

        Raises: ConfigError: If a value is wrong.
        """
        values: dict[str, Any] = self.task.model_dump()
        for name, value in self.parameters(cell).items():
            if name.startswith(TASK):
                values[name.removeprefix(TASK)] = value
        layers = Layers()
        layers.add(values, f"task in {', '.join(cell.values()) or 'the study'}")
        return layers.build(type(self.task))

    @field_validator("scenario")
    @classmethod
    def _known_scenario(cls, scenario: str) -> str:
        if scenario not in SHIPPED and not scenario.endswith((".yaml", ".yml")):
            near = nearest(scenario, SHIPPED)
            raise described_error(f"no scenario {scenario!r}: give a .yaml file, or {near}")
        return scenario

    @field_validator("participants")
    @classmethod
    def _named(cls, people: int | tuple[str, ...]) -> int | tuple[str, ...]:
        if isinstance(people, int):
            if not 1 <= people <= 1000:
                raise ValueError("write a number from 1 to 1000, or pseudonyms")
            return people
        for name in people:
            if people.count(name) > 1:
                raise ValueError(f"{name} is there twice")
            try:
                check_name(name, "participant")
            except KeyNameError as error:
                raise ValueError(str(error)) from error
        if not people:
            raise ValueError("nobody takes part")
        return people

    @field_validator("name")
    @classmethod
    def _plain(cls, name: str) -> str:
        if not NAME.fullmatch(name):
            raise ValueError("write lower case letters, digits and _, the first a letter")
        return name

    @field_validator("end")
    @classmethod
    def _known_end(cls, end: str) -> str:
        if end not in ("selection", "press", "timeout") and not FUNCTION.fullmatch(end):
            raise ValueError("use selection, press, timeout, or FILE.py:FUNCTION")
        return end

    @field_validator("questionnaires")
    @classmethod
    def _known_questions(cls, given: tuple[Questionnaire, ...]) -> tuple[Questionnaire, ...]:
        for questionnaire in given:
            check_questionnaire(questionnaire)
        names = Counter(scale_of(questionnaire).name for questionnaire in given)
        repeated = [name for name, count in names.items() if count > 1]
        if repeated:
            raise ValueError(f"{min(repeated)} is there twice: their answers could not be told apart")
        return given

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        self._check_factors()
        self._check_balance()
        return self

    def _check_factors(self) -> None:
        """Check names and levels of factors, and that each parameter is set by one of them."""
        cells = math.prod(len(factor.levels) for factor in self.factors.values())
        if cells > MAX_CELLS:
            raise described_error(f"the factors have {cells} combinations of levels; {MAX_CELLS} at most")
        for name in self.factors:
            if not NAME.fullmatch(name) or name in FIXED:
                raise described_error(
                    f"factor {name}: use another name; it is a column of trials.csv or not a word"
                )
        levels = set[str]().union(*(factor.levels for factor in self.factors.values()))
        unknown = self.instructions.keys() - levels
        if unknown:
            raise described_error(f"instructions: there is no level {min(unknown)}")

        # All levels of a factor set the same parameters: its first one names them.
        set_by: dict[str, str] = {}
        for name, factor in self.factors.items():
            for parameter in next(iter(factor.levels.values())):
                if set_by.setdefault(parameter, name) != name:
                    raise described_error(f"{parameter} is set by the factors {set_by[parameter]} and {name}")

    def _check_balance(self) -> None:
        """Check that the number of participants fits the order of conditions and the groups."""
        people = len(self.people)
        blocks = len(self.cells("block"))
        groups = len(self.cells("between"))
        needed = len(square(self.order, blocks)) * groups
        if people % needed == 0:
            return
        with_groups = f" and {groups} groups" if self.factors_of("between") else ""
        way_out = ""
        if blocks > 1 and self.order != "blocked_random":
            way_out = ", or order: blocked_random"
        min_people = math.ceil(people / needed) * needed
        raise described_error(
            f"{people} participants cannot balance {blocks} conditions in order {self.order}{with_groups}"
            f"; use a multiple of {needed}, such as {min_people}{way_out}"
        )


def read_study(path: Path) -> Study:
    """Return the study in the file `path`.

    Raises: ConfigError: If the file cannot be read, a value is wrong, or the orders cannot be balanced.
    """
    layers = Layers(("factors",))
    layers.add(read_yaml(path), str(path))
    study = layers.build(Study)
    study.place_in(path.absolute().parent)
    try:
        for block, inner in itertools.product(study.cells("block"), study.cells("trial")):
            for group in study.cells("between"):
                study.task_in({**group, **block, **inner})
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    return study
