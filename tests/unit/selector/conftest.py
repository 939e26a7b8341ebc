"""Files of sites with shards, which end with the test."""

from collections.abc import Iterator

import pytest

from tests.unit.selector.shards import OPEN_FILES


@pytest.fixture(autouse=True)
def closed_files() -> Iterator[None]:
    """Close the files of a test's sites."""
    with OPEN_FILES:
        yield
