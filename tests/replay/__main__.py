"""Compares or accepts the outputs of replayed sessions, or records the sessions again."""

import argparse
import sys
import time

from tests.replay.golden import Outputs, accept, accepted, compare, table
from tests.replay.sessions import SESSIONS, open_recording, record


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.replay",
        description="Replay the sessions of the gate and show what changed. Exits with 1 if something did.",
    )
    parser.add_argument("sessions", nargs="*", help=f"names, by default all of: {', '.join(SESSIONS)}")
    parser.add_argument("--accept", action="store_true", help="store what the replays give now")
    parser.add_argument("--record", action="store_true", help="first record the sessions again")
    options = parser.parse_args()
    changes: list[str] = []
    for name in options.sessions or SESSIONS:
        began_s = time.process_time()
        if options.record:
            record(name)
        with open_recording(name) as recording:
            outputs = Outputs(recording)
        report = compare(list(accepted(name)), outputs.samples)
        if not report.is_same:
            changes.append(table(name, report, outputs.began_ns))
            if options.accept:
                accept(name, outputs.samples)
        state = "the same" if report.is_same else "accepted" if options.accept else "changed"
        print(f"{name}: {state}, {time.process_time() - began_s:.1f} s of CPU", file=sys.stderr)  # noqa: T201
    if changes:
        print("Replayed sessions changed:\n")  # noqa: T201
        print("\n\n".join(changes))  # noqa: T201
    return int(bool(changes) and not options.accept)


if __name__ == "__main__":
    sys.exit(main())
