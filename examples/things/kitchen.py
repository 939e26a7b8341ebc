"""A kitchen: point at the radio to switch it, at the kettle and press to heat water."""

import pointit
from pointit.schemas import SelectionEvent


def cook(site: pointit.Site | pointit.SyncSite) -> None:
    """Call functions from now on. They may take their time: plain ones run in a thread."""

    @site.on_pointed("radio")
    def radio(event: SelectionEvent) -> None:
        state = "on" if event.is_on else "off"
        print(f"{event.user} switches the radio {state}")

    @site.on_pointed("kettle")
    def kettle(event: SelectionEvent) -> None:
        print(f"{event.user} wants hot water")


if __name__ == "__main__":
    with pointit.open() as joined:
        cook(joined)
        joined.wait()  # until Ctrl-C
