"""The loader of YAML, and what it must not be given: foreign text may neither end nor hold up a process."""

import typing
from typing import Any

import yaml

MAX_YAML_DEPTH = 100
MAX_YAML_INT = 1000
"""Characters of a whole number: Python does not show those with some thousands of digits."""

Loader: Any = type("Loader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
"""The one in C where PyYAML has it, a large map in a second instead of ten; with whole numbers as here."""


def refuse_depth(text: str) -> None:
    """Refuse what is nested so deeply that the loader in C would run out of stack, and end the process.

    Raises:
        RecursionError: it is nested too deeply.
        yaml.YAMLError: it is not YAML.
    """
    loader = Loader(text)
    depth = 0
    try:
        while loader.check_event():
            event = loader.get_event()
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_YAML_DEPTH:
                raise RecursionError
    finally:
        loader.dispose()


def _int(loader: Any, node: yaml.ScalarNode) -> int:
    """Return a whole number that can be shown."""
    if len(node.value) > MAX_YAML_INT:
        raise yaml.MarkedYAMLError(
            problem=f"a number has more than {MAX_YAML_INT} digits", problem_mark=node.start_mark
        )
    return typing.cast("int", loader.construct_yaml_int(node))


Loader.add_constructor("tag:yaml.org,2002:int", _int)
