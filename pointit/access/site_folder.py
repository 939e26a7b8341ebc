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
import shlex
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
from pointit.schemas.text import system_reason
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
        identity = self.identities.get(name)
        if identity is not None and identity.state != "removed":
            return identity
        names: list[str] = []
        for other_name, other in self.identities.items():
            if other.state != "removed":
                names.append(other_name)
        raise ConfigError(f"site {self.site} has no {name}; it has {', '.join(names)}")

    def router_hosts(self) -> tuple[str, ...]:
        """Return the names and addresses of the router, including those on its own machine."""
        return tuple(dict.fromkeys((*self.hosts, "localhost", "127.0.0.1", "::1")))

    def router_site(self, folder: str, uplinks: tuple[str, ...] = ()) -> RouterSite:
        """Return the configuration of the site for its router.

        `folder`: of the router's own files: `""` (its own folder), or a path with trailing `/`.
        """
        members: list[Member] = []
        for name, identity in self.identities.items():
            if identity.state == "valid":
                certified_name = common_name(self.site, name, identity.generation)
                members.append(Member(name=name, role=identity.role, common_name=certified_name))
        return RouterSite(
            site=self.site,
            port=self.port,
            members=members,
            former=self._former(),
            folder=folder,
            password=self.password,
            dashboard_rate_hz=self.dashboard_rate_hz,
            uplinks=uplinks,
        )

    def link_file(self, name: str) -> LinkFile:
        """Return the link file of the identity `name`, which is not the router."""
        identity = self.identities[name]
        is_thinned = identity.role == "dashboard" and self.dashboard_rate_hz
        protocol = "quic" if is_thinned else "tls"
        endpoints: list[str] = []
        for host in self.hosts:
            url_host = f"[{host}]" if ":" in host else host
            endpoints.append(f"{protocol}/{url_host}:{self.port}")
        return LinkFile(
            site=self.site,
            name=name,
            role=identity.role,
            generation=identity.generation,
            endpoints=tuple(endpoints),
            password=self.password,
            valid_from=identity.valid_from,
            valid_until=identity.valid_until,
        )

    def _former(self) -> list[str]:
        """Return the newest common names of invalid certificates."""
        names: list[str] = []
        for name, identity in self.identities.items():
            newest = identity.generation
            if identity.state == "valid":
                newest -= 1
            oldest = max(newest - MAX_FORMER, 0) + 1
            for generation in range(oldest, newest + 1):
                names.append(common_name(self.site, name, generation))
        return names


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
        raise ConfigError(f"{folder}: cannot be written ({system_reason(error)})") from error
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
            empty = state.model_copy(update={"identities": {}})
            return self._issue(empty, {ROUTER: "router", **names}, now)

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
                        f"`pointit site renew {name} --folder {shlex.quote(str(self.path))}`"
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
                all_hosts = tuple(dict.fromkeys((*state.hosts, *hosts)))
                state = state.model_copy(update={"hosts": all_hosts})
            roles = {name: state.known(name).role for name in names}
            return self._issue(state, roles, now)

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
        folder = (self.path / ROUTER).absolute()
        return self.state().router_site(f"{folder}/", uplinks)

    def router_files(self) -> tuple[Path, ...]:
        """Return the files whose changes a router of this site must follow."""
        folder = self.path / ROUTER
        files = (CA, CERTIFICATE, KEY, USERS)
        return (self.path / STATE, *(folder / name for name in files))

    def identity_folder(self, name: str) -> Path:
        """Return the folder to copy to the machine of `name`."""
        if name == ROUTER:
            return self.path / ROUTER
        return self.path / "identities" / name

    def _end(self, name: str, new_state: Literal["revoked", "removed"]) -> SiteFolderState:
        with locked(self.path):
            state = self.state()
            identity = state.known(name)
            if identity.role == "router":
                raise ConfigError(
                    "the router cannot be without a certificate; `pointit site renew router "
                    f"--folder {shlex.quote(str(self.path))}` makes a new one"
                )
            ended = identity.model_copy(update={"state": new_state})
            state = state.model_copy(update={"identities": {**state.identities, name: ended}})

            # The password goes first, since the router's list of passwords is made from these files.
            # The other files of a revoked identity stay: it may be renewed
            folder = self.identity_folder(name)
            password = folder / PASSWORD
            if state.password:
                password.unlink(missing_ok=True)
            self._write(state)
            if new_state == "removed":
                shutil.rmtree(folder, ignore_errors=True)
            return state

    def _issue(self, state: SiteFolderState, names: Mapping[str, Role], now: dt.datetime) -> SiteFolderState:
        authority_folder = self.path / "authority"
        module = _authority_module()
        certificate_pem = _read(authority_folder / CA)
        key_pem = _read(authority_folder / KEY)
        authority = module.Authority(certificate_pem, key_pem)

        # All certificates before any file: an invalid name among them changes nothing
        certificates: dict[str, IssuedCertificate] = {}
        identities: dict[str, Identity] = {}
        for name, role in names.items():
            check_name(name, "identity")
            if (name == ROUTER) != (role == "router"):
                raise ConfigError(f"{name}: only the router is called {ROUTER}")
            previous = state.identities.get(name)
            generation = 1 if previous is None else previous.generation + 1
            hosts = state.router_hosts() if role == "router" else ()
            certified_name = common_name(state.site, name, generation)
            certificate: IssuedCertificate = authority.issue(certified_name, now, state.days, hosts)
            certificates[name] = certificate
            identities[name] = Identity(
                role=role,
                generation=generation,
                valid_from=certificate.valid_from,
                valid_until=certificate.valid_until,
                fingerprint=certificate.fingerprint,
            )

        # Link files have the state with all of them
        state = state.model_copy(update={"identities": {**state.identities, **identities}})
        for name, identity in identities.items():
            self._write_identity(state, name, identity, certificates[name])
        self._write(state)
        return state

    def _write_identity(
        self, state: SiteFolderState, name: str, identity: Identity, certificate: "IssuedCertificate"
    ) -> None:
        folder = self.identity_folder(name)
        _save(folder / CA, _read(self.path / "authority" / CA), mode=0o644)
        is_router = identity.role == "router"
        if is_router or not state.password:
            _save(folder / KEY, certificate.key)
            _save(folder / CERTIFICATE, certificate.certificate, mode=0o644)
        else:
            _save(folder / PASSWORD, secrets.token_urlsafe(SECRET_BYTES).encode())
        if is_router:
            return
        link = state.link_file(name).model_dump_json(indent=1) + "\n"
        _save(folder / LINK, link.encode(), mode=0o644)

    def _write(self, state: SiteFolderState) -> None:
        """Write the state, and the files of a router that has only its own folder."""
        router_site = state.router_site("")
        if state.password:
            lines: list[str] = []
            for member in router_site.members:
                if member.role != "router":
                    folder = self.identity_folder(member.name)
                    password = _read(folder / PASSWORD).decode()
                    lines.append(f"{member.common_name}:{password}\n")
            _save(self.path / ROUTER / USERS, "".join(lines).encode())
        content = state.model_dump_json(indent=1) + "\n"
        _save(self.path / STATE, content.encode(), mode=0o644)
        configuration = router_configuration.to_json5([router_site])
        _save(self.path / ROUTER / CONFIGURATION, configuration.encode())


def _authority_module() -> ModuleType:
    """Return the module that needs the extra. Routers that only read do not need it."""
    try:
        from pointit.access import authority  # noqa: PLC0415 - see above
    except ModuleNotFoundError as error:
        raise ConfigError(f"certificates need an extra: run {remedy('site')}") from error
    return authority
