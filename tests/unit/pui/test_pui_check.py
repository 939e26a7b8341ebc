"""Checks of pui's map before it joins a site."""

import pytest

from pointit.runtime.errors import ConfigError
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui


def test_a_map_that_cannot_be_used_is_told() -> None:
    Pui.validate_config(PuiConfig(map="lab"))
    with pytest.raises(ConfigError, match=r"absent\.yaml: cannot be read"):
        Pui.validate_config(PuiConfig(map="absent.yaml"))
