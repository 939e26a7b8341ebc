"""`python -m pointit.cli`, and the entry point of the command `pointit`."""

import signal


def begin() -> None:
    """Run the command line."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C while modules load: exit without a traceback
    from pointit.cli.main import main  # noqa: PLC0415 - loads modules

    main()


if __name__ == "__main__":
    begin()
