"""The scripts on incomplete machines. Stand-ins for Python and uv record their calls."""

import os
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT
from tests.scripts.machine import PYTHON, UV, Machine

PIP = "python -m pip install --quiet --disable-pip-version-check"
COMPUTING = "tests/unit tests/simulation"
"""Folders of the tests that compute."""

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the scripts are for POSIX shells")


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


@pytest.mark.parametrize("script", ["demo", "test", "setup"])
def test_without_a_python_one_sentence_says_so(machine: Machine, script: str) -> None:
    done = machine.run(script)
    assert done.returncode == 1
    assert done.stderr == (
        f"{script}: PointIt needs Python 3.11 or newer and found none; "
        "install python3.11 or newer and run this again\n"
    )


def test_an_old_python_is_no_python(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    done = machine.run("demo", OLD="1")
    assert "needs Python 3.11 or newer" in done.stderr


def test_the_demo_installs_once_and_runs_scenario_4(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    assert machine.run("demo").returncode == 0
    install = (
        f"fetched uv pip install --quiet --python {machine.root}/.venv/bin/python -e {machine.root}[web]"
    )
    assert machine.calls == [
        f"python -m venv --without-pip {machine.root}/.venv",
        f"{PIP} uv",
        install,
        "pointit run scenario_4",
    ]
    assert machine.run("demo", "--duration", "20").returncode == 0
    assert machine.calls == ["pointit run scenario_4 --duration 20"]

    with (machine.root / "pyproject.toml").open("a") as file:
        file.write("# changed\n")
    assert (machine.run("demo").returncode, machine.calls) == (0, [install, "pointit run scenario_4"])


@pytest.mark.parametrize("arguments", [("--seed", "1", "scenario_2"), ("my room.yaml",)])
def test_the_demo_runs_the_scenario_that_is_named(machine: Machine, arguments: tuple[str, ...]) -> None:
    machine.add("python3", PYTHON)
    assert machine.run("demo", *arguments).returncode == 0
    assert machine.calls[-1] == " ".join(("pointit run", *arguments))


def test_scripts_test_installs_its_extra_or_dev_for_named_tests(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    machine.run("demo")
    install = f"fetched uv pip install --quiet --python {machine.root}/.venv/bin/python -e {machine.root}"
    machine.run("test")
    assert machine.calls[0] == f"{install}[test] -e {machine.root}/lab"

    options = r"-n \d+ -q --dist loadfile --no-loadscope-reorder -p tests.support.cpu_times"
    chosen = "-m not slow and not long"
    for call, folder in zip(parts_of(machine), ("tests/integration", COMPUTING), strict=True):
        assert re.fullmatch(f"python -m pytest {options} {chosen} {folder}", call)
    assert machine.run("test", "-q", "tests/unit").returncode == 0
    assert machine.calls == [f"{install}[dev] -e {machine.root}/lab", "python -m pytest -q tests/unit"]

    machine.run("test")
    compiled = [each for each in machine.calls if "--collect-only" in each]
    assert len(compiled) == 3
    assert len(machine.calls) == len(compiled) + 2, "nothing is installed again"

    with (machine.root / "pyproject.toml").open("a") as file:
        file.write("# changed\n")
    assert machine.run("test", "-q").returncode == 0
    assert machine.calls[0] == f"{install}[dev] -e {machine.root}/lab"

    machine.run("demo")
    assert machine.calls == ["pointit run scenario_4"]


def test_a_moved_checkout_is_installed_again(machine: Machine, tmp_path: Path) -> None:
    machine.add("python3", PYTHON)
    machine.run("demo")
    machine.root = machine.root.rename(tmp_path / "elsewhere")
    machine.run("demo")
    assert machine.calls[-2].endswith(f"-e {machine.root}[web]")


def test_uv_is_used_when_it_is_there(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    machine.add("uv", UV)
    assert machine.run("demo").returncode == 0
    assert machine.calls == [
        f"uv venv --quiet --python {machine.bin}/python3 {machine.root}/.venv",
        f"python -m venv --without-pip {machine.root}/.venv",
        f"uv pip install --quiet --python {machine.root}/.venv/bin/python -e {machine.root}[web]",
        "pointit run scenario_4",
    ]


def test_pip_fetches_uv_once_which_installs_the_rest(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    done = machine.run("setup")
    assert (done.returncode, done.stderr) == (0, "PointIt is in .venv: source .venv/bin/activate\n")
    uv = f"fetched uv pip install --quiet --python {machine.root}/.venv/bin/python"
    assert machine.calls == [
        f"python -m venv --without-pip {machine.root}/.venv",
        f"{PIP} uv",
        f"{uv} -e {machine.root}",
    ]
    machine.run("setup", "plot")
    assert machine.calls == [f"{uv} -e {machine.root}[plot]"]


def test_pip_configured_with_user_true_still_installs_into_the_venv(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    done = machine.run("setup", CONFIG_USER="true")
    assert (done.returncode, done.stderr) == (0, "PointIt is in .venv: source .venv/bin/activate\n")


@pytest.mark.parametrize(("chosen", "used"), [({}, "true"), ({"UV_SYSTEM_CERTS": "false"}, "false")])
def test_uv_trusts_certificates_of_the_system_unless_told_otherwise(
    machine: Machine, chosen: dict[str, str], used: str
) -> None:
    machine.add("uv", '#!/bin/sh\necho "$UV_SYSTEM_CERTS: uv $1" >> "$CALLS"\n')
    assert machine.run("wheel", **chosen).returncode == 0
    assert machine.calls == [f"{used}: uv build", f"{used}: uv build"]


@pytest.mark.parametrize("why", ["pip has an index", "uv fails"])
def test_pip_installs_where_a_fetched_uv_cannot(machine: Machine, why: str, tmp_path: Path) -> None:
    machine.add("python3", PYTHON)
    logs = tmp_path / "logs"
    logs.mkdir()
    told = {"PIP_CONFIG": ":env:.index-url='https://pypi.example'"} if "index" in why else {"NO_UV": "1"}
    assert machine.run("setup", TMPDIR=str(logs), **told).returncode == 0
    assert machine.calls[-1] == f"{PIP} -e {machine.root}"
    assert list(logs.iterdir()) == []
    assert (f"{PIP} uv" in machine.calls) == (why == "uv fails")


@pytest.mark.parametrize("uv", [False, True])
def test_an_extra_goes_into_the_venv_with_uv_and_without(machine: Machine, *, uv: bool) -> None:
    machine.add("python3", PYTHON)
    if uv:
        machine.add("uv", UV)
    machine.run("demo")
    done = machine.run("setup", "ros2", "plot")
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr == "PointIt with ros2 plot is in .venv: source .venv/bin/activate\n"

    pip = f"{'' if uv else 'fetched '}uv pip install --quiet --python {machine.root}/.venv/bin/python"
    assert machine.calls[-1] == f"{pip} -e {machine.root}[ros2,plot]"
    machine.run("setup", "ros2", "plot")
    assert (machine.calls, machine.run("setup", "web", "lab").returncode) == ([], 0)
    assert machine.calls[-1] == f"{pip} -e {machine.root}[web] -e {machine.root}/lab"
    assert machine.run("setup", "lab").returncode == 0
    assert machine.calls[-1] == f"{pip} -e {machine.root} -e {machine.root}/lab"
    assert machine.run("setup", "dev").returncode == 0
    assert machine.calls[-1] == f"{pip} -e {machine.root}[dev] -e {machine.root}/lab"


def test_an_extra_that_does_not_exist_is_refused(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    done = machine.run("setup", "web", "ros")
    assert done.returncode == 1
    extras = (
        "plot web record site ble fusion mcp mqtt lsl home-assistant home webhooks "
        "speech qtm discovery docs foxglove ros2 test dev lab"
    )
    assert done.stderr == f"setup: there is no extra 'ros'; there are: {extras}\n"
    assert machine.calls == []


def test_a_python_without_any_pip_is_told_what_to_install(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    done = machine.run("demo", NO_PIP="1")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "has no pip; on Debian and Ubuntu: apt install python3-venv" in done.stderr
    assert machine.run("demo").returncode == 0


def test_the_pip_of_the_python_fetches_uv_into_the_venv(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    machine.add("pip", "")
    assert machine.run("demo", NO_PIP="1").returncode == 0
    python = f"{machine.root}/.venv/bin/python"
    assert machine.calls[1:] == [
        f"python -m pip --python {python} install --quiet --disable-pip-version-check uv",
        f"fetched uv pip install --quiet --python {python} -e {machine.root}[web]",
        "pointit run scenario_4",
    ]


@pytest.mark.parametrize("tool", ["uv", "fetched uv", "python -m"])
def test_pip_of_the_venv_installs_into_it(machine: Machine, tool: str) -> None:
    machine.add("python3", PYTHON)
    machine.add("uv" if tool == "uv" else "pip", UV)
    index = {"PIP_CONFIG": ":env:.index-url='https://pypi.example'"} if tool == "python -m" else {}
    assert machine.run("setup", **index).returncode == 0
    environment = {"PATH": str(machine.bin), "CALLS": str(machine.calls_file)}
    subprocess.run(
        [machine.root / ".venv/bin/pip", "install", "my-wrist"], env=environment, check=True, timeout=30
    )
    into = f" --python {machine.root}/.venv/bin/python" if tool == "python -m" else ""
    assert machine.calls[-1] == f"{tool} pip{into} install my-wrist"


def test_a_failed_installation_shows_why_and_is_tried_again(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    done = machine.run("demo", NO_NET="no route to the index")
    assert done.returncode == 1
    assert done.stderr.startswith("no route to the index\n")
    assert "could not be installed" in done.stderr
    assert (machine.run("demo").returncode, machine.calls[-1]) == (0, "pointit run scenario_4")


def test_a_venv_whose_python_is_gone_is_made_anew(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    machine.run("demo")
    (machine.root / ".venv" / "bin" / "python").unlink()
    done = machine.run("demo")
    assert done.returncode == 0
    assert "recreating .venv" in done.stderr
    assert machine.calls[0].startswith("python -m venv")


def test_check_goes_on_after_a_failure_and_names_what_failed(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    machine.run("setup", "dev")
    for name, status in {"ruff": 0, "pyrefly": 1}.items():
        tool = machine.root / ".venv" / "bin" / name
        tool.write_text(f'#!/bin/sh\necho "{name} complains"\nexit {status}\n', encoding="utf-8")
        tool.chmod(0o755)
    # the page has tests of its own
    (machine.root / "scripts" / "page").write_text("#!/bin/sh\nexit 3\n", encoding="utf-8")

    done = machine.run("check")
    assert (done.returncode, done.stderr) == (1, "failed: page,pyrefly\n")
    ends = Counter(line.split()[0] for line in done.stdout.splitlines() if line.startswith(("ok", "FAILED")))
    assert ends == {"ok": 6, "FAILED": 2}
    assert "pyrefly complains" in done.stdout
    assert "ruff complains" not in done.stdout
    assert sorted(machine.calls) == [
        "pointit topic schema --check",
        "python scripts/expression-load --limits",
        "python scripts/house --limits",
    ]


def test_all_scripts_are_executable_and_parse() -> None:
    scripts = [*(ROOT / "scripts").iterdir(), *(ROOT / ".ci").iterdir()]
    for script in (each for each in scripts if each.is_file() and each.suffix != ".toml"):
        text = script.read_text(encoding="utf-8")
        if script.suffix == ".py" or "python" in text.partition("\n")[0]:
            compile(text, script, "exec")
        else:
            assert subprocess.run(["bash", "-n", script], check=False).returncode == 0  # noqa: S607 - any bash
        assert script.suffix in (".py", ".sh") or os.access(script, os.X_OK), f"{script} is not executable"


@pytest.mark.parametrize("there", [False, True])
def test_ci_installs_what_tests_need_and_says_what_is_missing(machine: Machine, *, there: bool) -> None:
    record_scripts(machine)
    machine.add("id", "#!/bin/sh\necho 0\n")
    machine.add("apt-get", '#!/bin/sh\necho "apt-get $*" >> "$CALLS"; echo "E: no net"; exit 100\n')
    needed = [
        *("ip", "tc", "nft", "unshare", "sysctl", "script", "mosquitto", "nginx", "olad", "prometheus"),
        *("promtool", "systemd-analyze", "espeak-ng", "sox"),
    ]
    for tool in (*needed, "google-chrome") if there else ():
        machine.add(tool, "#!/bin/sh\n")

    done = machine.run("../.ci/run")
    assert done.returncode == 0  # without it tests are skipped, for reasons that are not listed
    assert ("apt-get update" in machine.calls) == (not there)

    told = f"*** missing on this machine: chromium {' '.join(needed)} ***"
    assert (told in done.stderr) == (not there)
    assert ("E: no net" in done.stderr) == (not there)

    ran = [call for call in machine.calls if not call.startswith("apt-get")]
    assert ran == ["setup 1 dev", "check 1 ", "test 1 --all", "seeds 1 --commit 60"]


@pytest.mark.parametrize("folder", [COMPUTING, "tests"])
def test_scripts_test_fails_when_either_part_does(machine: Machine, folder: str) -> None:
    machine.add("python3", PYTHON)
    machine.run("test", "--all")
    python = machine.root / ".venv/bin/python"
    failing = f'case "$*" in *"-n "*" {folder}") echo "1 failed in {folder}"; exit 1 ;; esac\n'
    python.write_text(PYTHON.replace('case "$1" in\n', failing + 'case "$1" in\n', 1), encoding="utf-8")
    done = machine.run("test", "--all")
    assert (done.returncode, f"1 failed in {folder}\n" in done.stdout) == (1, True)


@pytest.mark.parametrize("fails", ["setup", "check", "test", "seeds"])
def test_ci_fails_when_a_part_does(machine: Machine, fails: str) -> None:
    record_scripts(machine)
    path = machine.root / "scripts" / fails
    path.write_text(f"{path.read_text()}exit 1\n", encoding="utf-8")
    machine.add("id", "#!/bin/sh\necho 1\n")
    assert machine.run("../.ci/run").returncode == 1
    ran = [call.partition(" ")[0] for call in machine.calls]
    assert ran == (["setup"] if fails == "setup" else ["setup", "check", "test", "seeds"])


def record_scripts(machine: Machine) -> None:
    shutil.copytree(ROOT / ".ci", machine.root / ".ci")
    for name in ("setup", "check", "test", "seeds"):
        path = machine.root / "scripts" / name
        path.write_text(f'#!/bin/sh\necho "{name} $LOCKED $*" >> "$CALLS"\n', encoding="utf-8")


def parts_of(machine: Machine) -> list[str]:
    """Return the two last calls, which run beside each other: the unit tests last."""
    return sorted(machine.calls[-2:], key=lambda call: call.endswith(f" {COMPUTING}"))


def test_all_tests_except_the_nightly_run_in_two_parts(machine: Machine) -> None:
    machine.add("python3", PYTHON)
    machine.run("test", "--all")
    waiting, computing = parts_of(machine)
    usual = r"python -m pytest -n \d+ -q --dist loadfile --no-loadscope-reorder .* -m not long .*"
    left_out = (
        "--ignore tests/containers --ignore tests/interop --ignore=tests/unit --ignore=tests/simulation"
    )
    assert re.fullmatch(f"{usual} {left_out} tests", waiting)
    assert re.fullmatch(f"{usual} {COMPUTING}", computing)
    assert "--ignore" not in computing
    night = (ROOT / ".ci/nightly").read_text(encoding="utf-8")
    assert {"tests/containers", "tests/interop"} <= {*night.split()}


NIGHT_SCRIPTS = ("scripts/setup", "scripts/test", "scripts/mutants", ".ci/containers", ".ci/versions")


@pytest.fixture
def night_machine(machine: Machine) -> Machine:
    """Return a machine whose scripts record their calls; one that $BREAKS fails."""
    shutil.copytree(ROOT / ".ci", machine.root / ".ci")
    for script in NIGHT_SCRIPTS:
        recorder = f'#!/bin/sh\necho "{script} $*" >> "$CALLS"\ntest "$BREAKS" != {script}\n'
        (machine.root / script).write_text(recorder, encoding="utf-8")
    machine.add("git", "#!/bin/sh\necho 0123abc\n")
    return machine


def test_night_runs_the_named_parts_only(night_machine: Machine) -> None:
    done = night_machine.run("../.ci/nightly", "versions", "mutants")
    assert done.returncode == 0
    assert night_machine.calls == [
        "scripts/setup dev",
        ".ci/versions ",
        "scripts/mutants --sample 100 --seed 0123abc",
    ]


def test_night_goes_on_after_a_failed_part(night_machine: Machine) -> None:
    done = night_machine.run("../.ci/nightly", "containers", "long", BREAKS=".ci/containers")
    assert done.returncode == 1
    results = [line.split()[:2] for line in done.stdout.splitlines()[-2:]]
    assert results == [["FAILED", "containers"], ["ok", "long"]]
    assert len([call for call in night_machine.calls if call.startswith("scripts/test")]) == 1


def test_night_refuses_an_unknown_part_before_anything_runs(night_machine: Machine) -> None:
    done = night_machine.run("../.ci/nightly", "long", "figure")
    assert done.returncode == 2
    assert (
        "there is no part figure: choose from containers long seeds versions mutants figures" in done.stderr
    )
    assert night_machine.calls == []
