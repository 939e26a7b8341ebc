/** Who moves the person's wrist: their own device or the simulation, a mouse, a phone, a headset. */

import type { Option } from "../ui/columns";
import type { Controls } from "../controls";
import type { Mouse } from "../mouse";
import type { Pairing } from "./pairing";
import { Choice } from "../ui/choice";
import { Button } from "../ui/elements";
import { titledPart, type PanelPart } from "../ui/part";
import { Slider } from "../ui/slider";
import type { PersonLine } from "../wire";

type Source = PersonLine["source"];

const OWN: Record<Source, Option> = {
  simulation: { value: "own", label: "Demo", icon: "play" },
  device: { value: "own", label: "Own device", icon: "watch" },
  none: { value: "own", label: "Nobody", icon: "pause" },
  unknown: { value: "own", label: "Own device", icon: "watch" },
};
const MOUSE: Option = { value: "mouse", label: "Mouse", icon: "mouse" };
const PHONE: Option = { value: "phone", label: "Phone", icon: "phone" };
const HEADSET: Option = { value: "headset", label: "Headset", icon: "headset" };

export function whoPointsPart(controls: Controls, mouse: Mouse, pairing: Pairing): PanelPart {
  return titledPart(
    "Who points",
    () => controls.user !== "" && optionsOf(controls).length > 1,
    () => <WhoPoints controls={controls} mouse={mouse} pairing={pairing} />,
  );
}

interface WhoPointsProps {
  controls: Controls;
  mouse: Pick<Mouse, "take" | "give" | "shake" | "tremor">;
  pairing: Pick<Pairing, "open">;
}

export function WhoPoints({ controls, mouse, pairing }: WhoPointsProps) {
  const { user } = controls;
  const line = controls.person?.line ?? null;
  const movedBy = line?.moved_by ?? "own";
  const isMine = line?.is_mine ?? false;
  const isOther = movedBy === "mouse" && !isMine;
  const phone = phoneText(line);

  async function release(): Promise<void> {
    if (controls.mine?.user === user) await mouse.give();
    else await controls.ask({ deed: "give", name: user });
    controls.changed();
  }

  function choose(who: string): void {
    if (who === "mouse") void mouse.take();
    else if (who === "phone") pairing.open();
    else if (who === "own") void release();
    controls.changed();
  }

  return (
    <>
      <Choice
        legend="Who points"
        isBare
        options={optionsOf(controls)}
        value={isOther ? "" : movedBy}
        onChoose={choose}
      />
      <p class="muted">{sentenceOf(user, line)}</p>
      {isOther && controls.mayDo("take") && (
        <Button name="Take over" icon="mouse" onClick={() => void mouse.take()} />
      )}
      {movedBy === "mouse" && isMine && controls.mayDo("tremor") && (
        <Slider
          label="Tremor of the mouse's arm"
          min={0}
          max={3}
          step={0.1}
          unit="°"
          initial={0}
          value={mouse.tremor}
          send={(degrees) => mouse.shake(degrees)}
          onInvalid={(problem) => controls.toasts.show("error", problem)}
        />
      )}
      {movedBy === "phone" && !phone && controls.mayDo("pair") && (
        <Button name="Show the QR code" icon="phone" onClick={() => pairing.open()} />
      )}
      {movedBy !== "phone" && phone && <p class="muted">{`Phone: ${phone}.`}</p>}
      {phone && controls.mayDo("pair") && (
        <Button
          name="Unpair the phone"
          icon="close"
          onClick={() => void controls.ask({ deed: "pair", name: user, query: { off: true } })}
        />
      )}
    </>
  );
}

/** What may move the wrist of the chosen person. */
function optionsOf(controls: Controls): Option[] {
  const options = [OWN[controls.sourceOf(controls.user)]];
  if (controls.mayDo("take")) options.push(MOUSE);
  if (controls.mayDo("pair")) options.push(PHONE);
  if (controls.person?.line?.moved_by === "headset") options.push(HEADSET);
  return options;
}

/** `connected, battery 80 %`, or "" without a phone. */
function phoneText(line: PersonLine | null): string {
  if (!line?.phone) return "";
  return line.battery == null ? line.phone : `${line.phone}, battery ${Math.round(line.battery * 100)} %`;
}

function sentenceOf(user: string, line: PersonLine | null): string {
  switch (line?.moved_by ?? "own") {
    case "mouse":
      return line?.is_mine ? "You point with this mouse; arrow keys too." : "Another page's mouse points.";
    case "headset":
      return "A headset points.";
    case "phone":
      return line?.phone ? `A phone points (${phoneText(line)}).` : "A phone points.";
    default:
      return ownSentence(user, line?.source ?? "device");
  }
}

function ownSentence(user: string, source: Source): string {
  const sentences: Record<Source, string> = {
    simulation: `${user} is simulated and points by themself.`,
    device: `${user} points with their own device.`,
    none: `Nobody moves the arm of ${user} yet: take it.`,
    unknown: "",
  };
  return sentences[source];
}
