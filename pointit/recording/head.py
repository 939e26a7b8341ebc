"""The head of a recording: facts about where and by what it was made."""

import platform
from typing import Annotated, ClassVar

from pydantic import Field

from pointit.runtime.host.extras import pointit_version
from pointit.schemas import SchemaModel
from pointit.schemas.base import Many, Ns

METADATA = "pointit"
"""Name of the MCAP metadata record with the head, which stands at the beginning of the file."""

FORMAT = 1
"""Format of recordings. It is raised when readers of the old one could not read the new one."""


class Head(SchemaModel):
    """Facts about a recording. What a replay starts from are its first entries: configurations and states."""

    max_bytes: ClassVar[int] = 16 * 1024

    site: str
    began_ns: Annotated[Ns, Field(description="site time of its beginning, Unix ns")]
    version: Annotated[str, Field(description="version of PointIt")] = ""
    python: str = ""
    seed: Annotated[int | None, Field(description="seed of the run that recorded itself")] = None
    without: Annotated[Many[str], Field(description="omitted topics, such as imu")] = ()
    pseudonyms: Annotated[bool, Field(description="people are called person-1, person-2 and so on")] = False
    format: int = FORMAT


def make_head(
    site: str,
    began_ns: int,
    *,
    seed: int | None = None,
    without: tuple[str, ...] = (),
    pseudonyms: bool = False,
) -> Head:
    """Return the head of a recording that this process begins now."""
    return Head(
        site=site,
        began_ns=began_ns,
        version=pointit_version(),
        python=platform.python_version(),
        seed=seed,
        without=without,
        pseudonyms=pseudonyms,
    )
