"""Parameters of selecting."""

from typing import Literal, Self

from pydantic import Field, model_validator

from pointit.runtime.config import Config


class SelectorConfig(Config):
    """When a cursor is on an object, and when staying there toggles it."""

    method: Literal["hold", "fraction"] = Field(
        default="hold",
        description="hold: on the same object at every timestep of the window; fraction: on a share of them",
    )
    window_s: float = Field(default=0.8, gt=0, le=10, description="time on an object that toggles it, s")
    timestep_s: float = Field(
        default=0.1, ge=0.005, le=2, description="the window is looked at in steps of this, s"
    )
    fraction: float = Field(
        default=0.8, gt=0, le=1, description="share of the window's timesteps that `fraction` asks for"
    )
    release_s: float = Field(
        default=0.5, gt=0, le=10, description="time off a toggled object before it can be toggled again, s"
    )
    margin_m: float = Field(
        default=0.05, ge=0, le=2, description="the cursor may be this far beside an object, m"
    )
    objects_stale_after_s: float = Field(
        default=1.0, gt=0, le=60, description="objects not heard of for longer cannot be hovered, s"
    )
    ownerless_after_s: float = Field(
        default=5.0,
        ge=0,
        le=3600,
        description="what a person selected who left so long ago may be deselected by anybody, s",
    )

    @model_validator(mode="after")
    def _window_holds_a_timestep(self) -> Self:
        if self.window_s < self.timestep_s:
            raise ValueError(f"window_s ({self.window_s}) must be at least timestep_s ({self.timestep_s})")
        return self
