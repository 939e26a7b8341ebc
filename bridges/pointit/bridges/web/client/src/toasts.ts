/** Short news at the foot of the scene; read out politely. */

import { el, icon } from "./dom";

type Kind = "done" | "info" | "wrong" | "error";
const STAYS_MS: Record<Kind, number> = { done: 3500, info: 4500, wrong: 4500, error: 8000 };
const ICONS: Record<Kind, string> = { done: "check", info: "info", wrong: "close", error: "warning" };
const MOST = 3;

export class Toasts {
  /** @param host is a live region in the page. */
  constructor(private readonly host: HTMLElement) {}

  show(kind: Kind, text: string): void {
    for (const other of this.host.querySelectorAll(".toast")) {
      if (other.querySelector("span")?.textContent === text) other.remove();
    }
    const toast = el("div", { className: "toast", "data-kind": kind }, icon(ICONS[kind]), el("span", { text }));
    if (kind === "error") {
      toast.append(el("button", { className: "quiet", type: "button", "aria-label": "Close", onclick: () => toast.remove() }, icon("close")));
    }
    this.host.append(toast);
    while (this.host.children.length > MOST) this.host.firstElementChild!.remove();
    setTimeout(() => toast.remove(), STAYS_MS[kind]);
  }
}
