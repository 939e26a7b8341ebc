"""Variables that are without effect are mistakes, not silence."""

import pytest

from pointit.runtime.config.environment import check_environment, environment_prefix
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.process import load_config
from pointit.services.registry import PROCESSES
from pointit.services.selector.service import Selector

SERVICES = [process.name for process in PROCESSES]


def test_variables_of_services_are_accepted() -> None:
    fine = {f"{environment_prefix(name)}ANYTHING": "1" for name in SERVICES}
    check_environment(
        {**fine, "POINTIT_DATA": "/data", "HOME": "/", "POINTITX": "", "XPOINTIT_Y": ""}, SERVICES
    )


@pytest.mark.parametrize(
    ("variable", "said"),
    [
        ("POINTIT_SELEKTOR__X", "there is no service SELEKTOR; did you mean POINTIT_SELECTOR__X?"),
        ("POINTIT_SELECTOR_WINDOW_S", "before the parameter, write POINTIT_SELECTOR__WINDOW_S"),
        ("POINTIT_SELECTOR", "before the parameter, write POINTIT_SELECTOR__<PARAMETER>"),
        ("POINTIT_LED_DRIVER_GAMMA", "before the parameter, write POINTIT_LED_DRIVER__GAMMA"),
        (
            "POINTIT_LEDDRIVER__GAMMA",
            "there is no service LEDDRIVER; did you mean POINTIT_LED_DRIVER__GAMMA?",
        ),
        ("POINTIT_IMU_BRIDGE_SERIAL__PORT", "write POINTIT_IMU_BRIDGE__SERIAL__PORT"),
        ("POINTIT_ROBOT_REPLAY_SPEED", "write POINTIT_ROBOT_REPLAY__SPEED"),
        ("POINTIT_PORT", "there is no service PORT; "),
        ("POINTIT_QQQQQQ__X", "`pointit list` shows services"),
    ],
)
def test_a_variable_without_effect_is_reported_with_the_nearest_name(variable: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check_environment({variable: "1"}, SERVICES)
    assert str(caught.value).startswith(f"variable {variable}: ")
    assert said in str(caught.value)


def test_a_longer_name_is_not_taken_for_the_shorter_one() -> None:
    check_environment({"POINTIT_ROBOT_REPLAY__X": "1", "POINTIT_ROBOT__X": "1"}, ["robot", "robot-replay"])
    with pytest.raises(ConfigError, match="write POINTIT_ROBOT__SPEED"):
        check_environment({"POINTIT_ROBOT_SPEED": "1"}, ["robot", "robot-replay"])


def test_one_service_alone_knows_how_its_own_are_spelt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("POINTIT_PUI_MAP", "lab")  # none of its business
    load_config(Selector, [], {})
    monkeypatch.setenv("POINTIT_SELECTOR_WINDOW_S", "0.5")
    with pytest.raises(ConfigError, match="write POINTIT_SELECTOR__WINDOW_S"):
        load_config(Selector, [], {})
