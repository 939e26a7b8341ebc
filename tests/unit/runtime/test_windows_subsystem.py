"""The advice for a page in WSL 2, with kernels and `wslinfo` as Windows 11 has them."""

from pathlib import Path

import pytest

from pointit.runtime.host import windows_subsystem
from pointit.runtime.host.windows_subsystem import lan_advice

WSL = (
    "Linux version 5.15.167.4-microsoft-standard-WSL2 (root@f9c826d3017f) (gcc (GCC) 11.2.0, GNU ld "
    "(GNU Binutils) 2.37) #1 SMP Tue Nov 5 00:21:55 UTC 2024\n"
)
DEBIAN = "Linux version 6.1.0-28-amd64 (debian-kernel@lists.debian.org) (gcc-12 (Debian 12.2.0-14) 12.2.0)\n"


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the kernel's version and the commands of a machine."""
    monkeypatch.setattr(windows_subsystem, "_KERNEL", tmp_path / "version")
    monkeypatch.setenv("PATH", str(tmp_path))
    return tmp_path


def write_mode(machine: Path, mode: str) -> None:
    program = machine / "wslinfo"
    program.write_text(f'#!/bin/sh\n[ "$1" = --networking-mode ] && echo {mode}\n')
    program.chmod(0o755)


@pytest.mark.parametrize("kernel", [DEBIAN, ""])
def test_advice_is_empty_on_other_systems(machine: Path, kernel: str) -> None:
    (machine / "version").write_text(kernel)
    write_mode(machine, "nat")
    assert lan_advice(8443) == ""


def test_advice_is_empty_without_the_file_of_the_kernel(machine: Path) -> None:
    assert not (machine / "version").exists()
    assert lan_advice(8443) == ""


@pytest.mark.parametrize("mode", ["nat", "virtioproxy", "none"])
def test_advice_is_the_mirrored_mode_when_only_windows_reaches_linux(machine: Path, mode: str) -> None:
    (machine / "version").write_text(WSL)
    write_mode(machine, mode)
    assert "write `networkingMode=mirrored` below `[wsl2]`" in lan_advice(8443)


def test_mirrored_mode_is_advised_when_an_old_wsl_states_none(machine: Path) -> None:
    (machine / "version").write_text(WSL)
    assert "networkingMode=mirrored" in lan_advice(8443)


def test_advice_is_the_firewall_of_windows_in_the_mirrored_mode(machine: Path) -> None:
    (machine / "version").write_text(WSL)
    write_mode(machine, "mirrored")
    assert "New-NetFirewallHyperVRule" in lan_advice(9000)
    assert "-LocalPorts 9000 " in lan_advice(9000)
