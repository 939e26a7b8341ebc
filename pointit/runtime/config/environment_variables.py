"""Names of environment variables of configurations, and their check."""

import difflib
from collections.abc import Iterable, Mapping

from pointit.runtime.errors import ConfigError

PREFIX = "POINTIT_"
LOG_FORMAT = "POINTIT_LOG_FORMAT"
"""Variable that chooses the form of logs: `plain` or `json`."""
OTHERS = ("POINTIT_CONTAINERS", "POINTIT_CREDENTIALS", "POINTIT_DATA", LOG_FORMAT, "POINTIT_STATE")
"""Variables that begin so and belong to no service: containers, places of files, and the form of logs."""
SEPARATOR = "__"
"""Between the service and its parameter, and between the parts of a nested one."""


def environment_prefix(service_name: str) -> str:
    """Return the prefix of a service's variables: `POINTIT_LED_DRIVER__`."""
    return _stem(service_name) + SEPARATOR


def check_environment(environment: Mapping[str, str], services: Iterable[str]) -> None:
    """Check that each variable with our prefix belongs to one of `services`, the names of all services.

    Raises:
        ConfigError: If a variable belongs to no service. Names the nearest.
    """
    stems = {_stem(service): service for service in services}
    for variable in sorted(environment):
        if not variable.startswith(PREFIX) or variable in OTHERS:
            continue
        if any(variable.startswith(stem + SEPARATOR) for stem in stems):
            continue
        check_spelling(variable, stems.values())
        stem, separator, parameter = variable.partition(SEPARATOR)
        name = stem.removeprefix(PREFIX)
        known_names = [known.removeprefix(PREFIX) for known in stems]
        similar = difflib.get_close_matches(name, known_names, n=1)
        if similar:
            shown = parameter if separator else "<PARAMETER>"
            hint = f"did you mean {PREFIX}{similar[0]}{SEPARATOR}{shown}?"
        else:
            hint = (
                f"variables are called POINTIT_<SERVICE>{SEPARATOR}<PARAMETER>, `pointit list` shows services"
            )
        raise ConfigError(f"variable {variable}: there is no service {name}; {hint}")


def check_spelling(variable: str, services: Iterable[str]) -> None:
    """Check that `variable` does not name one of `services` without the separator behind it.

    Raises:
        ConfigError: If it does. Says how to write it.
    """
    # of `robot` and `robot-replay`, the longer one is meant
    stems = [_stem(service) for service in services]
    for stem in sorted(stems, key=len, reverse=True):
        if not variable.startswith(stem):
            continue
        rest = variable.removeprefix(stem)
        if rest.startswith(SEPARATOR):
            return
        if rest[:1] in ("", "_"):
            parameter = rest.strip("_") or "<PARAMETER>"
            raise ConfigError(
                f"variable {variable}: two underscores stand before the parameter, "
                f"write {stem}{SEPARATOR}{parameter}"
            )


def _stem(service_name: str) -> str:
    return PREFIX + service_name.upper().replace("-", "_")
