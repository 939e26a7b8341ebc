/** The way into the plan editor, for operators; it is loaded when it is opened. */

import "./edit.css";
import { useState } from "preact/hooks";
import type { Controls } from "../controls";
import { Button } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";

export function mapPart(controls: Controls): PanelPart {
  return titledPart(
    "Map",
    () => controls.mayDo("read_map") && controls.site.timeline === null && controls.isPresent("pui"),
    () => <EditMap controls={controls} />,
  );
}

function EditMap({ controls }: { controls: Controls }) {
  const [isOpening, setOpening] = useState(false);

  async function open(): Promise<void> {
    setOpening(true);
    try {
      const { openEditor } = await import("./editor");
      await openEditor(controls);
    } finally {
      setOpening(false);
    }
  }

  return <Button name="Edit the map" icon="map" isOff={isOpening} onClick={() => void open()} />;
}
