"""Checks of a study before its first trial: values of services in all cells, and files beside the YAML."""

from pointit.runtime.errors import ConfigError
from pointit.study.measure import load_end_rule
from pointit.study.model import Study
from pointit.study.plan import plan_of
from pointit.study.site.scenario import scenes_of
from pointit.study.step import Picture, read_pictures


def check_ready(study: Study) -> dict[str, Picture]:
    """Check all that could fail after the first trial; return the pictures of the study by `Step.image`.

    Raises: ConfigError: If a picture, the function `end` or a service's parameter in any block cannot be
    used.
    """
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
                scenes_of(study, plan, block, study.services(plan.block(block)[0].cell))
            except ConfigError as error:
                levels = ", ".join([*plan.group.values(), *([name] if name else [])])
                raise ConfigError(f"{levels}: {error}" if levels else str(error)) from error
