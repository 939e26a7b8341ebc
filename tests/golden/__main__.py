"""Rewrites hashes.json, or with --dump writes the messages of sessions for comparison."""

import argparse
import time
from pathlib import Path

from tests.golden.record import Record, read_hashes, write_hashes
from tests.golden.sessions import SESSIONS, play


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.add_argument("sessions", nargs="*", help=f"names, by default all of: {', '.join(SESSIONS)}")
    parser.add_argument("--dump", type=Path, metavar="FOLDER", help="leave hashes.json, write messages here")
    options = parser.parse_args()
    hashes = read_hashes()
    for name in options.sessions or SESSIONS:
        began_s = time.process_time()
        record = play(SESSIONS[name], Record)
        if options.dump:
            record.dump(options.dump / f"{name}.jsonl")
        else:
            hashes[name] = record.hashes()
        print(f"{name}: {time.process_time() - began_s:.1f} s of CPU")  # noqa: T201
    if not options.dump:
        write_hashes({name: hashes[name] for name in SESSIONS})


main()
