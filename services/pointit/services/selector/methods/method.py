"""Another method or dwell time than configured, while people go on pointing."""

from typing import Any

from pointit.services.selector.config import Method, SelectorConfig

LONGEST_S = 10.0
"""To stay on an object, by any method."""


def apply_method(
    configured: SelectorConfig, in_use: SelectorConfig, method: Method | None, dwell_s: float | None
) -> SelectorConfig:
    """Return what is to be used from now on.

    Args:
        configured: as at the start: a method's own times, and how those of the gauge are to each other.
        in_use: now.
        method: none: as it is.
        dwell_s: time on an object that selects it; none: as it is, or the own one of a method that is named.

    Raises:
        ValueError: it cannot be so; says why in one sentence.
    """
    if method is None and dwell_s is None:
        return in_use
    named = configured.model_copy(update={"method": in_use.method if method is None else method})
    return named if dwell_s is None else _staying(named, dwell_s)


def _staying(config: SelectorConfig, dwell_s: float) -> SelectorConfig:
    own: dict[str, Any] = {"window_s": dwell_s}
    if config.method == "gauge":
        sparse_s = dwell_s * config.gauge.sparse_full_s / config.gauge.full_s
        if not 0.0 < sparse_s <= LONGEST_S:
            raise ValueError(
                f"with {dwell_s:g} s the gauge of an object that has none beside it would take "
                f"{sparse_s:g} s, at most {LONGEST_S:g} s is possible: choose a shorter time"
            )
        own = {"gauge": config.gauge.model_copy(update={"full_s": dwell_s, "sparse_full_s": sparse_s})}
    elif dwell_s < config.timestep_s:
        raise ValueError(
            f"{dwell_s:g} s is less than the timestep of {config.timestep_s:g} s in which {config.method} "
            "looks at cursors: choose a longer time, or the gauge"
        )
    return config.model_copy(update=own)
