"""`python -m tests.docs.timed`: phases of the first hour of a newcomer, each with its duration.

Clones the last commit and, with caches that are empty, starts `scripts/demo` in the clone until its page
answers. Then it runs the blocks of the README and of the tutorial there, as `scripts/docs` does. Downloads,
and takes minutes: not in CI.
"""

import argparse
import asyncio
import os
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path

import httpx
import uv

from tests.docs.blocks import ROOT, RUN, blocks
from tests.docs.shell import shell
from tests.support import there
from tests.support.links import FILE, link_in

TUTORIAL = ("index", "shelf", "room", "wrist", "two-people", "secured-site")
PAGES = ("README.md", *(f"docs/tutorial/{name}.md" for name in TUTORIAL))


class Timer:
    """Prints phases, each with the seconds since the one before, and since the beginning."""

    def __init__(self) -> None:
        self.begin = self._last = time.monotonic()

    def told(self, phase: str) -> None:
        now = time.monotonic()
        sys.stdout.write(f"{now - self._last:7.1f} s {now - self.begin:7.1f} s  {phase}\n")
        sys.stdout.flush()
        self._last = now


def environment(folder: Path, installer: str) -> dict[str, str]:
    """Return the environment of a new machine: empty home and caches, uv only if it is the installer."""
    bin_ = folder / "bin"
    home = folder / "home"
    for each in (bin_, home):
        each.mkdir()
    if installer == "uv":
        (bin_ / "uv").symlink_to(uv.find_uv_bin())
    kept = [each for each in os.environ["PATH"].split(os.pathsep) if not (Path(each) / "uv").exists()]
    foreign = ("POINTIT_", "XDG_", "VIRTUAL_ENV", "PIP_FIND_LINKS", "LOCKED", "UV_CACHE", "PIP_CACHE")
    return {
        **{key: value for key, value in os.environ.items() if not key.startswith(foreign)},
        "HOME": str(home),
        "PATH": os.pathsep.join([str(bin_), *kept]),
    }


async def demo(clone: Path, timer: Timer, reader: dict[str, str]) -> None:
    """Start it until its page answers, then press Ctrl-C."""
    process = await asyncio.create_subprocess_exec(
        clone / "scripts/demo", "--no-browser", cwd=clone, env=reader, start_new_session=True,
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT,
    )  # fmt: skip
    stdout = there(process.stdout)
    printed = ""
    parts = {".venv/bin/python": "has a .venv", ".venv/.installed-web": "has installed"}
    reading = asyncio.ensure_future(stdout.readline())
    try:
        while not FILE.search(printed):
            done, _ = await asyncio.wait({reading}, timeout=0.1)
            for part in [each for each in parts if (clone / each).exists()]:
                timer.told(f"scripts/demo {parts.pop(part)}")
            if done:
                printed += (line := reading.result()).decode()
                assert line, f"scripts/demo ended and printed\n{printed}"
                reading = asyncio.ensure_future(stdout.readline())
        timer.told("scripts/demo names its page")
        async with httpx.AsyncClient(follow_redirects=True) as client:
            (await client.get(link_in(printed))).raise_for_status()
        timer.told(f"scripts/demo shows its page, {time.monotonic() - timer.begin:.1f} s from the beginning")
    finally:
        reading.cancel()
        os.killpg(process.pid, signal.SIGINT)
        await process.wait()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    timer.told(f"scripts/demo ended with {process.returncode}; CPU {used.ru_utime + used.ru_stime:.1f} s")


async def main() -> None:
    """Print the phases."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(": ")[2])
    parser.add_argument("--installer", choices=("uv", "pip"), default="pip", help="pip: a machine without uv")
    parser.add_argument("--demo", action="store_true", help="only scripts/demo")
    parser.add_argument("--of", type=Path, default=ROOT, metavar="FOLDER", help="checkout that is cloned")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="timed-") as name:
        folder = Path(name)
        timer = Timer()
        reader = environment(folder, arguments.installer)
        clone = folder / "pointit"
        git = await asyncio.create_subprocess_exec("git", "clone", "--quiet", arguments.of.resolve(), clone)
        assert not await git.wait(), f"git could not clone {arguments.of}; the reason stands above"
        timer.told("git clone")
        await demo(clone, timer, reader)
        for page in () if arguments.demo else PAGES:
            place = folder / Path(page).stem
            place.mkdir()
            async with shell(place, clone) as terminal:
                for block in blocks(ROOT / page, (clone / page).read_text(encoding="utf-8")):
                    if block.title:
                        (place / "page" / block.title).write_text(block.code, encoding="utf-8")
                    elif block.language in RUN and not block.no_run:
                        await terminal.run(block)
                        timer.told(f"{block.place}: {block.code.splitlines()[0]}")
                await terminal.end()


if __name__ == "__main__":
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # what a background job starts would ignore Ctrl-C
    asyncio.run(main())
