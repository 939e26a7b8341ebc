"""`belts_lab`: people select packages on two LED strips, by pointing and with a mouse."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from pointit.runtime.errors import ConfigError
from pointit_lab.evaluation.recordings.json_lines import Line, check_samples, read_lines
from pointit_lab.evaluation.recordings.table_file import check_text

Interface = Literal["pointing", "mouse_gui"]

_Seconds = Annotated[float, Field(ge=0, le=86_400)]
_Change = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0, le=1)]]

NAME = "belts_lab"
FILE = "runs.jsonl"


class _Package(Line):
    uid: int
    target: bool
    selected: Annotated[tuple[_Change, ...], Field(min_length=1)]


class _Run(Line):
    subject: str
    interface: Interface
    motion: Literal["static", "moving"]
    level: Annotated[int, Field(ge=1, le=9)]
    belt_speed_mps: Annotated[float, Field(ge=0, le=10)]
    t: Annotated[tuple[_Seconds, ...], Field(min_length=1)]
    packages: Annotated[tuple[_Package, ...], Field(min_length=1)]


@dataclass(frozen=True, kw_only=True)
class Toggle:
    """A package was selected or deselected."""

    at_s: float
    """Time from the start of the run to the first sample with the new state."""
    is_wrong: bool
    """True if it leaves the package in the wrong state."""


@dataclass(frozen=True, kw_only=True)
class BeltRun:
    """One run of a person, until all targets are selected."""

    subject: str
    interface: Interface
    motion: Literal["static", "moving"]
    level: int
    speed_mps: float
    packages: int
    targets: int
    missed: int
    """Targets that were not selected at the end."""
    toggles: tuple[Toggle, ...]
    """Toggles in order of time."""

    @property
    def completion_s(self) -> float | None:
        """Return the time of the last target's final selection, or None if some were not selected."""
        if self.missed or not self.toggles:
            return None
        return self.toggles[-1].at_s


def read_runs(folder: Path) -> list[BeltRun]:
    """Return all runs in `folder`, in the order of the file.

    Raises:
        ConfigError: If the file is missing or damaged; names line, field and value.
    """
    path = folder / FILE
    return [_run(path, line, run) for line, run in read_lines(path, _Run)]


def _run(path: Path, line: int, run: _Run) -> BeltRun:
    check_text(f"{path}, line {line}, 'subject'", run.subject)
    check_samples(path, line, run.t)
    toggles: list[Toggle] = []
    for package in run.packages:
        toggles += _toggles(path, line, run, package)
    toggles.sort(key=lambda toggle: toggle.at_s)
    targets = [package for package in run.packages if package.target]
    missed = sum(not _is_selected_at_end(package) for package in targets)
    return BeltRun(
        subject=run.subject,
        interface=run.interface,
        motion=run.motion,
        level=run.level,
        speed_mps=run.belt_speed_mps,
        packages=len(run.packages),
        targets=len(targets),
        missed=missed,
        toggles=tuple(toggles),
    )


def _is_selected_at_end(package: _Package) -> bool:
    _, state = package.selected[-1]
    return bool(state)


def _toggles(path: Path, line: int, run: _Run, package: _Package) -> list[Toggle]:
    toggles: list[Toggle] = []
    samples = len(run.t)
    for (previous_index, previous_state), (index, state) in pairwise(package.selected):
        # some files have a change after the last sample: count it at the end of the recording
        is_in_order = previous_index <= index <= samples
        if not is_in_order or state == previous_state:
            previous = [previous_index, previous_state]
            raise ConfigError(
                f"{path}, line {line}: packages, uid {package.uid}, selected: changes of state in order, "
                f"within the {samples} samples, were expected, got {[index, state]} after {previous}; "
                "take the line out"
            )
        at_s = run.t[min(index, samples - 1)]
        is_wrong = bool(state) is not package.target
        toggles.append(Toggle(at_s=at_s, is_wrong=is_wrong))
    return toggles
