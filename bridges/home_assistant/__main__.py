"""Run the bridge on its own: `python -m pointit.bridges.home_assistant --help`."""

from pointit.bridges.home_assistant.service import SERVICE
from pointit.runtime.service.process import main

main(SERVICE)
