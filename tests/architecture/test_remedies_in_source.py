"""Remedies in the source: no placeholder is left, and each `--set` can be typed as it is."""

import ast
import itertools
from collections.abc import Iterator

from pointit.services.imu_bridge import sources
from tests.architecture.sources import shipped, tree
from tests.unit.diagnosis.remedies import ACTS, PLACEHOLDER, check_setting

STATED = {
    "ANY_HOST": ("0.0.0.0",),  # noqa: S104
    "kind.plugin": ("metamotion", "touch_sdk"),
    "self._kind.plugin": ("metamotion", "touch_sdk"),
    "self._name": ("udp", "osc", "ximu3"),
    "name": ("bay_selected", "udp"),
    "self._parameter": ("serial.sensor", "udp.sensor", "osc.sensor", "ximu3.sensor"),
    "feeder.name": ("a",),
    "config.port % 65535 + 1": ("8001",),
    "min(sensors)": ("wrist",),
    "sent[0]": ("0",),
    "object_id": ("agv1",),
    "there[0]": ("1",),
    "lane": ("[1]",),
    "other_surface": ("belt", "strip"),
}
"""Values of what varies in the arguments of `set_option`."""


def texts(node: ast.expr) -> Iterator[str]:
    """Yield the texts that an argument can have."""
    if isinstance(node, ast.JoinedStr):
        parts = [list(texts(each)) for each in node.values]
        yield from ("".join(each) for each in itertools.product(*parts))
    elif isinstance(node, ast.FormattedValue):
        yield from texts(node.value)
    elif isinstance(node, ast.Constant):
        yield str(node.value)
    elif isinstance(node, ast.IfExp):
        yield from texts(node.body)
        yield from texts(node.orelse)
    else:
        yield from STATED.get(ast.unparse(node), ("1",))


def options() -> Iterator[str]:
    for path in shipped():
        for call in ast.walk(tree(path)):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "set_option":
                service, parameter, value = map(texts, call.args)
                for each in itertools.product(service, parameter, value):
                    if not each[1].startswith({"conveyor-sim": "udp", "imu-bridge": "bay"}.get(each[0], " ")):
                        is_address = each[1] == "ximu3.sensor"  # its sensors are known by their addresses
                        yield f"{each[0]}.{each[1]}={'192.0.2.1' if is_address else each[2]}"


def test_words_of_remedies_occur_in_the_product() -> None:
    said = "\n".join(
        node.value
        for path in shipped()
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
    assert [words for words in ACTS.values() if words not in said] == []


def test_every_option_of_a_remedy_is_accepted_by_the_parser() -> None:
    settings = sorted(set(options()))
    assert len(settings) > 20
    for setting in settings:
        check_setting(setting)


def test_no_sentence_names_an_option_without_its_service() -> None:
    """A text that tells people to set `udp.host` cannot be typed."""
    plugins = sources.SOURCES.names
    for path in shipped():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                words = node.value.split()
                told = {after for before, after in itertools.pairwise(words) if before == "set"}
                assert not [each for each in told if each.partition(".")[0] in plugins and "." in each], path


def test_no_sentence_of_a_service_has_a_placeholder() -> None:
    """No text in a call of `warn`, or in a constant that such a call names, is a key pattern."""
    for path in shipped():
        module = tree(path)
        constants = {
            ast.unparse(each.targets[0]): each.value for each in module.body if isinstance(each, ast.Assign)
        }
        for call in ast.walk(module):
            if not (isinstance(call, ast.Call) and ast.unparse(call.func).endswith(".warn")):
                continue
            for node in (each for argument in call.args for each in ast.walk(argument)):
                value = constants.get(ast.unparse(node), node) if isinstance(node, ast.Name) else node
                text = value.value if isinstance(value, ast.Constant) else ""
                assert not PLACEHOLDER.search(str(text)), f"{path}:{call.lineno}"
