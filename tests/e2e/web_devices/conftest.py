"""The browser of `tests/e2e/web`, for tests that may not run beside others of devices in the network."""

from tests.e2e.web.conftest import (
    browser,
    browser_address,
    pytest_runtest_makereport,
    pytest_runtest_setup,
    shared_site,
)

__all__ = ["browser", "browser_address", "pytest_runtest_makereport", "pytest_runtest_setup", "shared_site"]
