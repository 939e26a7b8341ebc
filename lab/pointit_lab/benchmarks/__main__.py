"""Runs the benchmarks: tables for people, JSON for programs."""

import asyncio
import json
import os
import statistics
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from pointit.runtime.host.state_file import VARIABLE, replaced_file
from pointit.runtime.service.process import SWITCH_INTERVAL_S
from pointit_lab.benchmarks import (
    against,
    bare_zenoh,
    cores,
    instructions,
    our_chain,
    rclpy_relay,
    recorder,
    ros2,
    startup,
)
from pointit_lab.benchmarks.bare_zenoh import free_endpoint
from pointit_lab.benchmarks.statistics import Figures, machine

RATE_HZ = 100.0
PARTS = ("latency", "users", "startup", "cores", "lights", "things", "ros2", "recorder")
ON_REQUEST = ("instructions", "hop")
"""Parts that run only if named: Valgrind must be installed, and takes minutes; one hop needs a ROS 2."""
HOP_HZ = 500.0
"""Messages per second through one hop."""
HOP_PEOPLE = 20
"""People of the chain beside it, each at 100 Hz."""
COMPARISON_ROUNDS = 3
THINGS = 24.0
"""Multiple of the duration for which people point at things, of which each fires one in four seconds."""
ROUNDS = 3
"""Alternations of baseline and ours, so that both have the same machine load."""


def latency(rate_hz: float, duration_s: float) -> dict[str, Any]:
    """Measure wrist to light beside bare Zenoh, in one process and in separate ones."""
    # Chains that are compared alternate, so that the machine's load is that of both.
    samples = defaultdict[str, list[float]](list)
    hops = our_chain.HOPS
    for _ in range(ROUNDS):
        samples["direct"] += asyncio.run(bare_zenoh.one_process(hops, rate_hz, duration_s, "direct"))
        samples["default"] += asyncio.run(bare_zenoh.one_process(hops, rate_hz, duration_s, "default"))
        samples["ours"] += asyncio.run(our_chain.one_process(rate_hz, duration_s))
    for _ in range(ROUNDS):
        bare = bare_zenoh.processes(hops, rate_hz, duration_s, free_endpoint())
        samples["bare"] += asyncio.run(bare)
        separate = our_chain.processes(rate_hz, duration_s, free_endpoint())
        samples["separate"] += asyncio.run(separate)

    # errors of each chain, and ours as multiples of the baselines'
    figures = {name: Figures.of(values) for name, values in samples.items()}
    ours = figures["ours"]
    one_process = {
        "bare_zenoh_direct": figures["direct"].as_dict(),
        "bare_zenoh_default": figures["default"].as_dict(),
        "ours": ours.as_dict(),
        "ratio_to_direct": ours.ratio_to(figures["direct"]),
        "ratio_to_default": ours.ratio_to(figures["default"]),
    }
    ours_separate = figures["separate"]
    separate_processes = {
        "bare_zenoh_direct": figures["bare"].as_dict(),
        "ours": ours_separate.as_dict(),
        "ratio_to_direct": ours_separate.ratio_to(figures["bare"]),
    }
    return {
        "rate_hz": rate_hz,
        "hops": hops,
        "one_process": one_process,
        "separate_processes": separate_processes,
    }


def _resolved(_context: click.Context, _option: click.Parameter, commit: str | None) -> str | None:
    return commit and against.resolved(commit)


@click.command()
@click.option("--duration", type=click.FloatRange(0.5), default=5.0, help="seconds for each measurement")
@click.option(
    "--rate",
    type=click.FloatRange(1.0, 1000.0),
    default=RATE_HZ,
    help="samples per second of one wrist, for latency",
)
@click.option("--json", "path", type=click.Path(path_type=Path), help="write everything to this file")
@click.option("--only", type=click.Choice(PARTS + ON_REQUEST), multiple=True, help="just these parts")
@click.option(
    "--against",
    "commit",
    metavar="COMMIT",
    callback=_resolved,
    help="compare latency and CPU time with those of COMMIT instead",
)
@click.option(
    "--rounds",
    type=click.IntRange(1),
    default=COMPARISON_ROUNDS,
    help="number of times that --against measures both trees",
)
def main(
    *, duration: float, rate: float, path: Path | None, only: tuple[str, ...], commit: str, rounds: int
) -> None:
    """Measure speed as ratios to bare Zenoh in the same run; takes about five minutes.

    With --against COMMIT, the latency and users parts run for this tree and for COMMIT in turns, COMMIT in a
    temporary git worktree with this interpreter and its packages. The result is the ratio of the two, its
    mean with a 95 % interval and its spread over the rounds; a round takes six minutes at --duration 4.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    # services must not store their state among that of this machine's user
    state_folder = tempfile.TemporaryDirectory()
    os.environ[VARIABLE] = click.get_current_context().with_resource(state_folder)
    wanted = only or PARTS
    console = Console()
    if commit:
        comparison = against.compare(commit, duration, rounds)
        console.print(against.table(comparison))
        _write(path, comparison)
        return
    result: dict[str, Any] = {"before": machine()}
    if "latency" in wanted:
        console.print("latency: IMU sample to LED frame …")
        result["latency"] = latency(rate, duration)
        console.print(latency_table(result["latency"]))
    if "users" in wanted:
        console.print("users: 100 Hz each, wrists in the services' process and in another one …")
        result |= our_chain.user_rows(duration, free_endpoint)
        tables = [users_table(title, result[part]) for part, title in our_chain.USERS.items()]
        console.print(*tables, sep="\n")
    if "instructions" in wanted:
        console.print("instructions: IMU sample to LED frame, counted by Valgrind …")
        result["instructions"] = instructions.measure()
        console.print(
            "{per_sample} instructions a sample, {people} people; {cpu_us} µs of CPU without Valgrind; "
            "{bytecodes} bytecodes, "
            "{different} different ones".format(**result["instructions"])
        )
        console.print(hops_table(result["instructions"]))
    if "startup" in wanted:
        console.print("start-up …")
        result["startup"] = startup.start()
        console.print(
            "command to first light {command_to_first_light_s} s, without waiting for a core "
            "{first_light_without_queue_s} s, CPU until then {first_light_cpu_s} s, to first cursor "
            "{command_to_first_cursor_s} s, peak memory {memory_peak_mb} MB".format(**result["startup"])
        )
    if "cores" in wanted:
        result["cores"] = cores.run()
        for row in result["cores"]:
            console.print("{core:<30} {map:<12} {us:>8} µs".format(**row))
    if "lights" in wanted:
        result["lights"] = cores.large_site_rows()
        for row in result["lights"]:
            console.print(
                "{pixels} pixels, {outputs:>2} outputs by {kind:<4}, {changes:<10} changed: frame "
                "{frame_ms:.2f} ms of CPU, of which drawing {drawing_ms:.2f} ms".format(**row)
            )
    _measure_bridges(wanted, duration, result, console)
    result["after"] = machine()
    before = result["before"]
    console.print(f"machine: {before['cores']} cores, load {before['load_average']} before")
    _write(path, result)


def measure_hop(duration_s: float) -> dict[str, Any]:
    """Return the CPU time, µs, of a message through an rclpy node, a bare relay, and of a whole chain.

    Raises:
        click.ClickException: There is no rclpy.
    """
    if not rclpy_relay.is_available():
        raise click.ClickException(
            f"{rclpy_relay.PYTHON} is not there; `scripts/test tests/interop/ros2_dds` makes it"
        )
    carried = our_chain.carried(HOP_PEOPLE, duration_s, free_endpoint())
    chain = asyncio.run(carried)
    rclpy = rclpy_relay.measure_cost(HOP_HZ, duration_s)
    zenoh = asyncio.run(bare_zenoh.measure_relay(HOP_HZ, duration_s))
    whole_chain = f"whole chain, {HOP_PEOPLE} people"
    return {
        "one hop through rclpy, Fast DDS": rclpy["us_per_message"],
        "one hop through bare Zenoh": zenoh["us_per_message"],
        whole_chain: chain["services_us_per_sample"],
    }


def _measure_bridges(
    wanted: Sequence[str], duration: float, result: dict[str, Any], console: Console
) -> None:
    """Measure what runs beside the services: functions, ROS bridge, recorder, one hop of others."""
    if "hop" in wanted:
        console.print("hop: a message through rclpy and through bare Zenoh, and a sample through all …")
        rounds = [measure_hop(duration) for _ in range(ROUNDS)]
        result["hop"] = {}
        for carrier in rounds[0]:
            times_us = [figures[carrier] for figures in rounds]
            result["hop"][carrier] = times_us
            low = min(times_us)
            middle = statistics.median(times_us)
            high = max(times_us)
            spread = f"({low:.0f} to {high:.0f})"
            console.print(f"{carrier:<32} {middle:>6.0f} µs of CPU {spread}")

    # Each part is printed as soon as it is measured: all of them take minutes.
    if "things" in wanted:
        console.print("things: IMU sample to the call of a function for what it fires …")
        times_s = asyncio.run(our_chain.pointed(THINGS * duration))
        figures = Figures.of(times_s)
        result["things"] = figures.as_dict()
        console.print(
            "p50 {p50_ms:.2f} ms, p99 {p99_ms:.2f} ms, max {max_ms:.1f} ms, n = {count}".format(
                **result["things"]
            )
        )
    if "ros2" in wanted:
        console.print("ROS 2: the bridge as a process, a node beside it …")
        result["ros2"] = asyncio.run(ros2.measure(duration))
        console.print(ros2_table(result["ros2"]))
    if "recorder" in wanted:
        console.print("recorder: of a run with four people …")
        result["recorder"] = asyncio.run(recorder.measure(duration))
        console.print(
            "{messages_per_s:.0f} messages/s: {recorder_process:.1%} of a core as a process, "
            "which costs the run {cost_to_recorded_run:+.1%}; {cost_in_one_process:+.1%} in the run's own "
            "process, which takes {run:.1%} without".format(**result["recorder"])
        )


def _write(path: Path | None, result: dict[str, Any]) -> None:
    if path is None:
        return
    text = json.dumps(result, indent=2) + "\n"
    with replaced_file(path) as part:
        part.write_text(text, encoding="utf-8")


def latency_table(latency_result: dict[str, Any]) -> Table:
    """Return the latency figures as a table."""
    load = f"{latency_result['hops']} hops at {latency_result['rate_hz']:.0f} Hz"
    table = Table(title=f"IMU sample to LED frame, {load}")
    for column in ("layout", "chain"):
        table.add_column(column, justify="left")
    for column in ("p50 ms", "p99 ms", "max ms", "n"):
        table.add_column(column, justify="right")
    for layout in ("one_process", "separate_processes"):
        for name, figures in latency_result[layout].items():
            if name.startswith("ratio"):
                p50 = f"{figures['p50']:.2f} x"
                p99 = f"{figures['p99']:.2f} x"
                table.add_row(layout, name, p50, p99, "", "")
            else:
                p50 = f"{figures['p50_ms']:.3f}"
                p99 = f"{figures['p99_ms']:.3f}"
                longest = f"{figures['max_ms']:.2f}"
                count = str(figures["count"])
                table.add_row(layout, name, p50, p99, longest, count)
    return table


def users_table(title: str, rows: list[dict[str, Any]]) -> Table:
    """Return the figures per number of people as a table, with what a fit makes of them."""
    costs = our_chain.costs(rows, "services_share_of_a_core")
    caption: str | None = None
    if costs:
        caption = "services: {fixed} % of a core and {sample} µs a sample".format(**costs)
    table = Table(title=f"People at 100 Hz, {title}", caption=caption)
    for column in ("people", "CPU of a core", "services", "driver", "delivered", "p99 age ms"):
        table.add_column(column, justify="right")
    for row in rows:
        users = str(row["users"])
        share = f"{row['services_share_of_a_core']:.1%}"
        services = f"{row['services_us_per_sample']:.0f} µs a sample"
        driver = "apart"
        driver_us = row["driver_us_per_sample"]
        if driver_us:
            driver = f"{driver_us:.0f} µs"
        delivered = f"{row['delivered']:.1%}"
        p99_age_ms = "-"
        age = row["age_of_cursors"]
        if age:
            p99_age_ms = f"{age['p99_ms']:.2f}"
        table.add_row(users, share, services, driver, delivered, p99_age_ms)
    return table


def hops_table(counted: dict[str, Any]) -> Table:
    """Return the instructions of each hop and the messages of each topic, per sample, as a table."""
    table = Table(title="What a sample takes")
    table.add_column("hop or topic")
    table.add_column("instructions", justify="right")
    table.add_column("messages", justify="right")
    table.add_row("wrists and what runs without samples", f"{counted['wrists_and_rest']}", "")
    for hop, count in counted["by_hop"].items():
        table.add_row(hop, f"{count}", "")
    for key, count in counted["messages"].items():
        table.add_row(key, "", f"{count:.2f}")
    return table


def ros2_table(ros2_result: dict[str, Any]) -> Table:
    """Return the cost of the ROS 2 bridge compared with a bare relay as a table."""
    load = ros2_result["before"]["load_average"][0]
    table = Table(title=f"Bridge to ROS 2, load {load}")
    table.add_column("what", justify="left")
    for column in ("messages/s", "CPU of a core", "µs per message", "lost"):
        table.add_column(column, justify="right")
    rows = [("bare relay of bytes", ros2_result["bare_relay"]), ("nothing", ros2_result["nothing"])]
    for direction in ("out", "in", "both"):
        rows += [(direction, row) for row in ros2_result[direction]]
    for name, row in rows:
        us = row["us_per_message"]
        us_text = f"{us:.0f}" if us else "-"
        rate = f"{row['messages_per_second']:.0f}"
        share = f"{row['cpu_share_of_a_core']:.1%}"
        lost = str(row["lost"])
        table.add_row(name, rate, share, us_text, lost)
    return table


if __name__ == "__main__":
    main()
