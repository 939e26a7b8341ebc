"""Run the bridge on its own: `python -m pointit.bridges.web --help`."""

from pointit.bridges.web.service import SERVICE
from pointit.runtime.service.process import main

main(SERVICE)
