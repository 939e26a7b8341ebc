/** Texts in the scene that face the viewer, of one visual angle at every distance: for headsets, which show no elements of the page. */

import * as THREE from "three";
import type { Read3 } from "../geometry/vec";
import type { Theme } from "./mesh_factory";

/** Height of a line, rad. */
export const LINE_RAD = 0.028;
const LINE_PX = 56;
/** Height of a small letter, px of the canvas. */
export const LETTER_SHARE = (0.5 * 40) / LINE_PX;
/** Length of a line of `inLines`, characters. */
const LINE_LENGTH = 36;
const FONT = "600 40px system-ui, sans-serif";

/** `text` in lines of about one length. */
export function inLines(text: string): string {
  const lines = [""];
  for (const word of text.split(/\s+/)) {
    if (lines.at(-1)!.length + word.length > LINE_LENGTH) lines.push(word);
    else lines[lines.length - 1] = `${lines.at(-1)} ${word}`.trim();
  }
  return lines.join("\n");
}

/** A sprite with `text`, whose lines are separated by newlines. */
export function textSprite(text: string, theme: Theme, color = ""): THREE.Sprite {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d")!;
  const lines = text.split("\n");
  context.font = FONT;
  canvas.width = Math.ceil(Math.max(...lines.map((line) => context.measureText(line).width))) + 48;
  canvas.height = LINE_PX * lines.length + 16;
  context.fillStyle = theme.paper;
  context.strokeStyle = color || "transparent";
  context.lineWidth = 6;
  context.beginPath();
  context.roundRect(3, 3, canvas.width - 6, canvas.height - 6, 18);
  context.fill();
  context.stroke();
  context.font = FONT; // a canvas forgets it when it is resized
  context.fillStyle = theme.ink;
  context.textBaseline = "middle";
  lines.forEach((line, i) => context.fillText(line, 24, 8 + LINE_PX * (i + 0.5)));
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = THREE.SRGBColorSpace;
  const sprite = new THREE.Sprite(
    new THREE.SpriteMaterial({
      map,
      depthTest: false,
      depthWrite: false,
      sizeAttenuation: false,
      fog: false,
    }),
  );
  const height = (LINE_RAD * canvas.height) / LINE_PX;
  sprite.scale.set((height * canvas.width) / canvas.height, height, 1);
  sprite.renderOrder = 20;
  return sprite;
}

export function disposeSprite(sprite: THREE.Sprite): void {
  sprite.removeFromParent();
  sprite.material.map!.dispose();
  sprite.material.dispose();
}

/** A label of a frame. */
export interface Text {
  readonly key: string;
  readonly at: Read3;
  readonly text: string;
  /** CSS colour of its frame, or "". */
  readonly color: string;
}

/** Sprites of the labels of a frame. */
export class Sprites {
  private readonly shown = new Map<string, THREE.Sprite>();

  constructor(private readonly group: THREE.Object3D) {}

  clear(): void {
    for (const sprite of this.shown.values()) disposeSprite(sprite);
    this.shown.clear();
  }

  show(texts: readonly Text[], theme: Theme): void {
    const keys = new Set<string>();
    for (const { key, at, text, color } of texts) {
      const name = `${theme.dark}|${color}|${key}|${text}`;
      keys.add(name);
      let sprite = this.shown.get(name);
      if (!sprite) {
        sprite = textSprite(text, theme, color);
        this.shown.set(name, sprite);
        this.group.add(sprite);
      }
      sprite.position.set(...at);
    }
    for (const [name, sprite] of this.shown) {
      if (keys.has(name)) continue;
      disposeSprite(sprite);
      this.shown.delete(name);
    }
  }
}
