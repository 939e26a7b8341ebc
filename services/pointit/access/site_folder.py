"""The folder of a site: its authority, its router's files, a folder for each identity.

    site.json                      who there is: roles, generations, when certificates end; no secret
    authority/{ca,key}.pem         stays with whoever runs the site
    router/                        {ca,cert,key}.pem, router.json5, users.txt: goes to the router's machine
    identities/NAME/               {ca,cert,key}.pem (or password), link.json: goes to NAME's machine

Every change is written as a whole, `site.json` last but for the router's configuration, under a lock.
"""

import datetime as dt
import functools
import json
import secrets
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Literal

from pydantic import ValidationError

from pointit.access import router_configuration
from pointit.access.files import locked, read
from pointit.access.rights import Role
from pointit.access.router_configuration import RouterSite, common_name
from pointit.access.site_state import Identity, SiteState
from pointit.runtime.config.validation_message import describe_validation_error
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.atomic_file import write_atomically
from pointit.runtime.link.credentials import CA, CERTIFICATE, KEY, LINK, PASSWORD
from pointit.schemas.topics import check_name

if TYPE_CHECKING:
    from pointit.access.authority import IssuedCertificate

STATE = "site.json"
UNTRACKED = ".gitignore"
ROUTER = "router"
CONFIGURATION = "router.json5"
USERS = "users.txt"
SECRET_BYTES = 24

_keep = functools.partial(write_atomically, durable=True)
"""A certificate that was handed out must not be unknown after a power cut."""


class SiteFolder:
    """Makes and changes what a site's access rests on; each change is one call."""

    def __init__(self, path: Path) -> None:
        """Touch nothing yet."""
        self.path = path

    def state(self) -> SiteState:
        """Return who there is.

        Raises:
            ConfigError: the folder is none of a site, or cannot be read; names the file.
        """
        file = self.path / STATE
        try:
            return SiteState.model_validate_json(read(file))
        except FileNotFoundError as error:
            raise ConfigError(
                f"{self.path}: holds no site ({STATE} is missing); name the folder of one, "
                "or make one with `pointit site init NAME`"
            ) from error
        except ValidationError as error:
            raise ConfigError(f"{file}: {describe_validation_error(error, SiteState)}") from error

    def create(self, state: SiteState, names: Mapping[str, Role], now: dt.datetime) -> SiteState:
        """Make the folder with an authority, the router's files, and an identity for each of `names`.

        Git leaves it alone, wherever it is: it is full of private keys.

        Args:
            state: its settings; identities in it are ignored.
            names: role by name.
            now: with a time zone.

        Raises:
            ConfigError: there is a site already, or something cannot be written.
        """
        check_name(state.site, "site")
        with locked(self.path):
            if (self.path / STATE).exists():
                raise ConfigError(
                    f"{self.path}: holds a site already; choose another --folder, or change it with "
                    "`pointit site user`, `renew` or `revoke`"
                )
            if not (self.path / UNTRACKED).exists():
                _keep(self.path / UNTRACKED, b"*\n", mode=0o644)
            authority = _certifying().create_authority(state.site, now)
            _keep(self.path / "authority" / KEY, authority.key)
            _keep(self.path / "authority" / CA, authority.certificate, mode=0o644)
            return self._issue(state.model_copy(update={"identities": {}}), {ROUTER: "router", **names}, now)

    def add(self, names: Mapping[str, Role], now: dt.datetime) -> SiteState:
        """Add identities.

        Raises:
            ConfigError: one is there already, or something cannot be written.
        """
        with locked(self.path):
            state = self.state()
            for name in names:
                known = state.identities.get(name)
                if known is not None and known.state == "valid":
                    raise ConfigError(
                        f"{name} is there already, as {known.role}; give them a new certificate with "
                        f"`pointit site renew {name}`"
                    )
            return self._issue(state, names, now)

    def renew(self, names: Iterable[str], now: dt.datetime, hosts: Sequence[str] = ()) -> SiteState:
        """Give identities new certificates; what they had is worth nothing from now on.

        Args:
            names: whose; revoked ones come back.
            now: with a time zone.
            hosts: more names and addresses of the router, from now on.

        Raises:
            ConfigError: one is not there, or something cannot be written.
        """
        with locked(self.path):
            state = self.state()
            if hosts:
                state = state.model_copy(update={"hosts": tuple(dict.fromkeys((*state.hosts, *hosts)))})
            return self._issue(state, {name: state.known(name).role for name in names}, now)

    def revoke(self, name: str) -> SiteState:
        """Take every right from an identity.

        Raises:
            ConfigError: it is not there, or is the router.
        """
        return self._end(name, "revoked")

    def remove(self, name: str) -> SiteState:
        """Take every right from an identity, and forget it.

        Raises:
            ConfigError: it is not there, or is the router.
        """
        return self._end(name, "removed")

    def router_site(self, uplinks: tuple[str, ...] = ()) -> RouterSite:
        """Return what a router that runs on this machine needs to know of the site.

        Args:
            uplinks: addresses of other routers of the site, that it joins.

        Raises:
            ConfigError: as `state`.
        """
        return self.state().router_site(f"{(self.path / ROUTER).absolute()}/", uplinks)

    def router_files(self) -> tuple[Path, ...]:
        """Return the files whose change a router of this site must follow."""
        files = (CA, CERTIFICATE, KEY, USERS)
        return (self.path / STATE, *(self.path / ROUTER / name for name in files))

    def identity_folder(self, name: str) -> Path:
        """Return what is carried to the machine of `name`."""
        return self.path / ROUTER if name == ROUTER else self.path / "identities" / name

    def _end(self, name: str, how: Literal["revoked", "removed"]) -> SiteState:
        with locked(self.path):
            state = self.state()
            known = state.known(name)
            if known.role == "router":
                raise ConfigError(
                    "the router cannot be without a certificate; `pointit site renew router` makes a new one"
                )
            ended = known.model_copy(update={"state": how})
            state = state.model_copy(update={"identities": {**state.identities, name: ended}})
            folder = self.identity_folder(name)
            password = folder / PASSWORD
            if state.password:
                password.unlink(missing_ok=True)  # the list of passwords below is made from these
            self._write(state)
            if how == "removed":
                shutil.rmtree(folder, ignore_errors=True)
            return state

    def _issue(self, state: SiteState, names: Mapping[str, Role], now: dt.datetime) -> SiteState:
        authority = _certifying().Authority(
            read(self.path / "authority" / CA), read(self.path / "authority" / KEY)
        )
        made: dict[str, tuple[Identity, IssuedCertificate]] = {}
        for name, role in names.items():
            check_name(name, "identity")
            if (name == ROUTER) != (role == "router"):
                raise ConfigError(f"{name}: only the router is called {ROUTER}")
            before = state.identities.get(name)
            generation = 1 if before is None else before.generation + 1
            hosts = state.router_hosts() if role == "router" else ()
            issued: IssuedCertificate = authority.issue(
                common_name(state.site, name, generation), now, state.days, hosts
            )
            identity = Identity(
                role=role,
                generation=generation,
                valid_from=issued.valid_from,
                valid_until=issued.valid_until,
                fingerprint=issued.fingerprint,
            )
            made[name] = (identity, issued)
        state = state.model_copy(
            update={
                "identities": {**state.identities, **{name: identity for name, (identity, _) in made.items()}}
            }
        )
        for name, (identity, issued) in made.items():
            self._carry(state, name, identity, issued)
        self._write(state)
        return state

    def _carry(self, state: SiteState, name: str, identity: Identity, issued: "IssuedCertificate") -> None:
        """Write the folder of one identity."""
        folder = self.identity_folder(name)
        _keep(folder / CA, read(self.path / "authority" / CA), mode=0o644)
        if identity.role == "router" or not state.password:
            _keep(folder / KEY, issued.key)
            _keep(folder / CERTIFICATE, issued.certificate, mode=0o644)
        else:
            _keep(folder / PASSWORD, secrets.token_urlsafe(SECRET_BYTES).encode())
        if identity.role == "router":
            return
        _keep(folder / LINK, (state.link_file(name).model_dump_json(indent=1) + "\n").encode(), mode=0o644)

    def _write(self, state: SiteState) -> None:
        """Write the state, and what a router goes by that has no more than its own folder."""
        if state.password:
            lines = [
                f"{member.common_name}:{read(self.identity_folder(member.name) / PASSWORD).decode()}\n"
                for member in state.router_site("").members
                if member.role != "router"
            ]
            _keep(self.path / ROUTER / USERS, "".join(lines).encode())
        kept = json.dumps(state.model_dump(mode="json"), indent=1) + "\n"
        _keep(self.path / STATE, kept.encode(), mode=0o644)
        configuration = router_configuration.to_json5([state.router_site("")])
        _keep(self.path / ROUTER / CONFIGURATION, configuration.encode())


def _certifying() -> ModuleType:
    """Return the module that needs the extra, where routers only read."""
    try:
        from pointit.access import authority  # noqa: PLC0415 - see above
    except ModuleNotFoundError as error:
        raise ConfigError(
            "certificates need what `scripts/setup site` in the folder of PointIt installs"
        ) from error
    return authority
