"""Run the service on its own: `python -m pointit.services.led_driver --help`."""

from pointit.runtime.service.process import main
from pointit.services.led_driver.service import SERVICE

main(SERVICE)
