# (mcap is in .venv-peers without its types)
"""Answers lines of JSON {type, definition, cdr} with what mcap-ros2-support reads; in .venv-peers."""

import base64
import json
import sys
from typing import Any

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory  # pyrefly: ignore[missing-import]  # see above


def plain(value: Any) -> Any:
    """Return `value` in types that JSON can represent."""
    if isinstance(value, bytes | bytearray | memoryview):
        return list(value)
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__ if not name.startswith("_")}
    return value


def main() -> None:
    """Answer until the input ends."""
    decoders: dict[str, Any] = {}
    factory = DecoderFactory()
    for line in sys.stdin:
        order = json.loads(line)
        name = order["type"]
        try:
            if name not in decoders:
                schema = Schema(len(decoders) + 1, order["definition"].encode(), "ros2msg", name)
                decoders[name] = factory.decoder_for("cdr", schema)
            answer = {"value": plain(decoders[name](base64.b64decode(order["cdr"])))}
        except Exception as error:  # noqa: BLE001 - who asked is told
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)  # noqa: T201 - the answer


if __name__ == "__main__":
    main()
