"""Script of continuous integration on incomplete machines, and with tests that fail."""

import json
import os
import re
import shutil
import sys
from pathlib import Path

import pytest

from tests.architecture.machine import Machine
from tests.architecture.sources import ROOT

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the scripts are for POSIX shells")


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


@pytest.mark.parametrize("there", [False, True])
def test_ci_installs_what_tests_need_and_says_what_is_missing(machine: Machine, *, there: bool) -> None:
    shutil.copytree(ROOT / ".ci", machine.root / ".ci")
    for script in ("../.ci/versions", "../.ci/containers", "setup", "check", "docs", "test", "mutants"):
        path = machine.root / "scripts" / script
        path.write_text(f'#!/bin/sh\necho "{path.name} $LOCKED $*" >> "$CALLS"\n', encoding="utf-8")
    machine.add("id", "#!/bin/sh\necho 0\n")
    machine.add("apt-get", '#!/bin/sh\necho "apt-get $*" >> "$CALLS"; echo "E: no net"; exit 100\n')
    needed = [
        "ip",
        "tc",
        "nft",
        "unshare",
        "sysctl",
        "script",
        "podman",
        "podman-compose",
        "runc",
        "catatonit",
        "debootstrap",
        "mosquitto",
        "olad",
        "prometheus",
        "promtool",
        "systemd-analyze",
    ]
    for tool in (*needed, "google-chrome") if there else ():
        machine.add(tool, "#!/bin/sh\n")
    done = machine.run("../.ci/run")
    assert done.returncode == 0  # without it tests are skipped, for reasons that are not listed
    assert done.stdout.endswith("\nUNSTABLE: 0\n")
    assert ("apt-get update" in machine.calls) == (not there)
    told = f"*** missing on this machine: chromium {' '.join(needed)} ***"
    assert done.stderr.count(told) == (0 if there else 2)  # before the tests and after them
    assert ("E: no net" in done.stderr) == (not there)
    began = {call.partition(" ")[0] for call in machine.calls}
    assert began >= {"versions", "containers", "setup", "check", "docs", "mutants"}
    tests = [call for call in machine.calls if call.startswith("test ")]
    given = [ROOT / word for call in tests for word in call.split() if word.startswith("tests/")]
    given.append(ROOT / "tests/docs")  # by scripts/docs
    files = [*(ROOT / "tests").rglob("test_*.py")]
    assert len(files) > 100
    left_out = [file for file in files if not any(file.is_relative_to(folder) for folder in given)]
    assert not left_out, "every test is run"
    assert all("-p tests.support.strict_skips" in call for call in tests)
    assert all(call.split()[1] == "1" for call in machine.calls if not call.startswith("apt-get"))


@pytest.mark.parametrize(
    ("tests", "runs"),
    [
        (
            ["tests/unit/web", "tests/golden", "tests/e2e/web"],
            ["tests/e2e/web", "tests/unit/web tests/golden"],
        ),
        (["tests/docs", "tests/unit/maps"], ["docs", "tests/unit/maps"]),
        (["tests/interop/ros2", "tests/lab"], ["containers", "tests/interop/ros2", "tests/lab"]),
    ],
    ids=["room", "documents", "containers"],
)
def test_ci_runs_the_tests_of_a_lane_and_the_gates_alone(
    machine: Machine, tests: list[str], runs: list[str]
) -> None:
    shutil.copytree(ROOT / ".ci", machine.root / ".ci")
    told = "\n".join(["page: nothing else has changed", *tests])
    (machine.root / ".ci" / "lanes.py").write_text(f"print({told!r})\n", encoding="utf-8")
    for script in ("../.ci/versions", "../.ci/containers", "setup", "check", "docs", "mutants", "test"):
        path = machine.root / "scripts" / script
        path.write_text(f'#!/bin/sh\necho "{path.name} $*" >> "$CALLS"\n', encoding="utf-8")
    (machine.root / ".venv" / "bin").mkdir(parents=True)
    (machine.root / ".venv" / "bin" / "python").symlink_to(sys.executable)
    machine.add("id", "#!/bin/sh\necho 1\n")
    done = machine.run("../.ci/run")
    assert done.returncode == 0, done.stderr
    assert "=== page: nothing else has changed ===" in done.stdout
    ran = [
        " ".join(word for word in call.split() if word.startswith("tests/")) or call for call in machine.calls
    ]
    assert sorted(call.strip() for call in ran) == sorted(["setup dev", "check", *runs])


SOME_FAIL = """#!/bin/sh
for each in "$@"; do
    case "$each" in cache_dir=*) cache="${each#cache_dir=}" ;; esac
done
echo "test $each" >> "$CALLS"
case "$each" in
    tests/faults) echo "it broke"
        if [ -n "$FAILED" ]; then mkdir -p "$cache/v/cache"; echo "$FAILED" > "$cache/v/cache/lastfailed"; fi
        exit 1 ;;
    tests/faults/*.py) exit "$ALONE" ;;
esac
"""
ONE, TWO = "tests/faults/test_a.py::test_b[c d]", "tests/faults/test_e.py::test_b"


@pytest.mark.parametrize(
    ("failed", "alone", "status"),
    [
        ([ONE], 0, 0),
        ([ONE, f"{ONE}2", TWO], 0, 0),
        ([ONE, TWO], 1, 1),
        ([f"{ONE}{number}" for number in range(4)], 0, 1),
        ([], 0, 1),
    ],
    ids=["unstable", "unstable files", "broken", "too many", "no test but the job"],
)
def test_ci_runs_the_files_of_a_few_tests_that_failed_once_more(
    machine: Machine, failed: list[str], alone: int, status: int
) -> None:
    shutil.copytree(ROOT / ".ci", machine.root / ".ci")
    for script in ("../.ci/versions", "../.ci/containers", "setup", "check", "docs", "mutants"):
        (machine.root / "scripts" / script).write_text("#!/bin/sh\n", encoding="utf-8")
    (machine.root / "scripts" / "test").write_text(SOME_FAIL, encoding="utf-8")
    (machine.root / ".venv" / "bin").mkdir(parents=True)
    (machine.root / ".venv" / "bin" / "python").symlink_to(sys.executable)
    machine.add("id", "#!/bin/sh\necho 1\n")
    listed = json.dumps(dict.fromkeys(failed, True)) if failed else ""
    done = machine.run("../.ci/run", FAILED=listed, ALONE=str(alone))
    assert done.returncode == status
    assert "it broke" in done.stdout
    files = {each.partition("::")[0] for each in failed} if len(failed) < 4 else set[str]()
    assert [call for call in machine.calls if ".py" in call] == [f"test {file}" for file in sorted(files)]
    told = re.findall(r"UNSTABLE: (.*) failed beside others, its file passed alone; mend it", done.stdout)
    assert told == (failed if status == 0 else [])
    assert done.stdout.endswith(f"\nUNSTABLE: {len(told)}\n")
    assert ("4 tests failed, too many to run again" in done.stdout) == (len(failed) == 4)


PODMAN = """#!/bin/sh
echo "podman $*" >> "$CALLS"
case "$1 $2" in
    "image exists") case " $THERE " in *" $3 "*) exit 0 ;; esac; exit 1 ;;
    "pull --quiet") exit "$PULLED" ;;
    "import --change") cat > /dev/null ;;
esac
"""
MADE_BASE = "localhost/pointit-base:ci"


@pytest.mark.parametrize(
    ("there", "pulled", "is_made"),
    [("official", 1, False), ("", 0, False), ("", 1, True), ("made", 1, False)],
)
def test_an_image_that_ci_makes_is_not_named_as_the_official_one(
    machine: Machine, there: str, pulled: int, *, is_made: bool
) -> None:
    shutil.copytree(ROOT / ".ci", machine.root / ".ci")
    shutil.copytree(ROOT / "deploy", machine.root / "deploy")
    machine.add("podman", PODMAN)
    machine.add("debootstrap", '#!/bin/sh\nmkdir -p "$4/etc/ssl/certs"\n')
    machine.add("cp", "#!/bin/sh\n")
    machine.add("tar", "#!/bin/sh\n")
    machine.add("timeout", '#!/bin/sh\nshift\n"$@"\n')
    official = "".join(re.findall(r"^ARG BASE=(.*)$", (ROOT / "deploy/Dockerfile").read_text(), re.MULTILINE))
    known = {"official": official, "made": MADE_BASE}.get(there, "")
    done = machine.run("../.ci/containers", THERE=known, PULLED=str(pulled))
    assert done.returncode == 0, done.stderr
    imports = [call for call in machine.calls if call.startswith("podman import")]
    assert [call.split()[-1] for call in imports] == ([MADE_BASE] if is_made else [])
    assert f'MADE_BASE = "{MADE_BASE}"' in (ROOT / "tests/containers/conftest.py").read_text()
