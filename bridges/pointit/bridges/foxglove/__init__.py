"""The scene for Foxglove's and Lichtblick's viewer, who look on and cannot control anything."""

from importlib.util import find_spec

from pointit.runtime.errors import ConfigError

if find_spec("foxglove") is None:
    raise ConfigError("the bridge to Foxglove needs the extra of that name: pip install 'pointit[foxglove]'")
