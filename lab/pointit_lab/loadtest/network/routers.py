"""Routers of a load test: ours or zenohd, by the same configuration."""

import asyncio
import contextlib
import json
import os
import shutil
import signal
import sys
from collections.abc import AsyncGenerator, Sequence
from pathlib import Path
from typing import Any, Literal

from pointit.access.router_configuration import configuration
from pointit.access.site_folder import SiteFolder
from pointit.runtime.errors import ConfigError, ConnectError
from pointit.runtime.link.link import LEASE_MS

Program = Literal["pointit", "zenohd"]
"""Program that routes."""

RETRY = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5}


def plain_configuration(listen: str, uplinks: Sequence[str]) -> dict[str, Any]:
    """Return the configuration of a router that admits anyone."""
    # no scouting: only the links of the test
    scouting = {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}}
    link = {"tx": {"lease": LEASE_MS}}
    connect = {
        "endpoints": list(uplinks),
        "timeout_ms": -1,
        "exit_on_failure": False,
        "retry": RETRY,
    }
    return {
        "mode": "router",
        "listen": {"endpoints": [listen]},
        "connect": connect,
        "scouting": scouting,
        "timestamping": {"enabled": True},
        "transport": {"shared_memory": {"enabled": False}, "link": link},
    }


def secured_configuration(site: SiteFolder, uplinks: Sequence[str], port: int) -> dict[str, Any]:
    """Return the configuration of a router of a site, as `pointit site` makes it, on `port`."""
    router_site = site.router_site(tuple(uplinks))
    router_configuration = configuration([router_site])
    own_port = f":{router_site.port}"
    endpoints: list[str] = []
    for endpoint in router_configuration["listen"]["endpoints"]:
        endpoints.append(endpoint.replace(own_port, f":{port}", 1))
    router_configuration["listen"]["endpoints"] = endpoints
    return router_configuration


@contextlib.asynccontextmanager
async def router_process(
    settings: dict[str, Any], program: Program, folder: Path, place: Sequence[str] = ()
) -> AsyncGenerator[int]:
    """Yield the process id of a router with the configuration `settings`, which is written to `folder`.

    `place` is the command that runs it at another machine. It ends with this process (`with_parent`).

    Raises:
        ConfigError: If it is not installed, or has ended.
    """
    file = _write_configuration(settings, folder)
    command = [*place, *with_parent(), *_command(program), "--config", file]
    environment = {"RUST_LOG": "error", **os.environ}

    # A group of its own: Ctrl-C at a terminal must not end it before the processes that it connects.
    with (folder / "log").open("w") as log:
        process = await asyncio.create_subprocess_exec(
            *command,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env=environment,
            process_group=0,
        )

    # Where a process cannot connect, the reason may be the router's own: its last line says it.
    try:
        yield process.pid
    except ConnectError as error:
        if process.returncode is None:
            raise
        reason = _last_line(folder / "log")
        raise ConfigError(f"the router has ended: {reason}") from error
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGTERM)
        await process.wait()


def with_parent() -> list[str]:
    """Return the command that runs another one that ends with this process, even if that is killed.

    Empty where there is no `setpriv` (util-linux).
    """
    if shutil.which("setpriv") is None:
        return []
    return ["setpriv", "--pdeathsig", "TERM", "--"]


def _command(program: Program) -> list[str]:
    if program == "pointit":
        return [sys.executable, "-m", "pointit", "router", "--most-connections", "1000"]
    if shutil.which(program) is None:
        raise ConfigError(
            "--router zenohd: zenohd is not in PATH; install it (`cargo install zenohd`, or "
            "github.com/eclipse-zenoh/zenoh/releases), or use --router pointit"
        )
    return [program]


def _write_configuration(settings: dict[str, Any], folder: Path) -> str:
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "router.json5"
    file.write_text(json.dumps(settings, indent=1), encoding="utf-8")
    return str(file)


def _last_line(log: Path) -> str:
    text = log.read_text(encoding="utf-8", errors="replace")
    lines = text.strip().splitlines()
    return lines[-1] if lines else "it says nothing"
