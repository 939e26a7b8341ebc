"""The folder of a site: its identities in `site.json`, its authority, its router's files.

    site.json                      identities: roles, generations, validity of certificates; no secret
    authority/{ca,key}.pem         stays with the operator of the site
    router/                        {ca,cert,key}.pem, router.json5, users.txt: goes to the router's machine
    identities/NAME/               {ca,cert,key}.pem (or password), link.json: goes to NAME's machine

Every change is written atomically, `site.json` last but for the router's configuration, under a lock.
"""

import contextlib
import datetime as dt
import functools
import secrets
import shutil
import sqlite3
from collections.abc import Generator, Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, ValidationError

from pointit.access import router_configuration
from pointit.access.rights import Role
from pointit.access.router_configuration import Member, RouterSite, common_name
from pointit.runtime.config.config import Config
from pointit.runtime.config.validation_message import describe_validation_error
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.runtime.host.state_file import read_limited, write_atomically
from pointit.runtime.host.store import acquire_lock
from pointit.runtime.link.link import CA, CERTIFICATE, KEY, LINK, PASSWORD, LinkFile
from pointit.schemas.topics import check_name

if TYPE_CHECKING:
    from pointit.access.authority import IssuedCertificate


MAX_FORMER = 20
"""Limit of an identity's former certificates that are named if still in use."""

LOCK = ".lock"
STATE = "site.json"
UNTRACKED = ".gitignore"
ROUTER = "router"
CONFIGURATION = "router.json5"
USERS = "users.txt"
SECRET_BYTES = 24

_read = functools.partial(read_limited, max_bytes=16 * 1024 * 1024)
_save = functools.partial(write_atomically, durable=True)
"""Durable, as a certificate that was handed out must not be unknown after a power cut."""


class Identity(Config):
    """A client that may connect, and its certificate."""

    role: Role
    generation: Annotated[int, Field(ge=1)]
    """Raised with every new certificate, as the router knows the newest only."""
    state: Literal["valid", "revoked", "removed"] = "valid"
    valid_from: dt.datetime
    valid_until: dt.datetime
    fingerprint: str = ""


class SiteFolderState(Config):
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


@contextlib.contextmanager
def locked(folder: Path) -> Generator[None]:
    """Lock the folder in the context. It is created if missing.

    Raises:
        ConfigError: If another process changes it, or it cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        lock = acquire_lock(folder / LOCK)
    except (OSError, sqlite3.Error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise ConfigError(f"{folder}: cannot be written ({reason})") from error
    if lock is None:
        raise ConfigError(f"{folder}: another process is changing it; try again in a moment")
    with contextlib.closing(lock):
        yield


class SiteFolder:
    """Creates and changes the credentials of a site. Each change is one call."""

    def __init__(self, path: Path) -> None:
        """Create without file access."""
        self.path = path

    def state(self) -> SiteFolderState:
        """Return the state of the site.

        Raises:
            ConfigError: If it is not the folder of a site, or cannot be read. Names the file.
        """
        file = self.path / STATE
        try:
            return SiteFolderState.model_validate_json(_read(file))
        except FileNotFoundError as error:
            raise ConfigError(
                f"{self.path}: is not the folder of a site ({STATE} is missing); give the right one, "
                "or create one with `pointit site init NAME`"
            ) from error
        except ValidationError as error:
            raise ConfigError(f"{file}: {describe_validation_error(error, SiteFolderState)}") from error

    def create(self, state: SiteFolderState, names: Mapping[str, Role], now: dt.datetime) -> SiteFolderState:
        """Create the folder with an authority, the router's files, and an identity for each of `names`.

        It is excluded from Git anywhere, as it is full of private keys.

        Raises:
            ConfigError: If there is a site already, or a file cannot be written.
        """
        check_name(state.site, "site")
        with locked(self.path):
            if (self.path / STATE).exists():
                raise ConfigError(
                    f"{self.path}: holds a site already; choose another --folder, or change it with "
                    "`pointit site user`, `renew` or `revoke`"
                )
            if not (self.path / UNTRACKED).exists():
                _save(self.path / UNTRACKED, b"*\n", mode=0o644)
            authority = _authority_module().create_authority(state.site, now)
            _save(self.path / "authority" / KEY, authority.key)
            _save(self.path / "authority" / CA, authority.certificate, mode=0o644)
            return self._issue(state.model_copy(update={"identities": {}}), {ROUTER: "router", **names}, now)

    def add(self, names: Mapping[str, Role], now: dt.datetime) -> SiteFolderState:
        """Add identities.

        Raises:
            ConfigError: If one exists already, or a file cannot be written.
        """
        with locked(self.path):
            state = self.state()
            for name in names:
                known = state.identities.get(name)
                if known is not None and known.state == "valid":
                    raise ConfigError(
                        f"{name} exists already, as {known.role}; renew its certificate with "
                        f"`pointit site renew {name} --folder {self.path}`"
                    )
            return self._issue(state, names, now)

    def renew(self, names: Iterable[str], now: dt.datetime, hosts: Sequence[str] = ()) -> SiteFolderState:
        """Issue new certificates for identities. Their old ones become invalid immediately.

        Revoked ones become valid again. `hosts`: additional names and addresses of the router.

        Raises:
            ConfigError: If one does not exist, or a file cannot be written.
        """
        with locked(self.path):
            state = self.state()
            if hosts:
                state = state.model_copy(update={"hosts": tuple(dict.fromkeys((*state.hosts, *hosts)))})
            return self._issue(state, {name: state.known(name).role for name in names}, now)

    def revoke(self, name: str) -> SiteFolderState:
        """Revoke all rights of an identity.

        Raises:
            ConfigError: If it does not exist, or is the router.
        """
        return self._end(name, "revoked")

    def remove(self, name: str) -> SiteFolderState:
        """Revoke all rights of an identity, and delete it.

        Raises:
            ConfigError: If it does not exist, or is the router.
        """
        return self._end(name, "removed")

    def router_site(self, uplinks: tuple[str, ...] = ()) -> RouterSite:
        """Return the configuration of the site for a router on this machine, which connects to `uplinks`.

        Raises:
            ConfigError: As for `state`.
        """
        return self.state().router_site(f"{(self.path / ROUTER).absolute()}/", uplinks)

    def router_files(self) -> tuple[Path, ...]:
        """Return the files whose changes a router of this site must follow."""
        files = (CA, CERTIFICATE, KEY, USERS)
        return (self.path / STATE, *(self.path / ROUTER / name for name in files))

    def identity_folder(self, name: str) -> Path:
        """Return the folder to copy to the machine of `name`."""
        return self.path / ROUTER if name == ROUTER else self.path / "identities" / name

    def _end(self, name: str, how: Literal["revoked", "removed"]) -> SiteFolderState:
        with locked(self.path):
            state = self.state()
            known = state.known(name)
            if known.role == "router":
                raise ConfigError(
                    "the router cannot be without a certificate; `pointit site renew router "
                    f"--folder {self.path}` makes a new one"
                )
            ended = known.model_copy(update={"state": how})
            state = state.model_copy(update={"identities": {**state.identities, name: ended}})
            folder = self.identity_folder(name)
            password = folder / PASSWORD
            if state.password:
                password.unlink(missing_ok=True)  # the list of passwords is made from these
            self._write(state)
            if how == "removed":
                shutil.rmtree(folder, ignore_errors=True)
            return state

    def _issue(self, state: SiteFolderState, names: Mapping[str, Role], now: dt.datetime) -> SiteFolderState:
        authority = _authority_module().Authority(
            _read(self.path / "authority" / CA), _read(self.path / "authority" / KEY)
        )
        made: dict[str, tuple[Identity, IssuedCertificate]] = {}
        for name, role in names.items():
            check_name(name, "identity")
            if (name == ROUTER) != (role == "router"):
                raise ConfigError(f"{name}: only the router is called {ROUTER}")
            before = state.identities.get(name)
            generation = 1 if before is None else before.generation + 1
            hosts = state.router_hosts() if role == "router" else ()
            common = common_name(state.site, name, generation)
            issued: IssuedCertificate = authority.issue(common, now, state.days, hosts)
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

    def _carry(
        self, state: SiteFolderState, name: str, identity: Identity, issued: "IssuedCertificate"
    ) -> None:
        folder = self.identity_folder(name)
        _save(folder / CA, _read(self.path / "authority" / CA), mode=0o644)
        if identity.role == "router" or not state.password:
            _save(folder / KEY, issued.key)
            _save(folder / CERTIFICATE, issued.certificate, mode=0o644)
        else:
            _save(folder / PASSWORD, secrets.token_urlsafe(SECRET_BYTES).encode())
        if identity.role == "router":
            return
        _save(folder / LINK, (state.link_file(name).model_dump_json(indent=1) + "\n").encode(), mode=0o644)

    def _write(self, state: SiteFolderState) -> None:
        """Write the state, and the files of a router that has only its own folder."""
        if state.password:
            lines = [
                f"{member.common_name}:{_read(self.identity_folder(member.name) / PASSWORD).decode()}\n"
                for member in state.router_site("").members
                if member.role != "router"
            ]
            _save(self.path / ROUTER / USERS, "".join(lines).encode())
        _save(self.path / STATE, (state.model_dump_json(indent=1) + "\n").encode(), mode=0o644)
        configuration = router_configuration.to_json5([state.router_site("")])
        _save(self.path / ROUTER / CONFIGURATION, configuration.encode())


def _authority_module() -> ModuleType:
    """Return the module that needs the extra. Routers that only read do not need it."""
    try:
        from pointit.access import authority  # noqa: PLC0415 - see above
    except ModuleNotFoundError as error:
        raise ConfigError(f"certificates need an extra: run {remedy('site')}") from error
    return authority
