"""Commands that sentences advise, as their reader types them: in a shell, or beside the site's containers.

The image of `deploy/Dockerfile` sets `POINTIT_CONTAINERS`. `deploy/compose.yaml` gives it the site's name,
which begins the names of all its containers. Nothing else counts as a sign of a container.
"""

import os
from collections.abc import Iterable
from dataclasses import dataclass

CONTAINERS = "POINTIT_CONTAINERS"
"""Environment variable with the first part of the names of this site's containers. Unset outside of them."""
USUAL_SITE = "lab"
"""Site of the compose files without settings."""
COMPOSE = "podman-compose{project} -f deploy/compose.yaml"
"""Start of commands on the whole site, typed in the project's folder on the machine of the containers."""

KEEPER = "keeper"
"""Container in which commands that are of no person run, as in `deploy/README.md`."""
ROUTER = "router"


@dataclass(frozen=True)
class AdvisedCommands:
    """Forms of the commands that remedies name. Pure."""

    containers: str = ""
    """First part of the names of the site's containers. `""` if PointIt does not run in containers."""

    def command(self, command: str, container: str = KEEPER) -> str:
        """Return `command`, such as `pointit doctor`, in backquotes.

        `container`: where it runs, if PointIt runs in containers: the name of a person or service.
        """
        if not self.containers:
            return f"`{command}`"
        return f"`podman exec {self.containers}-{container} {command}`"

    def restart(self, containers: Iterable[str]) -> str:
        """Return the command that starts `containers` again, whether they run or not, in backquotes."""
        names = " ".join(f"{self.containers}-{container}" for container in containers)
        return f"`podman restart {names}`"

    def compose(self, action: str) -> str:
        """Return the command for an action on the whole site, such as `up -d`, in backquotes."""
        settings = ""
        project = ""
        if self.containers != USUAL_SITE:
            settings = f"SITE={self.containers} "
            project = f" -p {self.containers}"
        return f"`{settings}{COMPOSE.format(project=project)} {action}`"

    def site(self, arguments: str) -> str:
        """Return the command `pointit site ARGUMENTS` in backquotes."""
        if not self.containers:
            return f"`pointit site {arguments}`"
        return self.compose(f"run --rm --no-deps init site {arguments}")

    def renewal(self, name: str) -> str:
        """Return the clause after `renew it with` by which new credentials of `name` arrive here."""
        command = self.site(f"renew {name}")
        if self.containers:
            return f"{command} and distribute them as deploy/README.md says, *Identities and their validity*"
        return f"{command} and copy the folder here"

    def start_router(self) -> str:
        """Return the command that starts the site's router."""
        return self.restart([ROUTER]) if self.containers else "`pointit router`"


def advised_commands() -> AdvisedCommands:
    """Return the forms for the readers of what this process prints or reports."""
    return AdvisedCommands(os.environ.get(CONTAINERS, ""))
