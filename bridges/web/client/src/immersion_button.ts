/** The button that shows the scene in the viewer's own room. It is hidden until the browser reports that it can. */

import { el, icon, mark, show, write } from "./dom";
import type { Toasts } from "./toasts";
import type { Immersion, View } from "./view";

export class ImmersionButton {
  readonly element = el(
    "button",
    { type: "button", hidden: true, onclick: () => void this.toggle() },
    icon("headset"),
    el("span", { text: "In your room" }),
  );
  private immersion: Immersion | null = null;

  /** @param turn takes over what the server has sent, before each frame of the session. */
  constructor(
    private readonly toasts: Toasts,
    private readonly turn: () => void,
  ) {
    this.element.title = "Show names, rays and cursors where they are, through this headset or phone";
  }

  /** Offer that of a new view. */
  async offer({ immersion }: View): Promise<void> {
    this.immersion = immersion ?? null;
    this.update();
    show(this.element, false);
    const isSupported = (await immersion?.isSupported()) ?? false;
    if (this.immersion === immersion) show(this.element, isSupported);
  }

  update(): void {
    mark(this.element, "aria-pressed", String(this.immersion?.isActive ?? false));
    write(this.element.querySelector("span")!, this.immersion?.isActive ? "Leave your room" : "In your room");
  }

  private async toggle(): Promise<void> {
    const { immersion } = this;
    if (immersion?.isActive) return immersion.leave();
    this.element.disabled = true;
    try {
      await immersion?.enter(this.turn);
    } catch (error) {
      this.toasts.show("error", error instanceof Error ? error.message : String(error));
    } finally {
      this.element.disabled = false;
      this.update();
    }
  }
}
