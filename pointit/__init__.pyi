# Types of the public names, which `__init__.py` loads at their first use.

from pointit import errors as errors
from pointit.api.connection import connect as connect
from pointit.api.connection import open as open  # noqa: A004 - `pointit.open`
from pointit.api.run import run as run
from pointit.api.site import Site as Site
from pointit.api.sync_site import SyncSite as SyncSite
from pointit.errors import PointItError as PointItError
from pointit.runtime.virtual_time import run_virtually as run_virtually

__version__: str
