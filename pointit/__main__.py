"""`python -m pointit`, and the entry point of the command `pointit`."""

import gc
import os
import signal


def begin() -> None:
    """Run the command line."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C while modules load: exit without a traceback
    from pointit.runtime.host.standard_streams import open_closed_streams  # noqa: PLC0415 - loads modules

    open_closed_streams()  # first: what opens files would get the numbers of the streams
    gc.disable()  # until the command is loaded: collections take a tenth of that time, and find nothing
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: threads only take time to start
    from pointit.cli.main import main  # noqa: PLC0415 - loads modules

    main()


if __name__ == "__main__":
    begin()
