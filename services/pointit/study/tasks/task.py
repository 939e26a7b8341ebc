"""Any task that is ready."""

from typing import Annotated

from pydantic import Field

from pointit.study.tasks.robots import Localize, Steer
from pointit.study.tasks.targets import Packages, Places, Reach, Tapping

Task = Annotated[Reach | Tapping | Packages | Places | Steer | Localize, Field(discriminator="kind")]
