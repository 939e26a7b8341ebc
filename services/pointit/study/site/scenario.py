"""The scenario of a session: that of the study, with a recorder if it records; its scenes."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

import pointit
from pointit.launch.plan.scenario_catalog import room_of
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.atomic_file import write_atomically
from pointit.study.model import SHIPPED, Study
from pointit.study.plan import Plan
from pointit.study.tasks.scene import Scene


def scenario_file(study: Study, recording: Path | None = None) -> Path:
    """Return the path of the scenario; with a `recording`, of a copy beside it with a recorder."""
    if study.scenario in SHIPPED:
        path = Path(str(resources.files("pointit.study") / "scenarios" / f"{study.scenario}.yaml"))
    else:
        path = study.folder / study.scenario
    if recording is None:
        return path
    content: dict[str, Any] = read_yaml(path)
    site = content.setdefault("site", {})
    site["recorder"] = {"file": str(recording.absolute())}
    room = site.get("pui", {}).get("map", "")
    if Path(room).suffix:
        site["pui"]["map"] = str((path.parent / room).absolute())
    copy = recording.with_name("scenario.yaml")
    write_atomically(copy, yaml.safe_dump(content, sort_keys=False).encode(), mode=0o644)
    return copy


def scenes_of(study: Study, plan: Plan, block: int, settings: Mapping[str, object]) -> list[Scene]:
    """Return the scenes of all trials of a block, in their order, without starting anything.

    Raises: ConfigError: If the scenario or a parameter of `settings` cannot be used, or the room lacks a
    target.
    """
    run = pointit.run(scenario_file(study), users=[plan.participant], settings=settings)
    if (room := room_of(run.check())) is None:
        raise ConfigError(f"scenario {study.scenario} has no map, in which targets could be")
    scenes: list[Scene] = []
    for trial in plan.block(block):
        scenes.append(study.task_in(trial.cell).scene(trial, room, scenes[-1] if scenes else None))
    return scenes
