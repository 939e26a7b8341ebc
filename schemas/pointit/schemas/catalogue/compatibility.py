"""Compatibility of messages: the structural part of a JSON Schema, and checks that a newer one only adds."""

from collections.abc import Iterator, Mapping
from typing import Any, TypeGuard

JsonSchema = dict[str, Any]

_PROSE = frozenset({"title", "description", "$id", "$schema"})
_MAPS = frozenset({"properties", "$defs"})
"""Keywords whose members have names of our own, which may be `title`."""


def strip_annotations(schema: Mapping[str, Any]) -> JsonSchema:
    """Return `schema` without its prose, with every nested part written out in place."""
    bare: JsonSchema = _bare({k: v for k, v in schema.items() if k != "$defs"}, schema.get("$defs", {}))
    return bare


def breaking_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return a clause for each way in which `new` is not `old` plus optional fields.

    Defaults may change, since writers of the newer version send every field.
    """
    return list(_losses(strip_annotations(old), strip_annotations(new), ""))


def _bare(node: Any, definitions: Mapping[str, Any]) -> Any:
    if _is_list(node):
        return [_bare(item, definitions) for item in node]
    if not _is_object(node):
        return node
    bare: JsonSchema = {}
    for key, value in node.items():
        if key == "$ref":
            bare.update(_bare(definitions[str(value).rpartition("/")[2]], definitions))
        elif key in _MAPS:
            bare[key] = {name: _bare(field, definitions) for name, field in value.items()}
        elif key == "default":
            bare[key] = value
        elif key not in _PROSE:
            bare[key] = _bare(value, definitions)
    if "required" in bare:
        bare["required"] = sorted(bare["required"])
    return bare


def _losses(old: JsonSchema, new: JsonSchema, where: str) -> Iterator[str]:
    fields: JsonSchema = old.get("properties", {})
    grown: JsonSchema = new.get("properties", {})
    for name, field in fields.items():
        path = f"{where}.{name}" if where else name
        if name in grown:
            yield from _losses(field, grown[name], path)
        else:
            yield f"the field {path} is gone"
    for name in sorted(set(new.get("required", ())) - set(old.get("required", ()))):
        path = f"{where}.{name}" if where else name
        yield f"the field {path} is required now, give it a default"
    rest = (old.keys() | new.keys()) - {"properties", "required", "default"}
    for key in sorted(rest):
        yield from _changes(old.get(key), new.get(key), key, where)


def _changes(old: Any, new: Any, keyword: str, where: str) -> Iterator[str]:
    if _is_object(old) and _is_object(new):
        yield from _losses(old, new, where)
    elif _is_list(old) and _is_list(new) and len(old) == len(new) and all(map(_is_object, [*old, *new])):
        for one, other in zip(old, new, strict=True):  # the places of a tuple, or alternatives
            yield from _changes(one, other, keyword, where)
    elif old != new:
        yield f"the field {where} changed ({keyword}: {old!r} before, {new!r} now)"


def _is_list(value: Any) -> TypeGuard[list[Any]]:
    return isinstance(value, list)


def _is_object(value: Any) -> TypeGuard[JsonSchema]:
    return isinstance(value, dict)
