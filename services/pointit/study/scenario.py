"""The scenario of a session: that of the study, with a recorder if it records."""

from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.host.atomic_file import write_atomically
from pointit.study.model import SHIPPED, Study


def scenario_file(study: Study, recording: Path | None = None) -> Path:
    """Return the path of the scenario; with a `recording`, of a copy beside it with a recorder."""
    if study.scenario in SHIPPED:
        path = Path(str(resources.files("pointit.study") / "scenarios" / f"{study.scenario}.yaml"))
    else:
        path = study.folder / study.scenario
    if recording is None:
        return path
    content: dict[str, Any] = read_yaml(path)
    site = content.setdefault("site", {})
    site["recorder"] = {"file": str(recording.absolute())}
    room = site.get("pui", {}).get("map", "")
    if Path(room).suffix:
        site["pui"]["map"] = str((path.parent / room).absolute())
    copy = recording.with_name("scenario.yaml")
    write_atomically(copy, yaml.safe_dump(content, sort_keys=False).encode(), mode=0o644)
    return copy
