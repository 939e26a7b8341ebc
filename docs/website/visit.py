"""The demo, recorded, in a page of the site: `visit.html`, which the front page shows."""

import asyncio
import functools
import re
import tempfile
from pathlib import Path

from pointit.bridges.web.playback.file_past import FilePast
from pointit.bridges.web.playback.page_file import page_file
from pointit.recording.reader import Recording
from tests.support.recorded import session, write_recording

LENGTH_S = 45.0
LEAD_S = 3.0
"""Time before the first selection at which the page begins to play, s."""
STILL = re.compile(r"!\[[^\]]*\]\(pictures/window-light\.webp\)")
"""Picture of the front page, over which the page lies where there is room."""

FRAME = r"""<div class="visit" markdown>

\g<0>

<iframe src="visit.html" title="Two simulated people at the conveyor, recorded" loading="lazy"></iframe>

</div>

A recorded session in the page itself, [also in a window of its own](visit.html): play it, drag the position,
look around."""


@functools.cache
def visit() -> str:
    """Return the HTML: two simulated people at the conveyor, in virtual time."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "demo.mcap"
        write_recording(path, session("scenario_4", LENGTH_S, ("anna", "ben")))
        with Recording.open(path) as recording:
            past = FilePast(recording, "demo")
            asyncio.run(past.read())
            lanes = past.timeline().lanes
            first_s = min(
                start_s for lane in lanes if lane.kind == "selections" for start_s, _, _ in lane.items
            )
            return page_file(past, start_s=first_s - LEAD_S)


def framed(markdown: str) -> str:
    """Return the front page with the page over its picture."""
    return STILL.sub(FRAME, markdown)
