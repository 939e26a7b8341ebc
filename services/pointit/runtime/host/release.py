"""The version of PointIt that runs."""

import functools
from importlib.metadata import PackageNotFoundError, version


@functools.cache
def pointit_version() -> str:
    """Return the version of PointIt, or `""` if its sources run without being installed."""
    try:
        return version("pointit")
    except PackageNotFoundError:
        return ""
