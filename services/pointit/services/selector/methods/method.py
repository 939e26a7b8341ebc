"""Change of the method or dwell time at run time."""

from typing import Any

from pointit.services.selector.config import Method, SelectorConfig

MAX_DWELL_S = 10.0
"""Upper limit of the dwell time by any method, s."""


def apply_method(
    configured: SelectorConfig, in_use: SelectorConfig, method: Method | None, dwell_s: float | None
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
    """
    if method is None and dwell_s is None:
        return in_use
    named = configured.model_copy(update={"method": in_use.method if method is None else method})
    return named if dwell_s is None else _staying(named, dwell_s)


def _staying(config: SelectorConfig, dwell_s: float) -> SelectorConfig:
    own: dict[str, Any] = {"window_s": dwell_s}
    if config.method == "gauge":
        sparse_s = dwell_s * config.gauge.sparse_full_s / config.gauge.full_s
        if not 0.0 < sparse_s <= MAX_DWELL_S:
            raise ValueError(
                f"with {dwell_s:g} s the gauge of an isolated object would take "
                f"{sparse_s:g} s, limit {MAX_DWELL_S:g} s: choose a shorter time"
            )
        own = {"gauge": config.gauge.model_copy(update={"full_s": dwell_s, "sparse_full_s": sparse_s})}
    elif dwell_s < config.timestep_s:
        raise ValueError(
            f"{dwell_s:g} s is less than the timestep of {config.timestep_s:g} s of method "
            f"{config.method}: choose a longer time, or the gauge"
        )
    return config.model_copy(update=own)
