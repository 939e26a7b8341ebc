"""JSON Schema of all messages to and from pages, from which `client/wire.json` is generated."""

from typing import Any

from pydantic.json_schema import models_json_schema

from pointit.bridges.web import wire
from pointit.bridges.web.pages.page_requests import ACTIONS
from pointit.bridges.web.scan import wire as scan_wire


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of all messages."""
    models = (*wire.MODELS, *scan_wire.MODELS)
    _, schema = models_json_schema(
        [(model, "validation") for model in models], ref_template="#/$defs/{model}"
    )
    name = {"enum": [action.name for action in ACTIONS], "type": "string"}
    models = schema["$defs"]
    models["Ask"]["properties"]["deed"]["anyOf"][0] = models["Hello"]["properties"]["deeds"]["items"] = name
    return schema
