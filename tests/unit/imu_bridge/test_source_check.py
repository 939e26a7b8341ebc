"""Checks of imu-bridge's source before it joins a site."""

from typing import Any

import pytest

from pointit.runtime.errors import ConfigError
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"source": "replay"}, "replay.recording: is missing"),
        ({"source": "replay", "replay": {"recording": "absent.csv"}}, "absent.csv"),
    ],
)
def test_source_without_its_settings_is_refused(values: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        ImuBridge.validate_config(ImuBridgeConfig.model_validate(values))


def test_a_source_that_may_be_is_not() -> None:
    ImuBridge.validate_config(ImuBridgeConfig())
    ImuBridge.validate_config(
        ImuBridgeConfig.model_validate({"source": "serial", "serial": {"port": "/dev/absent"}})
    )
