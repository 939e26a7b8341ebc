"""The scenario of a session, and the check of all that could fail after the first trial."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import pointit
from pointit.errors import ConfigError
from pointit.launch.plan.scenario_catalog import room_of
from pointit.runtime.config.yaml_edit import dump_yaml
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.host.state_file import write_atomically
from pointit.study.measure import load_end_rule
from pointit.study.model import SHIPPED, Study
from pointit.study.plan import StudyPlan, check_names, plan_of
from pointit.study.study_step import Picture, read_pictures
from pointit.study.tasks import StudyScene


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
    write_atomically(copy, dump_yaml(content).encode(), mode=0o644)
    return copy


def scenes_of(study: Study, plan: StudyPlan, block: int, settings: Mapping[str, object]) -> list[StudyScene]:
    """Return the scenes of all trials of a block, in their order, without starting anything.

    Raises: ConfigError: If the scenario or a parameter of `settings` cannot be used, or the room lacks a
    target.
    """
    run = pointit.run(scenario_file(study), users=[plan.participant], settings=settings)
    if (room := room_of(run.check())) is None:
        raise ConfigError(f"scenario {study.scenario} has no map, in which targets could be")
    scenes: list[StudyScene] = []
    previous: StudyScene | None = None
    for trial in plan.block(block):
        task = study.task_in(trial.cell)
        previous = task.scene(trial, room, previous)
        scenes.append(previous)
    return scenes


def check_ready(study: Study) -> dict[str, Picture]:
    """Check all that could fail after the first trial; return the pictures of the study by `Step.image`.

    Raises: ConfigError: If a name, a picture, the function `end` or a service's parameter in any block cannot
        be used.
    """
    check_names(study)
    pictures = read_pictures(study.steps, study.folder)
    load_end_rule(study.end, study.folder)
    check_services(study)
    return pictures


def check_services(study: Study) -> None:
    """Check the services' parameters in each block of each group, and that the room has all targets.

    Raises: ConfigError: If the scenario, a value or a target cannot be used; names the levels.
    """
    for group in range(len(study.cells("between"))):
        plan = plan_of(study, study.people[group])
        for block, name in enumerate(plan.order, 1):
            try:
                first_trial = plan.block(block)[0]
                scenes_of(study, plan, block, study.services(first_trial.cell))
            except ConfigError as error:
                names = [*plan.group.values()]
                if name:
                    names.append(name)
                levels = ", ".join(names)
                raise ConfigError(f"{levels}: {error}" if levels else str(error)) from error
