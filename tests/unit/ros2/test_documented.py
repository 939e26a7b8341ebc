"""docs/how-to/ros2.md names every route as the table has it."""

from pathlib import Path

from pointit.bridges.ros2.routing.routes import routes

TEXT = (Path(__file__).parents[3] / "docs/how-to/ros2.md").read_text(encoding="utf-8")


def test_every_route_is_documented_and_no_other() -> None:
    rows = [line.split("|") for line in TEXT.splitlines() if line.startswith("| `") and line.count("|") == 5]
    told = {(row[1].strip(" `"), row[2].strip(" `"), row[3].strip()) for row in rows}
    there = {
        (route.name, route.ros, route.type.replace("/msg/", "/").replace("/srv/", "/"))
        for route in routes().all
    }
    assert told == there


def test_what_yields_and_what_is_off_is_said() -> None:
    for route in routes().all:
        (line,) = (line for line in TEXT.splitlines() if line.startswith(f"| `{route.name}` "))
        assert ("yields" in line) is route.yields
        assert ("off by default" in line) is not route.enabled
