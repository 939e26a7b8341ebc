/** The large part of the page: the view, which one it is, from where it looks. */

import { render } from "preact";
import { ImmersionButton } from "./immersion_button";
import { SeparabilityToggle } from "./separability_toggle";
import type { Controls } from "./controls";
import { el, isTouch, show, write } from "./dom";
import type { Edges } from "./geometry/framing";
import type { Rect } from "./geometry/placing";
import type { Vec3 } from "./geometry/vec";
import { PlanList } from "./plan/list";
import { makePlan } from "./plan/plan";
import { isDark } from "./theme";
import { Choice } from "./ui/choice";
import type { Arm, Camera, MakeView, View } from "./view";

const CAMERAS: Record<Camera, { label: string; icon: string }> = {
  room: { label: "Room", icon: "cube" },
  top: { label: "Top", icon: "map" },
  eyes: { label: "Eyes", icon: "eye" },
};
/** A view that fails this many frames in a row is replaced by the plan. */
const MOST_FAILURES = 20;

/** Whether the browser can draw in three dimensions. */
function hasWebGl(): boolean {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("webgl2");
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return context !== null;
}

export class Stage {
  view: View | null = null;
  /** The room has been drawn once. */
  isDrawn = false;
  private readonly list = new PlanList({ follow: (id) => this.follow(id) });
  /** Person whose arm this page moves, and the id that they keep pointing at, chosen from the list; or "". */
  private pointing = "";
  private followed = "";
  private readonly cameras = el("div", {});
  readonly separability: SeparabilityToggle;
  private readonly immersion: ImmersionButton;
  private camera: Camera = "room";
  private user = "";
  private readonly hint = el("p", { className: "hint", text: "Drag turns the view, the wheel zooms" });
  /** A hand has moved the view: it needs no hint. */
  private wasTurned = false;
  private making = 0;
  private failures = 0;

  /**
   * @param host where the view is drawn.
   * @param chip where is said how it is drawn, when that matters.
   * @param cards what else may lie over the view.
   * @param edgeCards those that the scene is framed between, with the choice of cameras.
   * @param onAim the mouse points there, {W}.
   * @param onNew a new view is there.
   * @param arm what the wearer of a headset may move.
   * @param turn draws a frame of the page if anything has changed.
   */
  constructor(
    private readonly host: HTMLElement,
    cameras: HTMLElement,
    private readonly chip: HTMLElement,
    private readonly cards: readonly HTMLElement[],
    private readonly edgeCards: readonly HTMLElement[],
    private readonly controls: Controls,
    private readonly onAim: (at: Vec3) => void,
    private readonly onNew: () => void,
    private readonly arm: Arm,
    turn: () => void,
  ) {
    host.parentElement!.append(this.list.element);
    this.separability = new SeparabilityToggle(controls, () =>
      this.view?.setSeparability(this.separability.shown),
    );
    this.immersion = new ImmersionButton(controls.toasts, turn);
    cameras.append(
      this.hint,
      this.separability.legend,
      this.cameras,
      this.separability.button,
      this.immersion.element,
    );
    host.addEventListener("pointermove", ({ clientX, clientY }) =>
      this.separability.over(this.view?.floorAt(clientX, clientY) ?? null),
    );
    host.addEventListener("pointerleave", () => this.separability.over(null));
    const turned = (): void => void (this.wasTurned = true);
    host.addEventListener("wheel", turned, { capture: true, passive: true });
    host.addEventListener("pointermove", ({ buttons }) => buttons && turned(), true);
  }

  /** Make the view that is wanted, or, where it cannot be had, the plan. */
  async make(): Promise<void> {
    const turn = ++this.making;
    const { settings, toasts } = this.controls;
    let make: MakeView = makePlan;
    try {
      if (settings.view !== "plan") {
        if (hasWebGl()) make = (await import("./scene/scene")).makeScene;
        else if (settings.view === "scene")
          toasts.show("info", "This browser has no WebGL 2: the plan is shown.");
      }
      if (turn === this.making) this.put(make);
    } catch (error) {
      this.controls.connection.fault(error);
      if (turn === this.making) this.put(makePlan);
    }
  }

  /** Draw the site as of now. */
  draw(): void {
    if (!this.view) return;
    try {
      this.view.draw(this.controls.site);
      const pointing = this.controls.mine?.user ?? "";
      if (pointing !== this.pointing) {
        this.pointing = pointing;
        this.follow("");
      }
      this.chase();
      this.list.update(this.controls.site);
      this.isDrawn ||= this.controls.site.map !== null;
      this.failures = 0;
    } catch (error) {
      this.controls.connection.fault(error);
      this.failures += 1;
      if (this.failures === MOST_FAILURES && this.view.stats.renderer !== "SVG") this.giveWay();
    }
  }

  /** Keep pointing at a lamp, an object or a robot as it moves; "" ends it. */
  private follow(id: string): void {
    this.followed = this.pointing && id;
    this.list.offer(this.pointing !== "", this.followed);
    this.chase();
  }

  private chase(): void {
    if (!this.followed) return;
    const at = this.view?.placeOf(this.followed);
    const { site } = this.controls;
    if (!at || site.robots.get(this.followed)?.state?.user === this.pointing) return this.follow(""); // a robot that follows the person would run away
    this.view!.pointAt(at);
    this.onAim(at);
  }

  look(camera: Camera): void {
    if (!this.view?.cameras.includes(camera)) return;
    this.camera = camera;
    this.user = this.controls.user;
    this.view.setCamera(camera, this.user);
    this.drawCameras();
  }

  /** Draw the choice of where to look from, if there is one. */
  private drawCameras(): void {
    const cameras = this.view?.cameras ?? [];
    show(this.cameras, cameras.length > 1);
    render(
      <Choice
        legend="View from"
        isBare
        options={cameras.map((value) => ({ value, ...CAMERAS[value] }))}
        value={this.camera}
        onChoose={(value) => this.look(value as Camera)}
      />,
      this.cameras,
    );
  }

  theme(): void {
    this.view?.setTheme(isDark(this.controls.settings.theme));
  }

  update(): void {
    const { view } = this;
    if (!view) return;
    if (this.camera === "eyes" && this.user !== this.controls.user) this.look("eyes");
    this.drawCameras();
    this.separability.update();
    view.keepClear?.(this.covered(), this.edges());
    const { software, renderer } = view.stats;
    show(this.hint, !this.wasTurned && renderer !== "SVG" && this.camera === "room");
    show(this.chip, software);
    write(this.chip, software ? "Drawn simply: no graphics processor" : "");
    this.chip.title = renderer;
  }

  /** How a hand moves the view, for the help. */
  get gestures(): readonly (readonly [string, string])[] {
    if (this.view?.stats.renderer === "SVG")
      return [
        ["Drag", "Move the plan"],
        [isTouch() ? "Two fingers" : "Wheel", "Nearer, or farther away"],
      ];
    if (isTouch())
      return [
        ["One finger", "Turn the view; while you are the arm, point"],
        ["Two fingers", "Move the view, nearer or farther away"],
      ];
    return [
      ["Drag", "Turn the view"],
      ["Right drag", "Move the view"],
      ["Wheel", "Nearer, or farther away"],
    ];
  }

  /** What lies over the view, px. */
  private covered(): Rect[] {
    const { left, top } = this.host.getBoundingClientRect();
    return this.cards
      .map((card) => card.getBoundingClientRect())
      .filter(({ width }) => width > 0)
      .map(({ x, y, width, height }) => ({ x: x - left, y: y - top, width, height }));
  }

  /** What the cards at the top and at the foot leave free. */
  private edges(): Edges {
    const { top, bottom } = this.host.getBoundingClientRect();
    const edges = { top: 0, bottom: 0 };
    const cards = [this.cameras, ...this.edgeCards];
    for (const card of cards.map((each) => each.getBoundingClientRect())) {
      if (card.height && card.top + card.bottom < top + bottom)
        edges.top = Math.max(edges.top, card.bottom - top);
      else if (card.height) edges.bottom = Math.max(edges.bottom, bottom - card.top);
    }
    return edges;
  }

  private giveWay(): void {
    this.controls.toasts.show("error", "The scene cannot be drawn here: the plan is shown.");
    this.put(makePlan);
  }

  private put(make: MakeView): void {
    this.view?.dispose();
    this.view = null;
    this.host.replaceChildren();
    this.view = make(this.host, {
      arm: this.arm,
      onAim: (at) => {
        if (this.followed) this.follow("");
        this.onAim(at);
      },
      onLost: () => this.giveWay(),
      onImmersed: () => this.immersion.update(),
    });
    this.theme();
    const { cameras } = this.view;
    if (!cameras.includes(this.camera)) this.camera = cameras[0] ?? "room";
    this.look(this.camera);
    this.view.setSeparability(this.separability.shown);
    this.failures = 0;
    void this.immersion.offer(this.view);
    this.onNew();
    this.draw();
  }
}
