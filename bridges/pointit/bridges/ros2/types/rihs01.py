"""RIHS01, the hash of ROS 2 type definitions: SHA-256 of a type's description as JSON.

Source: REP 2016, whose description is rosidl's `type_description_interfaces/msg/TypeDescription`; checked
against hashes captured from a running Jazzy and a running Kilted.

Fields are described as in rosbags: `(BASE, (name, bound of a string))`, `(NAME, type)`, and
`(ARRAY, (one of those, length))`, `(SEQUENCE, (one of those, bound or 0))`.
"""

import json
from collections.abc import Callable, Sequence
from hashlib import sha256
from typing import Any

Fields = Sequence[tuple[str, Any]]

BASE, NAME, ARRAY, SEQUENCE = 1, 2, 3, 4

NAMED_ID = 1
IDS = {
    "int8": 2,
    "uint8": 3,
    "char": 3,  # a byte since ROS 2; the id 13 of that name is never used for it
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "float128": 12,
    "wchar": 14,
    "bool": 15,
    "byte": 16,
    "string": 17,
    "wstring": 18,
}
BOUNDED_IDS = {"string": 21, "wstring": 22}
ARRAY_IDS, BOUNDED_SEQUENCE_IDS, SEQUENCE_IDS = 48, 96, 144

EMPTY: Fields = [("structure_needs_at_least_one_member", (BASE, ("uint8", 0)))]
"""Placeholder of an empty definition, in hashes and in CDR."""

EVENT_INFO = "service_msgs/msg/ServiceEventInfo"


class Rihs01:
    """Hashes of the types that `fields_of(name)` knows; it raises KeyError for others."""

    def __init__(self, fields_of: Callable[[str], Fields]) -> None:
        self._fields_of = fields_of
        self._described: dict[str, tuple[str, frozenset[str]]] = {}

    def message(self, name: str) -> str:
        """Return the hash of the message `name` (`std_msgs/msg/Bool`): `RIHS01_` and 64 digits."""
        return self._hash(*self._description(name))

    def service(self, name: str) -> str:
        """Return the hash of the service `name` (`std_srvs/srv/Empty`): of request, response and event."""
        request, response, event = (f"{name}_{part}" for part in ("Request", "Response", "Event"))
        parts = [("request_message", request), ("response_message", response), ("event_message", event)]
        self._describe(
            event,
            [
                ("info", (NAME, EVENT_INFO)),
                ("request", (SEQUENCE, ((NAME, request), 1))),
                ("response", (SEQUENCE, ((NAME, response), 1))),
            ],
        )
        return self._hash(*self._describe(name, [(field, (NAME, part)) for field, part in parts]))

    def _hash(self, text: str, referenced: frozenset[str]) -> str:
        others = ", ".join(self._description(name)[0] for name in sorted(referenced))
        described = f'{{"type_description": {text}, "referenced_type_descriptions": [{others}]}}'
        return f"RIHS01_{sha256(described.encode()).hexdigest()}"

    def _description(self, name: str) -> tuple[str, frozenset[str]]:
        known = self._described.get(name)
        return known if known is not None else self._describe(name, self._fields_of(name))

    def _describe(self, name: str, fields: Fields) -> tuple[str, frozenset[str]]:
        """Return the type's own JSON, and the names of all types below it."""
        described: list[dict[str, Any]] = []
        referenced: set[str] = set()
        for field, of in fields or EMPTY:
            kind = _kind(of)
            described.append({"name": field, "type": kind})
            if nested := kind["nested_type_name"]:
                referenced |= {nested} | self._description(nested)[1]
        text = json.dumps({"type_name": name, "fields": described})
        self._described[name] = text, frozenset(referenced)
        return self._described[name]


def _kind(of: Any) -> dict[str, Any]:
    shape, rest = of
    offset, capacity, string_capacity, nested = 0, 0, 0, ""
    if shape in {ARRAY, SEQUENCE}:
        (shape, rest), capacity = rest
        offset = ARRAY_IDS if of[0] == ARRAY else BOUNDED_SEQUENCE_IDS if capacity else SEQUENCE_IDS
    if shape == NAME:
        number, nested = NAMED_ID, rest
    else:
        base, string_capacity = rest
        number = BOUNDED_IDS[base] if string_capacity else IDS[base]
    return {
        "type_id": offset + number,
        "capacity": capacity,
        "string_capacity": string_capacity,
        "nested_type_name": nested,
    }
