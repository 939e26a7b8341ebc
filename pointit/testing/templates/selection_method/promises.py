"""Promises of a selection method, which has no device, for tests and `pointit plugin check`."""

from pointit.testing import SelectionMethodContract
from pointit.testing.templates.selection_method import METHOD


class MethodPromises(SelectionMethodContract):
    """Contract of this plug-in: one test for each promise."""

    plugin = METHOD
    wrong_parameters = ({"dwell_s": 0.0},)
