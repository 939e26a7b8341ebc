"""Names that optional parts import from modules which promise nothing to others: limits that only fall.

See `docs/decisions/core-border.md`: these parts stay in the one package, but few hidden threads hold them.
"""

import pytest

from tests.architecture.sources import imports_in, module_name, shipped, tree

LEAVES = {
    "assistants": (("pointit.assistants", "pointit.cli.assistants"), 25),
    "foxglove": (("pointit.bridges.foxglove",), 6),
    "speech": (("pointit.speech", "pointit.services.listener"), 11),
    "studies": (("pointit.study", "pointit.study_report", "pointit.cli.study"), 35),
    "testing": (("pointit.testing", "pointit.cli.plugins"), 16),
    "vda5050": (("pointit.vda5050", "pointit.services.robot.vda5050", "pointit.bridges.agv_tracker"), 7),
}
"""Modules of each part, and the largest number of names from others."""

PROMISED = (
    "pointit.commands",
    "pointit.plugins",
    "pointit.testing",
    "pointit.errors",
    "pointit.schemas",
    "pointit.geometry",
    "pointit.site",  # its types and functions are names of `pointit.plugins`
)
"""Modules whose names are promised to other packages, beside `pointit` itself."""


def _is_in(name: str, modules: tuple[str, ...]) -> bool:
    return any(f"{name}.".startswith(f"{module}.") for module in modules)


@pytest.mark.parametrize("leaf", sorted(LEAVES))
def test_a_leaf_imports_no_more_hidden_names(leaf: str) -> None:
    own, limit = LEAVES[leaf]
    hidden: set[str] = set()
    count = 0
    for path in shipped():
        if not _is_in(module_name(path), own):
            continue
        count += 1
        hidden.update(
            name
            for name, _ in imports_in(tree(path))
            if name.startswith("pointit.") and name.count(".") > 1 and not _is_in(name, (*own, *PROMISED))
        )
    assert count > 0
    assert len(hidden) == limit, "\n".join((f"{leaf}: {len(hidden)}; limit {limit}", *sorted(hidden)))
