"""A machine on which scripts find nothing but stand-ins, which record their calls."""

import shutil
import subprocess
from pathlib import Path

from tests.architecture.sources import ROOT

TOOLS = (
    *("bash", "env", "dirname", "cksum", "cat", "rm", "mktemp", "sleep", "grep", "find", "tail"),
    *("chmod", "mkdir", "sed", "tr", "date"),
)

PYTHON = """#!/bin/sh
echo "python $*" >> "$CALLS"
case "$1" in
    -c) exit "${OLD:-0}" ;;
esac
case "$1 $2" in
    "-m venv")
        if [ -n "${NO_VENV:-}" ]; then echo "$NO_VENV"; exit 1; fi
        mkdir -p "$3/bin"
        cat "$SELF" > "$3/bin/python"
        printf '#!/bin/sh\\necho "pointit $*" >> "$CALLS"\\n' > "$3/bin/pointit"
        chmod +x "$3/bin/python" "$3/bin/pointit" ;;
    "-m pip")
        if [ "$3" = config ]; then echo "${PIP_CONFIG:-}"; exit; fi
        if [ -n "${NO_NET:-}" ] && [ "$3" = install ]; then echo "$NO_NET"; exit 1; fi
        case "$*" in
            *" uv") printf '#!/bin/sh\\necho "fetched uv $*" >> "$CALLS"; exit ${NO_UV:-0}\\n' > "${0%/*}/uv"
                chmod +x "${0%/*}/uv" ;;
        esac ;;
esac
"""

UV = """#!/bin/sh
echo "uv $*" >> "$CALLS"
if [ "$1" = venv ]; then
    for folder in "$@"; do :; done
    python3 -m venv "$folder"
fi
"""


class Machine:
    """A checkout and a PATH with nothing but the given programs."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "a checkout"
        self.bin = folder / "bin"
        self.calls_file = folder / "calls"
        self.root.mkdir()
        self.bin.mkdir()
        shutil.copytree(ROOT / "scripts", self.root / "scripts")
        shutil.copy(ROOT / "pyproject.toml", self.root)
        (self.root / "lab").mkdir()
        shutil.copy(ROOT / "lab/pyproject.toml", self.root / "lab")
        for tool in TOOLS:
            found = shutil.which(tool)
            assert found is not None
            (self.bin / tool).symlink_to(found)

    def add(self, name: str, text: str) -> None:
        path = self.bin / name
        path.write_text(text, encoding="utf-8")
        path.chmod(0o755)

    def run(self, script: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        self.calls_file.write_text("")
        return subprocess.run(
            [self.root / "scripts" / script, *arguments],
            env={
                "PATH": str(self.bin),
                "CALLS": str(self.calls_file),
                "SELF": str(self.bin / "python3"),
                "HOME": str(self.root),
                **environment,
            },
            capture_output=True,
            text=True,
            check=False,
            timeout=30,
        )

    @property
    def calls(self) -> list[str]:
        asked = ("python -c", "python -m pip --version", "python -m pip config")
        return [call for call in self.calls_file.read_text().splitlines() if not call.startswith(asked)]
