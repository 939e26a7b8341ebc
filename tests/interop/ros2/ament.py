"""A folder like that of an installed ROS 2: definitions and hashes of types, for peers that read them."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pointit.bridges.ros2.types.definitions import BASE, INTERFACES, NAME, SEQUENCE, STANDARD_SERVICES, Rihs01
from pointit.bridges.ros2.types.types import GOLDEN, Types

AT_LEAST = "uint8 structure_needs_at_least_one_member"
"""Field that ROS 2 adds to a structure without fields. dora 1.1.0 does not add it."""


def install(prefix: Path, types: Types, names: Iterable[str]) -> None:
    """Write `share/PACKAGE/{msg,srv}/NAME.{msg,srv,json}` for these types and those that they hold."""
    for name in {part for whole in names for part in (whole, *_parts(types, whole))}:
        package, kind, short = name.split("/")
        folder = prefix / "share" / package / kind
        folder.mkdir(parents=True, exist_ok=True)
        manifest = folder.parent / "package.xml"
        manifest.write_text(f"<package><name>{package}</name><version>0.0.0</version></package>")
        (folder / f"{short}.{kind}").write_text(_text(types, name), encoding="utf-8")
        (folder / f"{short}.json").write_text(_description(types, name), encoding="utf-8")


def install_action(prefix: Path, types: Types, name: str, text: str) -> None:
    """Write `share/PACKAGE/action/NAME.{action,json}`, and what an action holds."""
    package, kind, short = name.split("/")
    parts = ("Goal", "Result", "Feedback", "FeedbackMessage", "SendGoal", "GetResult")
    halves = tuple(f"{service}_{half}" for service in parts[4:] for half in ("Request", "Response"))
    install(prefix, types, {"action_msgs/srv/CancelGoal", "action_msgs/msg/GoalStatusArray"})
    for part in ("Goal", "Result", "Feedback"):
        install(prefix, types, _held(types, f"{name}_{part}"))
    folder = prefix / "share" / package / kind
    folder.mkdir(parents=True, exist_ok=True)
    manifest = folder.parent / "package.xml"
    manifest.write_text(f"<package><name>{package}</name><version>0.0.0</version></package>")
    (folder / f"{short}.action").write_text(text, encoding="utf-8")
    hashes = [
        {"type_name": f"{name}_{part}", "hash_string": types.kind(f"{name}_{part}").hash}
        for part in (*parts, *halves)
    ]
    written = _Written(types._fields_of).action(name)
    described = _with_defaults(written)
    own = f"RIHS01_{hashlib.sha256(written.encode()).hexdigest()}"
    hashes.append({"type_name": name, "hash_string": own})
    (folder / f"{short}.json").write_text(
        json.dumps({"type_description_msg": described, "type_hashes": hashes})
    )


class _Written(Rihs01):
    """Variant of `Rihs01` that returns the hashed JSON text instead of the hash."""

    def _hash(self, text: str, referenced: frozenset[str]) -> str:
        others = ", ".join(self._description(name)[0] for name in sorted(referenced))
        return f'{{"type_description": {text}, "referenced_type_descriptions": [{others}]}}'

    def action(self, name: str) -> str:
        """Return the text of an action: its messages and services."""
        services = ("SendGoal", "GetResult")
        for service in services:
            self.service(f"{name}_{service}")
        fields = [
            *((part.lower(), part) for part in ("Goal", "Result", "Feedback")),
            ("send_goal_service", "SendGoal"),
            ("get_result_service", "GetResult"),
            ("feedback_message", "FeedbackMessage"),
        ]
        return self._hash(
            *self._describe(name, [(field, (NAME, f"{name}_{part}")) for field, part in fields])
        )


def _with_defaults(text: str) -> Any:
    """Return a description as ROS 2 installs it: with a default of each field."""
    described = json.loads(text)
    for each in (described["type_description"], *described["referenced_type_descriptions"]):
        for field in each["fields"]:
            field["default_value"] = ""
    return described


def _description(types: Types, name: str) -> str:
    """Return the JSON that ROS 2 installs beside a definition."""
    written = _Written(types._fields_of)
    described = _with_defaults(written.service(name) if "/srv/" in name else written.message(name))
    hashes = [{"type_name": name, "hash_string": hash_of(types, name)}]
    return json.dumps({"type_description_msg": described, "type_hashes": hashes})


def hash_of(types: Types, name: str) -> str:
    """Return the hash that a running ROS 2 gave a type; ours where none was seen."""
    golden: dict[str, str] = json.loads(GOLDEN.read_text(encoding="utf-8"))
    return golden.get(name) or types.kind(name).hash


def shape(types: Types, name: str) -> dict[str, Any]:
    """Return the fields of a message for JSON: a base type's name, an element's in a list, or nested."""
    return {field: _shape(types, described) for field, described in types._fields_of(name)}


def _shape(types: Types, described: Any) -> Any:
    kind, inner = described
    if kind == BASE:
        return inner[0]
    if kind == NAME:
        return shape(types, inner)
    element, count = inner
    return [_shape(types, element)] if kind == SEQUENCE else [_shape(types, element), count]


def _parts(types: Types, name: str) -> set[str]:
    """Return the types that `name` holds, however deep."""
    if "/srv/" in name:
        halves = (types.request_of(name), types.response_of(name))
        return {part for half in halves for part in _held(types, half)}
    return _held(types, name)


def _held(types: Types, name: str) -> set[str]:
    text = definition(types, name)
    held = (line.removeprefix("MSG: ").strip() for line in text.splitlines() if line.startswith("MSG: "))
    return {name if "/msg/" in name else name.replace("/", "/msg/") for name in held}


def _text(types: Types, name: str) -> str:
    text = _written(types, name)
    if "/srv/" not in name:
        return text
    return "---\n".join(half if _has_fields(half) else f"{AT_LEAST}\n" for half in text.split("---\n"))


def _has_fields(text: str) -> bool:
    return any(line.split("#")[0].strip() for line in text.splitlines())


def _written(types: Types, name: str) -> str:
    package, kind, short = name.split("/")
    own = INTERFACES / package / kind / f"{short}.{kind}"
    if own.exists():
        return own.read_text(encoding="utf-8")
    if name in STANDARD_SERVICES:
        return STANDARD_SERVICES[name]
    return definition(types, name).partition("=" * 80)[0]


def definition(types: Types, name: str) -> str:
    """Return the definition of a message and of all that it holds, as recordings have it."""
    text, _ = types._definitions.store.generate_msgdef(name, ros_version=2)
    return text
