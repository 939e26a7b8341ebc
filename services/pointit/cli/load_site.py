"""A secured site for a load test: certificates, access rules, and one identity that may be everybody."""

import datetime as dt
from pathlib import Path

from pointit.access.site_folder import SiteFolder
from pointit.access.site_state import SiteState
from pointit.runtime.credentials import Credentials, read_credentials

NAME = "load"


def secured_site(folder: Path, site: str, port: int) -> Credentials:
    """Make the site in `folder`, for a router on this machine; return who drives its services and people.

    Raises:
        ConfigError: `cryptography` is missing, or something cannot be written.
    """
    now = dt.datetime.now(dt.UTC)
    made = SiteFolder(folder)
    state = SiteState(
        site=site,
        hosts=("127.0.0.1",),
        port=port,
        days=1.0,
        password=False,
        dashboard_rate_hz=0.0,
        identities={},
    )
    made.found(state, {NAME: "supervisor"}, now)
    return read_credentials(made.identity_folder(NAME), now)
