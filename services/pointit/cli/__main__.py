"""`python -m pointit.cli`, and where the command `pointit` begins."""

import signal


def begin() -> None:
    """Run the command line."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C while modules load: the end, without a traceback
    from pointit.cli.main import main  # noqa: PLC0415 - loads modules

    main()


if __name__ == "__main__":
    begin()
