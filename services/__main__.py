"""One service as a process of its own: `python -m pointit.services pointing --help`."""

import click

from pointit.runtime.service.process import run_program, service_command
from pointit.services.registry import process


class _Services(click.Group):
    """Services by name, with those of bridges and other packages."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        """Return the command of the service `cmd_name`. Only its modules are loaded."""
        try:
            row = process(cmd_name)
        except KeyError as error:
            raise click.UsageError(f"{error.args[0]}", ctx) from error
        return service_command(row.load(), row.label)


services = _Services(
    name="python -m pointit.services",
    options_metavar="",
    subcommand_metavar="NAME [OPTIONS]...",
    help="Run one service as a process. `pointit service list` describes them.",
)

if __name__ == "__main__":
    # Unloading Python's modules takes 0.1 s of a core, too long for ten processes that end on two cores.
    run_program(services, at_once=True)
