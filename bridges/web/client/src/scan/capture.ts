/** Takes one view: shows step after step of the lights, and reads them in the camera's frames. */

import type { Camera } from "./camera";
import { stepsOf, type Colour } from "./code";
import { Reader, type Seen, type Trouble } from "./reader";

export interface Capture {
  seen: Seen[];
  /** The first frame in which the lights shone, smaller; their positions are those in it. It stays in the page. */
  still: ImageBitmap;
  width: number;
  height: number;
}

/** A view that could not be read: a sentence for the person. */
export class Unread extends Error {}

export interface Lights {
  /** Show a step; returns when it was sent. */
  show(step: number, brightness: number): Promise<void>;
}

const DARK = -1;
/** Time for lights, network and camera to become dark, ms. */
const DARK_MS = 450;
const BRIGHTNESSES = { first: 0.35, least: 0.08, most: 1 };
const TRIES = 5;

const NAMES = ["red", "green", "blue"];
const SENTENCES: Record<Trouble, string> = {
  nothing:
    "The camera sees no lights that blink: point it at the strips, and darken the room if it is very bright.",
  bloom:
    "The lights are too bright even when dimmed, and run into each other: step back, or make the room brighter.",
  faint: "The lights are too faint: step closer, or darken the room.",
  colours: "",
  moved:
    "The phone moved while the lights blinked: hold it still with both hands for two seconds, and take the view again.",
  lost: "Most lights were lost on the way: something came between, or the camera turned away. Take the view again.",
  crowd:
    "The whole picture moves or flickers: hold the camera still, away from screens and mirrors of the sun.",
  unread:
    "The lights were seen, but their numbers do not fit: hold still, or step closer so that they do not touch each other.",
};

export class Capturer {
  private brightness = BRIGHTNESSES.first;

  /** `slowMs`: time that the slowest lights take beyond the answer of `lights`, ms. */
  constructor(
    private readonly camera: Camera,
    private readonly lights: Lights,
    private readonly slowMs = 0,
  ) {}

  /**
   * Take a view of `count` lights; `progress` gets the share that is done.
   * @throws Unread
   */
  async take(count: number, progress: (share: number) => void): Promise<Capture> {
    await this.camera.hold();
    for (let left = TRIES; ; left--) {
      const result = await this.attempt(count, progress);
      if ("seen" in result) return result;
      const brighter = result.trouble === "nothing" || result.trouble === "faint";
      const next = Math.min(
        BRIGHTNESSES.most,
        Math.max(BRIGHTNESSES.least, this.brightness * (brighter ? 1.7 : 0.6)),
      );
      const isAboutLight = brighter || result.trouble === "bloom";
      if (!isAboutLight || next === this.brightness || left <= 1)
        throw new Unread(sentence(result.trouble, result.shown));
      this.brightness = next;
    }
  }

  private async attempt(
    count: number,
    progress: (share: number) => void,
  ): Promise<Capture | { trouble: Trouble; shown?: Colour }> {
    await this.lights.show(DARK, 0);
    await new Promise((resolve) => setTimeout(resolve, DARK_MS));
    await this.camera.look("dark");
    const { width, height } = await this.camera.look("dark");
    const reader = new Reader(count, width, this.slowMs);
    await this.lights.show(0, this.brightness);
    let shownAt = performance.now();
    let still: ImageBitmap | null = null;
    for (;;) {
      const { blobs } = await this.camera.look("lit");
      if (!this.camera.isLive) throw new Unread("The camera has ended: load the page again.");
      const verdict = reader.take(blobs, performance.now() - shownAt);
      if (verdict.kind === "done") return { seen: verdict.seen, still: still!, width, height };
      if (verdict.kind === "trouble") return verdict;
      if (verdict.kind === "show") {
        progress(verdict.step / stepsOf(count));
        still ??= await this.camera.still();
        await this.lights.show(verdict.step, this.brightness);
        shownAt = performance.now();
      }
    }
  }
}

function sentence(trouble: Trouble, shown?: Colour): string {
  if (trouble !== "colours") return SENTENCES[trouble];
  return `The lights show other colours than asked for (${NAMES[shown ?? 0]} among them): correct \`order\` of the LED output.`;
}
