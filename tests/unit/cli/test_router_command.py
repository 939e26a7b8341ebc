"""`pointit router`, without routing."""

import subprocess
import sys

import pytest

STARTS_WITH_FEW_FILES = """
import resource
_, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (256, hard))
from pointit.cli import router

def run_async(work):
    work.close()
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    print(soft == hard > 256)
    return 0

router.run_async = run_async
router.command([])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there may be no limit, or none that is raised")
def test_it_may_have_as_many_files_open_as_the_system_lets_it() -> None:
    started = subprocess.run(
        [sys.executable, "-c", STARTS_WITH_FEW_FILES], capture_output=True, text=True, check=False
    )
    assert (started.stdout, started.stderr) == ("True\n", "")
