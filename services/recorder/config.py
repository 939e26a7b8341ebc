"""Parameters of recorder."""

from pydantic import Field

from pointit.runtime.config.config import Config


class RecorderConfig(Config):
    """File of the recording, and filters of its content."""

    file: str = Field(
        default="",
        description="output file; an existing one is never overwritten. If empty, pointit-SITE-TIME.mcap "
        "in the current folder",
    )
    without: tuple[str, ...] = Field(
        default=(), description="topics to leave out, by a part of their key, such as imu or strips"
    )
    pseudonyms: bool = Field(
        default=False, description="call people person-1, person-2 and so on in keys and in messages"
    )
    person: str = Field(
        default="",
        description="record the movements of this person only; an identity of a person may read no others",
    )
    seed: int | None = Field(default=None, description="seed of the run, noted at the head of the file")
