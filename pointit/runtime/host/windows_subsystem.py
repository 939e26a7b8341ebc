"""Windows Subsystem for Linux (WSL 2): how other machines reach this one."""

import subprocess
from pathlib import Path

_KERNEL = Path("/proc/version")
_MARK = "microsoft"
"""Part of the kernel's name: `5.15.90.1-microsoft-standard-WSL2`."""
_ASK_MODE = ("wslinfo", "--networking-mode")
"""Command of WSL 2.0 and newer. It prints `nat`, `mirrored`, `virtioproxy` or `none`."""
_ASK_TIMEOUT_S = 3.0
_MIRRORED = "mirrored"
_VM_CREATOR = "{40E0AC32-46A5-438A-A0B2-2B479E8F2E90}"
"""Identity of WSL in the Hyper-V firewall, by Microsoft's page on it."""


def lan_advice(port: int) -> str:
    """Return advice to reach a page at `port` of this machine if it runs in WSL 2, else `""`. Blocks.

    In the mode `mirrored`, Linux has the addresses of Windows, and Windows' firewall decides. In the other
    modes Linux has an address that only Windows reaches.
    """
    if not is_wsl():
        return ""
    if networking_mode() == _MIRRORED:
        return (
            "this is Linux in Windows: if others do not reach the page, permit the port in Windows, as "
            "administrator: New-NetFirewallHyperVRule -Name pointit -DisplayName PointIt -Direction Inbound "
            f"-VMCreatorId '{_VM_CREATOR}' -Protocol TCP -LocalPorts {port} -Action Allow"
        )
    return (
        "this is Linux in Windows, and only Windows reaches this address: write `networkingMode=mirrored` "
        "below `[wsl2]` in the file .wslconfig of your Windows folder, run `wsl --shutdown` in Windows, and "
        "start again"
    )


def is_wsl() -> bool:
    """Return True if this Linux runs in WSL 2."""
    try:
        return _MARK in _KERNEL.read_text(encoding="utf-8").lower()
    except (OSError, UnicodeError):
        return False


def networking_mode() -> str:
    """Return WSL's networking mode, or `""` if this version does not state it. Blocks for 3 s at most."""
    try:
        done = subprocess.run(  # noqa: S603 - a constant
            _ASK_MODE,
            capture_output=True,
            text=True,
            check=True,
            timeout=_ASK_TIMEOUT_S,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.SubprocessError, UnicodeError):
        return ""
    return done.stdout.strip()
