/** Who moves the person's wrist: their own device or the simulation, this page's mouse, a phone. */

import { choice } from "../choice";
import type { Desk } from "../desk";
import { el, icon, section, show, write } from "../dom";
import type { Mouse } from "../mouse";
import { slider } from "../slider";
import type { Pairing } from "./pairing";
import type { Part } from "./part";

export function moverPart(desk: Desk, mouse: Mouse, pairing: Pairing): Part {
  const who = choice("Who points", (value) => {
    if (value === "mouse") void mouse.take();
    else if (value === "phone") pairing.open();
    else void release();
    desk.changed();
  });
  who.element.classList.add("bare");
  const line = el("p", { className: "muted" });
  const takeOver = el("button", { type: "button", onclick: () => void mouse.take() }, icon("mouse"), el("span", { text: "Take over" }));
  const tremor = slider({
    label: "Tremor of the mouse's arm", min: 0, max: 3, step: 0.1,
    text: (value) => (value ? `${value.toFixed(1)}°` : "none"), send: (value) => mouse.shake(value),
  });
  const pair = el("button", { type: "button", onclick: () => pairing.open() }, icon("phone"), el("span", { text: "Show the QR code" }));
  const unpair = el("button", { type: "button", onclick: () => void desk.ask({ deed: "pair", name: desk.user, query: { off: true } }) },
    icon("close"), el("span", { text: "Unpair the phone" }));
  const paired = el("p", { className: "muted" });
  const element = section("Who points", who.element, line, takeOver, tremor.element, pair, paired, unpair);

  async function release(): Promise<void> {
    if (desk.mine?.user === desk.user) await mouse.give();
    else await desk.ask({ deed: "give", name: desk.user }, { isQuiet: true });
    desk.changed();
  }

  return {
    element,
    update() {
      const { user, person } = desk;
      const moved = person?.line?.moved_by ?? "own";
      const options = [
        desk.isSimulated(user)
          ? { value: "own", label: "Demo", icon: "play" }
          : { value: "own", label: "Own device", icon: "watch" },
      ];
      if (desk.mayDo("take")) options.push({ value: "mouse", label: "Mouse", icon: "mouse" });
      if (desk.mayDo("pair")) options.push({ value: "phone", label: "Phone", icon: "phone" });
      who.offer(options);
      show(element, user !== "" && options.length > 1);
      const isMine = person?.line?.is_mine ?? false;
      who.set(moved === "mouse" && !isMine ? "" : moved); // another page's mouse is none of these
      show(takeOver, moved === "mouse" && !isMine && desk.mayDo("take"));
      const phone = person?.line?.phone ?? "";
      const charge = person?.line?.battery;
      write(line, moved === "own"
        ? desk.isSimulated(user) ? `${user} is simulated and points by themself.` : `${user} points with their own device.`
        : moved === "mouse"
          ? isMine ? "You point with this mouse; arrow keys too." : "Another page's mouse points."
          : `A phone points${phone ? ` (${phone}${charge == null ? "" : `, battery ${Math.round(charge * 100)} %`})` : ""}.`);
      show(tremor.element, moved === "mouse" && isMine && desk.mayDo("tremor"));
      tremor.set(mouse.tremor);
      show(pair, desk.mayDo("pair") && phone === "" && moved === "phone");
      show(unpair, desk.mayDo("pair") && phone !== "");
      show(paired, phone !== "" && moved !== "phone");
      write(paired, `Phone: ${phone}${charge == null ? "" : `, battery ${Math.round(charge * 100)} %`}.`);
    },
  };
}
