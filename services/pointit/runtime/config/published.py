"""Parameters as they are published and recorded: without secrets."""

import json
import re
from typing import Any, cast

from pointit.runtime.config.config import Config

_SECRET = re.compile(r"token|passw(or)?d|passphrase|secret|credential|key$", re.IGNORECASE)
"""Part of the name of a field that is left out, at any depth."""

_USER_INFO = re.compile(r"(?<=://)[^/\s]*@")


def published_parameters(config: Config) -> str:
    """Return the parameters of `config` as JSON for everybody on the site.

    Fields of `Config.SECRETS` are left out, and so are those at any depth whose name says that they are
    secret: `api_token`, `password`, `client_secret`, `key`. User and password in an address become `***`.
    """
    values = json.loads(config.model_dump_json(exclude=set(config.SECRETS), fallback=str))
    return json.dumps(_without_secrets(values))


def _without_secrets(value: object) -> Any:
    if isinstance(value, dict):
        fields = cast("dict[str, object]", value).items()
        return {name: _without_secrets(each) for name, each in fields if not _SECRET.search(name)}
    if isinstance(value, list):
        return [_without_secrets(each) for each in cast("list[object]", value)]
    return _USER_INFO.sub("***@", value) if isinstance(value, str) else value
