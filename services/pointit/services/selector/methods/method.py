"""The method in use for each person, and its change or that of the dwell time at run time."""

from collections.abc import Callable
from typing import Any, Literal, TypeGuard

from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_methods import (
    MAX_DWELL_S,
    METHODS,
    MethodConfig,
    PersonMethod,
    detached,
)

MakeMethod = Callable[[SelectorConfig, str], PersonMethod]
"""Makes the configured method for a user."""


def make_method(config: SelectorConfig, user: str) -> PersonMethod:
    """Return the configured method for `user`, outside a site."""
    return METHODS.get(config.method).make(config.section(config.method), detached(user))


def is_ours(method: str) -> TypeGuard[Literal["hold", "fraction", "gauge"]]:
    """Return True if `method` is one of this project."""
    return method in ("hold", "fraction", "gauge")


def is_by_angle(config: SelectorConfig) -> bool:
    """Return True if the configured method finds objects by their angle from the ray."""
    return METHODS.get(config.method).by_angle


def apply_method(
    configured: SelectorConfig, in_use: SelectorConfig, method: str | None, dwell_s: float | None
) -> SelectorConfig:
    """Return the configuration to use from now on.

    Args:
        configured: configuration at the start, with the times of each method and the ratio of those of the
            gauge.
        in_use: current configuration.
        method: new method. None: unchanged.
        dwell_s: time on an object that selects it. None: unchanged, or the method's own if `method` is given.

    Raises:
        ValueError: If it is impossible. The message gives the reason.
        ConfigError: If the method is not installed or cannot be imported.
    """
    if method is not None:
        METHODS.get(method)
    if method is None and dwell_s is None:
        return in_use
    named = configured.model_copy(update={"method": in_use.method if method is None else method})
    return named if dwell_s is None else _staying(named, dwell_s)


def _staying(config: SelectorConfig, dwell_s: float) -> SelectorConfig:
    section = config.section(config.method)
    if isinstance(section, MethodConfig):
        return config.model_copy(update={config.method: section.with_dwell(dwell_s)})
    own: dict[str, Any] = {"window_s": dwell_s}
    if config.method == "gauge":
        sparse_s = dwell_s * config.gauge.sparse_full_s / config.gauge.full_s
        if not 0.0 < sparse_s <= MAX_DWELL_S:
            raise ValueError(
                f"with {dwell_s:g} s the gauge of an isolated object would take "
                f"{sparse_s:.9g} s, limit {MAX_DWELL_S:g} s: choose a shorter time"
            )
        own = {"gauge": config.gauge.model_copy(update={"full_s": dwell_s, "sparse_full_s": sparse_s})}
    elif dwell_s < config.timestep_s:
        raise ValueError(
            f"{dwell_s:.9g} s is less than the timestep of {config.timestep_s:g} s of method "
            f"{config.method}: choose a longer time, or the gauge"
        )
    return config.model_copy(update=own)
