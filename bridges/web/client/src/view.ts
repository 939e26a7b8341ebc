/** What draws the site: the 3-D scene (`scene/`) and the plan (`plan/`, SVG) are views with one interface. */

import type { Separability } from "./geometry/separability";
import type { Edges } from "./geometry/framing";
import type { Rect } from "./geometry/placing";
import type { Vec3 } from "./geometry/vec";
import type { Step } from "./messages";
import type { Site } from "./site/site";
import type { HeadsetMotion } from "./wire";

/** From where a view looks; `eyes` are those of the chosen person. A view may lack some. */
export type Camera = "room" | "top" | "eyes";

export interface ViewStats {
  /** Frames drawn in the last second. */
  fps: number;
  /** As WebGL names it, or "SVG". */
  renderer: string;
  /** Drawn without a graphics processor: the view is in its light mode. */
  software: boolean;
  /** Matrix from {W} to clip coordinates, 4 x 4 by columns; empty in a view without perspective. */
  readonly lens: readonly number[];
  /** What a headset's wearer reads before the eyes, or "". */
  readonly note?: string;
}

/** The arm that the wearer of a headset may move. Requests return the reason of a refusal, or "". */
export interface Arm {
  /** Person whom the wearer points as, or "". */
  readonly pointing: string;
  /** That person, or else the one whom `take` is for; "" if the page may move nobody. */
  readonly user: string;
  take(): Promise<string>;
  give(): void;
  /** Press the button, which went down `heldMs` ago: what was pointed at before that counts. */
  press(heldMs: number): Promise<string>;
  /** From the announced thing to the one left or right of it, or in the row above or below, or to the nearest. */
  step(by: -1 | 1, to: Step["to"]): Promise<string>;
  move(measured: Pick<HeadsetMotion, "alignment" | "eyes_m" | "tip_m">): void;
}

/** A view in the viewer's own room, through a headset or a phone (WebXR). */
export interface Immersion {
  readonly isActive: boolean;
  /** Whether this browser and device can do it. */
  isSupported(): Promise<boolean>;
  /**
   * Begin; to be called by a click. `turn` is called before each of its frames, since the page's own may not come.
   *
   * @throws Error with one sentence if it cannot begin.
   */
  enter(turn: () => void): Promise<void>;
  leave(): void;
  /** Tell the wearer a sentence, for some seconds. */
  tell(sentence: string): void;
  /** Show the wearer's next step for some seconds, once until it is another one. */
  tellStep(step: string): void;
}

export interface ViewOptions {
  readonly arm: Arm;
  /** Called while the mouse (or a finger, or the arrow keys) points: a point in {W} on the surface below it. */
  onAim(at: Vec3): void;
  /** The view cannot go on (its graphics context is gone and did not come back): another should take over. */
  onLost(): void;
  /** Called when an immersion has begun or ended. */
  onImmersed(): void;
}

export interface View {
  readonly stats: ViewStats;
  readonly cameras: readonly Camera[];
  /** Absent in a view without perspective. */
  readonly immersion?: Immersion;
  /** Draw `site` as of now. Called from an animation frame, at most once for each, when something has changed. */
  draw(site: Site): void;
  setTheme(dark: boolean): void;
  setCamera(camera: Camera, user: string): void;
  /** Colour the floor by the things that are not told apart from there, or no longer. */
  setSeparability(separability: Separability | null): void;
  /** Place on the floor, {W}, below the browser window's (x, y), px; null where there is no floor. */
  floorAt(x: number, y: number): readonly [number, number] | null;
  /**
   * Put no label there: cards lie over these parts of the view, px; and frame between `edges`, px, what people
   * point at. A view that begins below the cards has no need of it.
   */
  keepClear?(covered: readonly Rect[], edges: Edges): void;
  /** While on, moving over the view aims (a cross-hair shows, dragging still turns the camera); `user`: whose arm. */
  setPointing(on: boolean, user: string): void;
  /** Move the aimed-at point by metres to the right of the view and up (away) in it; for arrow keys. */
  nudge(right: number, away: number): void;
  /** Show that the person points there, {W}, as chosen from the list; `onAim` is not called. */
  pointAt(at: Vec3): void;
  /** Place of a lamp, an object or a robot as it is drawn, {W}; null if it is not there. */
  placeOf(id: string): Vec3 | null;
  /** The arm rests: show no aim until the person points again. */
  rest(): void;
  /** Remove everything from the page. */
  dispose(): void;
}

/** Makes a view within `host`; throws when it cannot (no WebGL). */
export type MakeView = (host: HTMLElement, options: ViewOptions) => View;
