"""Old names of the contracts of plug-ins: they work with a warning, until the next minor version."""

from collections.abc import Callable
from typing import Any

import pytest

from pointit import testing
from pointit.testing.templates.selection_method import METHOD


def test_harness_of_old_names_makes_a_contract() -> None:
    harness: Callable[..., Any] = testing.MethodHarness
    with pytest.warns(DeprecationWarning, match="MethodHarness is now SelectionMethodContract"):
        contract = harness(plugin=METHOD, wrong_parameters=({"dwell_s": 0.0},), patience_s=3.0)
    assert contract.timeout_s == 3.0
    assert issubclass(contract, testing.SelectionMethodContract)
    checks = [check for check in testing.checks(contract) if str(check) == "parameters"]
    assert [problem for _, problem in testing.run_checks(checks)] == [""]


def test_functions_of_an_old_harness_are_methods_of_the_contract() -> None:
    harness: Callable[..., Any] = testing.ImuHarness
    with pytest.warns(DeprecationWarning, match="ImuHarness is now ImuSourceContract"):
        contract = harness(plugin=None, parameters=dict, encode=bytes)()
    assert contract.sends
    assert contract.parameters([("port", 7)]) == {"port": 7}
    assert contract.encode((1, 2, 3, 4)) == b"\x01\x02\x03\x04"
