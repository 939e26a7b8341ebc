"""`belts_vr`: people in virtual reality select defective packages that pass by on fast belts."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.recordings.json_lines import Line, check_samples, read_lines
from pointit_lab.evaluation.recordings.table_file import check_text

NAME = "belts_vr"
FILE = "packages.jsonl"

_Seconds = Annotated[float, Field(ge=0, le=86_400)]


class _Package(Line):
    subject: str
    speed_param: Annotated[float, Field(gt=0, le=100)]
    target: bool
    t: Annotated[tuple[_Seconds, ...], Field(min_length=1)]
    selected_t: _Seconds | None


@dataclass(frozen=True, kw_only=True)
class Passage:
    """A package that passed a person."""

    subject: str
    speed_mps: float
    is_target: bool
    took_s: float | None
    """Time from its appearance until it was selected, or None if it was not."""


def read_passages(folder: Path) -> list[Passage]:
    """Return all packages in `folder`, in the order of the file.

    Raises:
        ConfigError: If the file is missing or damaged; names line, field and value.
    """
    path = folder / FILE
    return [_passage(path, line, package) for line, package in read_lines(path, _Package)]


def _passage(path: Path, line: int, package: _Package) -> Passage:
    check_text(f"{path}, line {line}, 'subject'", package.subject)
    check_samples(path, line, package.t)
    took_s = None if package.selected_t is None else package.selected_t - package.t[0]
    if took_s is not None and took_s < 0.0:
        raise ConfigError(
            f"{path}, line {line}: selected_t: a time after the first, {package.t[0]:g}, was expected, got "
            f"{package.selected_t:g}; take the line out"
        )
    return Passage(
        subject=package.subject, speed_mps=package.speed_param, is_target=package.target, took_s=took_s
    )
