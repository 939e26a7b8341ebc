"""Templates of MQTT discovery that take one value out of a message. Pure.

Home Assistant runs any Jinja; here are the forms that lights announce: `{{ value }}`, `{{ value_json.a.b }}`
and `{{ value_json['a'] }}`.
"""

import json
import re
from dataclasses import dataclass
from typing import Self

from pointit.runtime.mqtt.discovery import json_value, mapping

_KEY = r"""\.\w+|\[\s*(?:'[^']*'|"[^"]*")\s*\]"""
_TEMPLATE = re.compile(rf"\s*\{{\{{-?\s*(?:(value)|value_json((?:{_KEY})*))\s*-?\}}\}}\s*")
NONE = "None"
"""Text of null in Home Assistant: the state is unknown."""


@dataclass(frozen=True)
class ValueTemplate:
    """The value at `path` of a message in JSON, or the message itself if `path` is None."""

    path: tuple[str, ...] | None = None

    @classmethod
    def parse(cls, template: object) -> Self:
        """Return the template of a text, the message itself for None. Raises ValueError: another form."""
        if template is None:
            return cls()
        if not isinstance(template, str):
            raise ValueError("not a text")  # noqa: TRY004 - any other form is one
        match = _TEMPLATE.fullmatch(template)
        if match is None:
            raise ValueError(f"not one value: {template}")
        if match[1] == "value":
            return cls()
        return cls(tuple(key.strip(".[] \t'\"") for key in re.findall(_KEY, match[2])))

    def value_of(self, payload: bytes) -> str:
        """Return the value in a message as Home Assistant writes it, or `""` if it is not there."""
        if self.path is None:
            return payload.decode(errors="replace")
        value = json_value(payload)
        for key in self.path:
            fields = mapping(value)
            if key not in fields:
                return ""
            value = fields[key]
        if value is None:
            return NONE
        if isinstance(value, bool):
            return str(value)
        return value if isinstance(value, str) else json.dumps(value)
