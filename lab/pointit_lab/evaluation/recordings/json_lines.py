"""Recordings as JSON lines: one object per line; errors name the line."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from pointit.runtime.errors import ConfigError
from pointit.schemas import summarize_validation_error
from pointit.schemas.text import system_reason
from pointit_lab.evaluation.recordings.table_file import check_file


class Line(BaseModel):
    """Model of a line; other fields are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


Kind = TypeVar("Kind", bound=Line)


def read_lines(path: Path, kind: type[Kind]) -> Iterator[tuple[int, Kind]]:
    """Yield the number and the contents of each line of `path`, without empty lines.

    Raises:
        ConfigError: If it cannot be read, is too long, has no lines, or one is not an object of this `kind`;
            names file, line, field and value.
    """
    check_file(path)
    # an error of reading names the file, one of its contents the line
    number = 0
    try:
        with path.open("rb") as file:
            for line, text in enumerate(file, start=1):
                if not text.strip():
                    continue
                number = line
                try:
                    yield line, kind.model_validate_json(text)
                except ValidationError as error:
                    problem = summarize_validation_error(error)
                    raise ConfigError(
                        f"{path}, line {line}: {problem}; correct the line, or take it out"
                    ) from error
    except OSError as error:
        reason = system_reason(error)
        raise ConfigError(f"{path}: cannot be read ({reason})") from error
    if not number:
        raise ConfigError(f"{path}: has no lines; one JSON object per line was expected")


def check_samples(path: Path, line: int, times_s: tuple[float, ...]) -> None:
    """Check that times of samples do not go backwards.

    Raises:
        ConfigError: If they do; names the first one.
    """
    for before_s, after_s in pairwise(times_s):
        if after_s < before_s:
            problem = f"time goes backwards, {after_s:g} after {before_s:g}"
            raise ConfigError(f"{path}, line {line}: t: {problem}; take the line out")
