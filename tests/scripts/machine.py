"""A machine on which scripts find nothing but stand-ins, which record their calls."""

import re
import shutil
import subprocess
from pathlib import Path

from tests.architecture.sources import ROOT

TOOLS = (
    *("bash", "env", "dirname", "cksum", "cat", "rm", "mktemp", "sleep", "grep", "find", "tail"),
    *("chmod", "mkdir", "sed", "touch", "tr", "date", "nice"),
)

PYTHON = """#!/bin/sh
echo "python $*" >> "$CALLS"
case "$1" in
    -c)
        case "$2" in "import pip"*) test -e "${0%/*}/pip"; exit ;; esac
        exit "${OLD:-0}" ;;
    -) echo "${NOT_THERE:-}"; exit ;;
esac
case "$1 $2" in
    "-m venv")
        mkdir -p "$4/bin"
        cat "$SELF" > "$4/bin/python"
        printf '#!/bin/sh\\necho "pointit $*" >> "$CALLS"\\n' > "$4/bin/pointit"
        chmod +x "$4/bin/python" "$4/bin/pointit" ;;
    "-m ensurepip") if [ -n "${NO_PIP:-}" ]; then exit 1; fi; touch "${0%/*}/pip" ;;
    "-m pip")
        case "$*" in
            *config*) echo "${PIP_CONFIG:-}" ;;
            *install*)
                if [ -n "${NO_NET:-}" ]; then echo "$NO_NET"; exit 1; fi
                if [ -n "${CONFIG_USER:-}" ] && [ "${PIP_USER:-}" != 0 ]; then  # as pip, of a virtualenv
                    echo "ERROR: Can not perform a '--user' install."; exit 1
                fi ;;
        esac
        case "$*" in
            *" --python "*" uv") uv="${4%/*}/uv" ;;
            *" uv" | *"/uv.txt") uv="${0%/*}/uv" ;;
            *) exit ;;
        esac
        printf '#!/bin/sh\\necho "fetched uv $*" >> "$CALLS"; exit ${NO_UV:-0}\\n' > "$uv"
        chmod +x "$uv" ;;
esac
"""

UV = """#!/bin/sh
echo "uv $*" >> "$CALLS"
if [ "$1" = venv ]; then
    for folder in "$@"; do :; done
    python3 -m venv --without-pip "$folder"
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
        asked = re.compile(r"python (-$|-c|-m ensurepip|-m pip config list)")
        return [call for call in self.calls_file.read_text().splitlines() if not asked.match(call)]
