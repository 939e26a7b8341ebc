"""A process that is controlled by lines of JSON."""

import asyncio
import json
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.support.pace import Patience

PATIENCE_S = 20.0
POLL_S = 0.02


class Told:
    """Answers each line on its standard input by one: `{"value": …}`, or `{"error": "…"}`."""

    def __init__(
        self, name: str, command: Sequence[str], said: Path, environment: Mapping[str, str] | None = None
    ) -> None:
        """Start it, with its standard error to the file `said`; `name` is for people."""
        self.name = name
        self._said = said
        self._turn = threading.Lock()
        """Answers carry no names: each query waits until the one before has been answered."""
        with said.open("w") as stderr:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr, text=True,
                env=environment,
            )  # fmt: skip

    def wait(self) -> None:
        """Return when it is ready, which it reports by `{}`."""
        line = self._line()
        assert line == "{}\n", f"{self.name}: {line} {self._last_words()}"

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()

    def end(self) -> None:
        """Close its input and wait for its end."""
        self._process.communicate()
        assert self._process.returncode == 0, f"{self.name}: {self._last_words()}"

    @property
    def is_alive(self) -> bool:
        return self._process.poll() is None

    def complaints(self) -> str:
        return self._said.read_text()

    def _last_words(self) -> str:
        return self.complaints()[-2000:]

    def ask(self, **order: Any) -> Any:
        """Send `order` and return the answer."""
        assert self._process.stdin is not None
        with self._turn:
            self._process.stdin.write(json.dumps(order) + "\n")
            self._process.stdin.flush()
            line = self._line()
        assert line, f"{self.name} has ended: {self._last_words()}"
        answer = json.loads(line)
        if "error" in answer:
            order_text = str(order)[:500]
            raise AssertionError(f"{self.name}: {order_text}: {answer['error'][:300]}")
        return answer["value"]

    async def do(self, what: str, **order: Any) -> Any:
        """Send an order without blocking the loop. Return the answer."""
        return await asyncio.to_thread(self.ask, do=what, **order)

    async def until(self, what: str, fits: Callable[[Any], object], **order: Any) -> Any:
        """Repeat an order until the answer fits. Return that."""
        patience = Patience(PATIENCE_S)
        answer = await self.do(what, **order)
        while not fits(answer):
            late = patience.is_over()
            last = str(answer)[:500]
            assert not late, f"{self.name} {what} {order}: still {last} after {patience}"
            await asyncio.sleep(POLL_S)
            answer = await self.do(what, **order)
        return answer

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()
