/** Short news at the foot of the scene; read out politely. */

import { el, icon } from "./dom";

type Kind = "done" | "info" | "wrong" | "error";
const STAYS_MS: Record<Kind, number> = { done: 3500, info: 4500, wrong: 4500, error: 8000 };
/** A toast with a button stays so long, ms. */
const ACTION_MS = 15_000;
const ICONS: Record<Kind, string> = { done: "check", info: "info", wrong: "close", error: "warning" };
const MOST = 3;

interface Action {
  readonly name: string;
  run(): void;
}

export class Toasts {
  private readonly topics = new WeakMap<Element, unknown>();

  /** @param host is a live region in the page. */
  constructor(private readonly host: HTMLElement) {}

  /** Remove toasts with a button: what it would do no longer fits. */
  endActions(): void {
    for (const button of this.host.querySelectorAll(".action")) button.closest(".toast")!.remove();
  }

  /** @param action a button in it, for which it stays longer; topic: of the action that it tells of, whose toast it replaces. */
  show(
    kind: Kind,
    text: string,
    { action, topic = text }: { action?: Action | undefined; topic?: unknown } = {},
  ): void {
    for (const other of this.host.querySelectorAll(".toast"))
      if (this.topics.get(other) === topic) other.remove();
    const toast = el(
      "div",
      { className: "toast", "data-kind": kind },
      icon(ICONS[kind]),
      el("span", { text }),
    );
    if (kind === "error") {
      toast.append(
        el(
          "button",
          { className: "quiet", type: "button", "aria-label": "Close", onclick: () => toast.remove() },
          icon("close"),
        ),
      );
    }
    if (action) {
      this.endActions();
      toast.append(
        el(
          "button",
          {
            type: "button",
            className: "action",
            onclick: () => {
              toast.remove();
              action.run();
            },
          },
          el("span", { text: action.name }),
        ),
      );
    }
    this.topics.set(toast, topic);
    this.host.append(toast);
    while (this.host.children.length > MOST) this.host.firstElementChild!.remove();
    const end = (): void => {
      if (action && toast.matches(":hover, :focus-within")) setTimeout(end, STAYS_MS[kind]);
      else toast.remove();
    };
    setTimeout(end, action ? ACTION_MS : STAYS_MS[kind]);
  }
}
