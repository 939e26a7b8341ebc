"""Parameters of pointing."""

from pydantic import Field

from pointit.runtime.config import Config


class PointingConfig(Config):
    """When an orientation still makes a ray."""

    stale_after_s: float = Field(
        default=0.2,
        gt=0,
        le=10,
        description="samples older, or so far in the future, make no ray, s",
    )
    profile_wait_s: float = Field(
        default=1.0,
        ge=0,
        le=60,
        description="wait for the person's measures so long at the start, then go on with common ones, s",
    )
