"""Identities of a site: content of `site.json`, and what its router and its identities get from it."""

import datetime as dt
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from pointit.access.rights import Role
from pointit.access.router_configuration import Member, RouterSite, common_name
from pointit.runtime.config.config import Config
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.credentials import LinkFile

MAX_FORMER = 20
"""Limit of an identity's former certificates that are named if still in use."""


class Identity(Config):
    """A client that may connect, and its certificate."""

    role: Role
    generation: Annotated[int, Field(ge=1)]
    """Raised with every new certificate, as the router knows the newest only."""
    state: Literal["valid", "revoked", "removed"] = "valid"
    valid_from: dt.datetime
    valid_until: dt.datetime
    fingerprint: str = ""


class SiteState(Config):
    """Content of `site.json`."""

    site: str
    hosts: tuple[str, ...]
    port: Annotated[int, Field(ge=1, le=65535)]
    days: float
    password: bool
    dashboard_rate_hz: float
    identities: Mapping[str, Identity]
    """Identities by name. Removed ones stay, so that their generations are never reused."""

    def known(self, name: str) -> Identity:
        """Return the identity `name`, valid or revoked.

        Raises:
            ConfigError: If it does not exist, or was removed.
        """
        known = self.identities.get(name)
        if known is None or known.state == "removed":
            names = ", ".join(each for each, one in self.identities.items() if one.state != "removed")
            raise ConfigError(f"site {self.site} has no {name}; it has {names}")
        return known

    def router_hosts(self) -> tuple[str, ...]:
        """Return the names and addresses of the router, including those on its own machine."""
        return tuple(dict.fromkeys((*self.hosts, "localhost", "127.0.0.1", "::1")))

    def router_site(self, folder: str, uplinks: tuple[str, ...] = ()) -> RouterSite:
        """Return the configuration of the site for its router.

        `folder`: of the router's own files: `""` (its own folder), or a path with trailing `/`.
        """
        return RouterSite(
            site=self.site,
            port=self.port,
            members=[
                Member(
                    name=name,
                    role=identity.role,
                    common_name=common_name(self.site, name, identity.generation),
                )
                for name, identity in self.identities.items()
                if identity.state == "valid"
            ],
            former=self._former(),
            folder=folder,
            password=self.password,
            dashboard_rate_hz=self.dashboard_rate_hz,
            uplinks=uplinks,
        )

    def link_file(self, name: str) -> LinkFile:
        """Return the link file of the identity `name`, which is not the router."""
        identity = self.identities[name]
        hosts = [f"[{host}]" if ":" in host else host for host in self.hosts]
        protocol = "quic" if identity.role == "dashboard" and self.dashboard_rate_hz else "tls"
        return LinkFile(
            site=self.site,
            name=name,
            role=identity.role,
            generation=identity.generation,
            endpoints=tuple(f"{protocol}/{host}:{self.port}" for host in hosts),
            password=self.password,
            valid_from=identity.valid_from,
            valid_until=identity.valid_until,
        )

    def _former(self) -> list[str]:
        """Return the newest common names of invalid certificates."""
        found: list[str] = []
        for name, identity in self.identities.items():
            newest = identity.generation - (identity.state == "valid")
            found += [
                common_name(self.site, name, generation)
                for generation in range(max(newest - MAX_FORMER, 0) + 1, newest + 1)
            ]
        return found
