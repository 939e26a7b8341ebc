"""Parameters of the listener."""

from pydantic import Field

from pointit.runtime.config.config import Config


class ListenerConfig(Config):
    """Length of the memory, and the clock of the recogniser.

    The memory is never written to a file or published.
    """

    memory_s: float = Field(default=10.0, ge=2, le=30, description="time for which rays are kept, s")
    clock_s: float = Field(
        default=0.3,
        gt=0,
        le=10,
        description="health warns if words of a recogniser end so much later than they arrive, s",
    )
