"""Selection methods by name, in the order of tables."""

from pydantic import ValidationError

from pointit.runtime.errors import ConfigError
from pointit.schemas import summarize_validation_error
from pointit.services.selector.config import JournalConfig, SelectorConfig

_NO_JOURNAL = JournalConfig(enabled=False)

METHODS: dict[str, SelectorConfig] = {
    "original": SelectorConfig(
        method="fraction", window_s=0.5, fraction=0.8, margin_m=0.05, journal=_NO_JOURNAL
    ),
    "hold": SelectorConfig(method="hold", journal=_NO_JOURNAL),
    "fraction": SelectorConfig(method="fraction", journal=_NO_JOURNAL),
    "gauge": SelectorConfig(method="gauge", journal=_NO_JOURNAL),
}
"""Methods; `original` is the paper's second one with its system's settings, 10 Hz and 4 of 5 timesteps."""


def selector_config(name: str) -> SelectorConfig:
    """Return the parameters of the method `name`, one of `METHODS`, with `@S` for a dwell time of S seconds.

    Raises:
        ConfigError: If there is no such method, or the time is invalid.
    """
    base, at, seconds = name.partition("@")
    config = METHODS.get(base)
    if config is None:
        names = ", ".join(METHODS)
        raise ConfigError(f"--method {name}: there is no such method; there are {names}")
    if not at:
        return config
    try:
        full_s = float(seconds)
    except ValueError:
        expected = "seconds were expected after the @"
        raise ConfigError(f"--method {name}: {expected}, as in {base}@0.6") from None
    # the dwell time of `gauge` is that of its filling, whose ratio between sparse and dense stays
    fields = dict(config)
    if config.method == "gauge":
        gauge = config.gauge
        share = gauge.sparse_full_s / gauge.full_s
        times = {"full_s": full_s, "sparse_full_s": share * full_s}
        fields["gauge"] = dict(gauge) | times
    else:
        fields["window_s"] = full_s
    try:
        return SelectorConfig.model_validate(fields)
    except ValidationError as error:
        problem = summarize_validation_error(error)
        raise ConfigError(f"--method {name}: {problem}") from error
