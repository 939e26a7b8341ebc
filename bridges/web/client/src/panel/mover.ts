/** Who moves the person's wrist: their own device or the simulation, a mouse, a phone, a headset. */

import { choice } from "../choice";
import type { Controls } from "../controls";
import { el, icon, section, show, write } from "../dom";
import type { Mouse } from "../mouse";
import { slider } from "../slider";
import type { Pairing } from "./pairing";
import type { PanelPart } from "./panel_part";

export function moverPart(controls: Controls, mouse: Mouse, pairing: Pairing): PanelPart {
  const who = choice("Who points", (value) => {
    if (value === "mouse") void mouse.take();
    else if (value === "phone") pairing.open();
    else if (value === "own") void release();
    controls.changed();
  });
  who.element.classList.add("bare");
  const line = el("p", { className: "muted" });
  const takeOver = el(
    "button",
    { type: "button", onclick: () => void mouse.take() },
    icon("mouse"),
    el("span", { text: "Take over" }),
  );
  const tremor = slider({
    label: "Tremor of the mouse's arm",
    min: 0,
    max: 3,
    step: 0.1,
    unit: "°",
    initial: () => 0,
    send: (value) => mouse.shake(value),
    onInvalid: (problem) => controls.toasts.show("error", problem),
  });
  const pair = el(
    "button",
    { type: "button", onclick: () => pairing.open() },
    icon("phone"),
    el("span", { text: "Show the QR code" }),
  );
  const unpair = el(
    "button",
    {
      type: "button",
      onclick: () => void controls.ask({ deed: "pair", name: controls.user, query: { off: true } }),
    },
    icon("close"),
    el("span", { text: "Unpair the phone" }),
  );
  const paired = el("p", { className: "muted" });
  const element = section("Who points", who.element, line, takeOver, tremor.element, pair, paired, unpair);

  async function release(): Promise<void> {
    if (controls.mine?.user === controls.user) await mouse.give();
    else await controls.ask({ deed: "give", name: controls.user });
    controls.changed();
  }

  return {
    element,
    update() {
      const { user, person } = controls;
      const moved = person?.line?.moved_by ?? "own";
      const source = controls.sourceOf(user);
      const options = [
        {
          simulation: { value: "own", label: "Demo", icon: "play" },
          device: { value: "own", label: "Own device", icon: "watch" },
          none: { value: "own", label: "Nobody", icon: "pause" },
          unknown: { value: "own", label: "Own device", icon: "watch" },
        }[source],
      ];
      if (controls.mayDo("take")) options.push({ value: "mouse", label: "Mouse", icon: "mouse" });
      if (controls.mayDo("pair")) options.push({ value: "phone", label: "Phone", icon: "phone" });
      if (moved === "headset") options.push({ value: "headset", label: "Headset", icon: "headset" });
      who.offer(options);
      show(element, user !== "" && options.length > 1);
      const isMine = person?.line?.is_mine ?? false;
      who.set(moved === "mouse" && !isMine ? "" : moved); // another page's mouse is none of these
      show(takeOver, moved === "mouse" && !isMine && controls.mayDo("take"));
      const phone = person?.line?.phone ?? "";
      const charge = person?.line?.battery;
      write(
        line,
        moved === "own"
          ? {
              simulation: `${user} is simulated and points by themself.`,
              device: `${user} points with their own device.`,
              none: `Nobody moves the arm of ${user} yet: take it.`,
              unknown: "",
            }[source]
          : moved === "mouse"
            ? isMine
              ? "You point with this mouse; arrow keys too."
              : "Another page's mouse points."
            : moved === "headset"
              ? "A headset points."
              : `A phone points${phone ? ` (${phone}${charge == null ? "" : `, battery ${Math.round(charge * 100)} %`})` : ""}.`,
      );
      show(tremor.element, moved === "mouse" && isMine && controls.mayDo("tremor"));
      tremor.set(mouse.tremor);
      show(pair, controls.mayDo("pair") && phone === "" && moved === "phone");
      show(unpair, controls.mayDo("pair") && phone !== "");
      show(paired, phone !== "" && moved !== "phone");
      write(paired, `Phone: ${phone}${charge == null ? "" : `, battery ${Math.round(charge * 100)} %`}.`);
    },
  };
}
