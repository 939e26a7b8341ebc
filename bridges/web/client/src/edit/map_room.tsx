/** The way to the page that maps the room by a camera. */

import type { Controls } from "../controls";
import type { Pairing } from "../people/pairing";
import { Button, LinkButton } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";

/** @param pairing opens the dialog for a phone whose camera maps the room. */
export function mapRoomPart(controls: Controls, pairing: Pairing): PanelPart {
  return titledPart(
    "Map this room",
    () => controls.mayDo("map_room") && Boolean(controls.site.map?.strips.length),
    () => (
      <>
        <p class="muted">The strips blink, a camera sees where they are, and a new map is written.</p>
        <Button name="With a phone" icon="phone" onClick={() => pairing.open()} />
        <LinkButton name="With this computer's camera" icon="camera" href="/scan" target="_blank" />
      </>
    ),
  );
}
