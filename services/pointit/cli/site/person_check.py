"""Check that the credentials of a command are for the person that it starts."""

from typing import cast

from pointit.access.rights import ALL, Role, rights_of
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.options import given_credentials
from pointit.schemas.topics import USER_ALIVE


def check_person(name: str) -> None:
    """Check that the credentials are for the person `name`, or the router would reject everything.

    Raises:
        ConfigError: If the running command's credentials are another's.
    """
    credentials = given_credentials()
    if credentials is None:
        return
    link = credentials.link
    if {ALL, USER_ALIVE.at(name)}.isdisjoint(rights_of(cast("Role", link.role), link.name).announces):
        raise ConfigError(
            f"--credentials {credentials.folder}: these are of {link.name} (role {link.role}), who may not "
            f"take part as {name}; use those of {name}, made with `pointit site user add {name}`"
        )
