"""The sessions of the gate, and how they were recorded: simulated people, real services, virtual time."""

from pathlib import Path

from pointit.recording.entries import Entry
from pointit.recording.reader import Recording
from pointit.replay.playing import Collector
from pointit.replay.replayed_services import SERVICES, Split
from pointit.runtime.bus.contract import Bus
from pointit.runtime.virtual_time import START_NS, VirtualClock
from pointit.schemas import NS_PER_S
from pointit.schemas.system import split_instance
from pointit.schemas.topics import CONFIGURATION, HEALTH, MAP, SERVICE_ALIVE, Request
from tests.golden import scripts
from tests.golden.bad_link import BadLink
from tests.golden.sessions import SESSIONS as GOLDEN
from tests.golden.sessions import Session, choices, play
from tests.support.recorded import write_recording

RECORDINGS = Path(__file__).with_name("recordings")

SESSIONS: dict[str, Session] = {
    "lamps": Session(
        scenario="scenario_1", duration_s=8.0, happens=("leds/led_1/color", "users/anna/cursor=lamp")
    ),
    "strips": Session(scenario="scenario_2", duration_s=8.0, happens=("users/anna/cursor=strip",)),
    "goal": Session(scenario="send_a_robot", duration_s=20.0, happens=("users/anna/goal",)),
    "restarts": Session(
        scenario="scenario_3", duration_s=20.0, restarts=True, happens=("selection/events=selected",)
    ),
    "bad_link": Session(
        scenario="scenario_3", duration_s=20.0, link=BadLink, happens=("selection/events=selected",)
    ),
    "workspaces": GOLDEN["a shard and workspaces"],
    "things": Session(
        scenario="shelf",
        duration_s=28.0,
        choices=choices("pui.map=room.yaml", "user-sim.target_kinds=[kettle,screws,crate]"),
        script=scripts.tries_things,
        room=scripts.THINGS,
        happens=(
            *("selection/events=screws", "selection/events=crate", "selection/events=kettle"),
            *("selection/events=radio", "selection/events=cart", "leds/radio/color"),
        ),
    ),
}


def record(name: str) -> Path:
    """Record the session `name`: what its edge wrote, and when its services began and ended."""
    session = SESSIONS[name]
    entries: list[Entry] = []

    def listen(onlooker: Bus) -> None:
        Collector(onlooker, VirtualClock(), entries.append)

    play(session, listen, through_link=True)
    split = Split("edge", {entry.name for entry in entries if entry.row is CONFIGURATION})
    end_ns = START_NS + round((session.duration_s - 0.01) * NS_PER_S)
    path = RECORDINGS / f"{name}.mcap"
    path.parent.mkdir(exist_ok=True)
    inputs = (entry for entry in entries if entry.time_ns < end_ns and _is_input(entry, split))
    return write_recording(path, inputs, seed=session.choices.seed)


def _is_input(entry: Entry, split: Split) -> bool:
    if entry.row in (CONFIGURATION, SERVICE_ALIVE):
        return split_instance(entry.name)[0] in SERVICES["edge"]
    if isinstance(entry.row, Request):  # asked again, unless the replayed supervisor does
        return True
    return entry.row is MAP or (entry.row is not HEALTH and not split.is_recomputed(entry))


def open_recording(name: str) -> Recording:
    return Recording.open(RECORDINGS / f"{name}.mcap")
