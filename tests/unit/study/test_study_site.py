"""Changes of parameters: those that a running site takes, and those that need another one."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from pointit.study.site.study_site import StudySite

GAUGE = {"selector.method": "gauge", "selector.gauge.full_s": 0.8}


@pytest.mark.parametrize(
    ("before", "after", "is_live"),
    [
        (GAUGE, {**GAUGE, "selector.gauge.full_s": 1.2}, True),
        (GAUGE, {"selector.method": "hold", "selector.window_s": 0.5}, False),  # full_s gets its default
        ({"selector.gauge.full_s": 0.8}, {"selector.gauge.full_s": 1.2}, False),  # of which method?
        ({**GAUGE, "selector.window_s": 0.5}, {**GAUGE, "selector.window_s": 0.9}, False),
        ({"pui.smoothing": 1}, {"pui.smoothing": 2}, False),
    ],
)
def test_dwell_time_is_live_for_the_method_that_is_set_only(
    before: dict[str, Any],
    after: dict[str, Any],
    is_live: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    site: Any = SimpleNamespace(tracker=MagicMock(return_value=None))
    assert StudySite(site, "P01", before, None).is_live(after) is is_live  # type: ignore[arg-type]
