"""This machine's Chromium, without a window and without a graphics processor."""

import shutil
import subprocess
import threading
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from playwright.async_api import Browser, async_playwright

from tests.support import there

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *(
        "--disable-gpu-compositing",
        "--disable-gpu-rasterization",
    ),  # by software that takes as much as the scene
)
AS_PLAYWRIGHT = (
    *("--headless", "--hide-scrollbars", "--mute-audio", "--disable-extensions", "--disable-popup-blocking"),
    *("--disable-background-timer-throttling", "--disable-backgrounding-occluded-windows"),
    *("--disable-renderer-backgrounding", "--disable-ipc-flooding-protection", "--force-color-profile=srgb"),
    *("--no-default-browser-check", "--password-store=basic", "--use-mock-keychain", "--disable-breakpad"),
    "--blink-settings=primaryHoverType=2,availableHoverTypes=2,primaryPointerType=4,availablePointerTypes=4",
)
"""Flags with which Playwright starts a browser, which it does not where it joins one."""


def installed() -> str | None:
    paths = filter(None, map(shutil.which, NAMES))
    return next(paths, None)


@asynccontextmanager
async def chromium(path: str) -> AsyncGenerator[Browser]:
    """Yield the browser at `path`; it is closed whatever happens."""
    async with async_playwright() as playwright:
        opened = await playwright.chromium.launch(executable_path=path, args=FLAGS)
        try:
            yield opened
        finally:
            await opened.close()


@contextmanager
def shared_chromium(path: str, folder: Path) -> Generator[str]:
    """Run the browser at `path` for many tests; yield the address at which each may join it."""
    options = ("--remote-debugging-port=0", f"--user-data-dir={folder}", "about:blank")
    command = [path, *FLAGS, *AS_PLAYWRIGHT, *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        said = there(process.stderr)
        address = next(line.split()[-1] for line in said if "DevTools listening on" in line)
        reading = threading.Thread(target=said.read)  # a full pipe would stop it
        reading.start()
        try:
            yield address
        finally:
            process.terminate()
            reading.join()


@asynccontextmanager
async def joined(address: str) -> AsyncGenerator[Browser]:
    """Yield a running browser; contexts that are made in it end with the block."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.connect_over_cdp(address)
        try:
            yield browser
        finally:
            await browser.close()
