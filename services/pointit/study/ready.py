"""Checks of a study before its first trial: values of services in all cells, and files beside the YAML."""

import itertools

import pointit
from pointit.runtime.errors import ConfigError
from pointit.study.measure import load_end_rule
from pointit.study.model import Study
from pointit.study.plan import condition_of
from pointit.study.scenario import scenario_file
from pointit.study.step import Picture, read_pictures


def check_ready(study: Study) -> dict[str, Picture]:
    """Check all that could fail after the first trial; return the pictures of the study by `Step.image`.

    Raises:
        ConfigError: If a picture, the function `end` or a service's parameter in any block cannot be used.
    """
    pictures = read_pictures(study.steps, study.folder)
    load_end_rule(study.end, study.folder)
    check_services(study)
    return pictures


def check_services(study: Study) -> None:
    """Check the services' parameters in each block of each group.

    Raises:
        ConfigError: If the scenario or a value cannot be used; names the levels.
    """
    for group, block in itertools.product(study.cells("between"), study.cells("block")):
        cell = group | block
        run = pointit.run(scenario_file(study), users=[study.people[0]], settings=study.services(cell))
        try:
            run.check()
        except ConfigError as error:
            raise ConfigError(f"{condition_of(cell)}: {error}" if cell else str(error)) from error
