/**
 * A camera that does not exist: it sees what the LED driver shows on the strips of a room, from one place after the
 * other, with noise, blur, bloom, changes of exposure, a rolling shutter, and the tremor of a hand, which moves each
 * row of a frame by another amount.
 */

import { add, cross, scale, subtract, unit, type Read3 } from "../geometry/vec";
import type { ScanRoom } from "../wire";

export const WIDTH = 800;
export const HEIGHT = 450;
/** Focal length, image pixels. */
const FOCAL = 640;
const FRAME_MS = 66;
/** Amplitude of a hand that holds a phone, about each axis: 2 to 3 image pixels. */
const TREMOR_RAD = 0.002;
/** Steps by which the exposure changes, as a share. */
const EXPOSURE = 0.2;
const NOISE = 3;
/** Level of a light at full brightness from 1 m; a camera takes 255. */
const POWER = 5000;

type Lights = Record<string, string>;

interface Led {
  strip: string;
  pixel: number;
  at: Read3;
}

interface Lit {
  at: Read3;
  rgb: readonly number[];
}

/** A camera's place, and the unit vectors to its right, down and ahead. */
export interface Pose {
  at: Read3;
  axes: readonly [Read3, Read3, Read3];
}

/** Image position of `at`, and its distance ahead, m. */
export function projected(pose: Pose, at: Read3): [number, number, number] {
  const [x, y, z] = pose.axes.map((axis) =>
    axis.reduce((sum, value, i) => sum + value * (at[i]! - pose.at[i]!), 0),
  ) as [number, number, number];
  return [WIDTH / 2 + (FOCAL * x) / z, HEIGHT / 2 + (FOCAL * y) / z, z];
}

/** Look from `at` to `to`, rolled about the line of sight by `roll`, rad. */
export function lookAt(at: Read3, to: Read3, roll = 0): Pose {
  const ahead = unit(subtract(to, at));
  const right = unit([ahead[1], -ahead[0], 0]);
  const down = cross(ahead, right);
  const [c, s] = [Math.cos(roll), Math.sin(roll)];
  return { at, axes: [add(scale(right, c), scale(down, s)), add(scale(down, c), scale(right, -s)), ahead] };
}

export class SimulatedCamera {
  readonly stream: MediaStream;
  private readonly context: CanvasRenderingContext2D;
  private readonly image: ImageData;
  private readonly wall = new Float32Array(WIDTH * HEIGHT * 3);
  private readonly noise = new Float32Array(8192);
  private readonly leds: Led[];
  private readonly middle: Read3;
  private lit: Lit[] = [];
  private before: Lit[] = [];
  private frame = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;

  /**
   * `next`: waits for the next change of the lights, and returns all, by strip, as hexadecimal digits.
   * `place`: number of the first place.
   */
  constructor(
    private readonly room: ScanRoom,
    private readonly next: () => Promise<Lights>,
    private place: number,
  ) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [WIDTH, HEIGHT];
    this.context = canvas.getContext("2d", { alpha: false })!;
    this.image = this.context.createImageData(WIDTH, HEIGHT);
    this.image.data.fill(255);
    for (let i = 0; i < this.noise.length; i++)
      this.noise[i] = NOISE * (Math.random() + Math.random() + Math.random() + Math.random() - 2) * 1.7;
    this.leds = room.strips.flatMap(({ name, places_m }) =>
      places_m.map((at, pixel) => ({ strip: name, pixel, at })),
    );
    const mean = (i: number) => this.leds.reduce((sum, { at }) => sum + at[i]!, 0) / this.leds.length;
    this.middle = [mean(0), mean(1), mean(2)];
    this.furnish();
    this.draw();
    this.stream = canvas.captureStream(1000 / FRAME_MS);
    void this.listen();
  }

  /** Unit vector of "down" in the camera's frame, with the error of a phone's sensor. */
  get gravity(): [number, number, number] {
    return unit(
      this.pose(0).axes.map((axis) => -axis[2] + 0.006 * (Math.random() - 0.5)) as [number, number, number],
    );
  }

  /** Walk to the next place. */
  walk(): void {
    this.place++;
    this.furnish();
  }

  stop(): void {
    clearTimeout(this.timer);
    this.timer = undefined;
  }

  private async listen(): Promise<void> {
    for (;;) {
      const lights = await this.next().catch(() => null);
      if (this.timer === undefined) return;
      if (lights) this.lit = this.leds.flatMap((led) => litOf(led, lights[led.strip]));
      else await new Promise((resolve) => setTimeout(resolve, 500));
    }
  }

  /** `row`: share of the frame's height above it, which is exposed earlier. */
  private pose(tremor: number, row = 0): Pose {
    const at = this.room.places_m[this.place % this.room.places_m.length]!;
    const now = this.frame + 0.5 * row;
    const shake = (k: number) => tremor * (Math.sin(now * 0.9 + k) + Math.sin(now * 0.37 + 2 * k)) * 3;
    const to: Read3 = [this.middle[0] + shake(1), this.middle[1] + shake(2), this.middle[2] + shake(3)];
    return lookAt(at, to, 0.05 * Math.sin(this.place * 2));
  }

  /** A room that is not dark: smooth walls with edges, other ones from each place. */
  private furnish(): void {
    for (let y = 0, i = 0; y < HEIGHT; y++) {
      for (let x = 0; x < WIDTH; x++) {
        const edge = (Math.floor((x + 37 * this.place) / 130) + Math.floor(y / 170)) % 2 ? 12 : 0;
        const level = 26 + 14 * (y / HEIGHT) + edge;
        this.wall[i++] = level + 3;
        this.wall[i++] = level;
        this.wall[i++] = level - 4;
      }
    }
  }

  private draw(): void {
    this.frame++;
    const gain = 1 + 0.04 * Math.sin(this.frame * 0.21) + (this.frame % 40 < 12 ? EXPOSURE : 0);
    const { data } = this.image;
    let n = (Math.random() * 8192) | 0;
    for (let i = 0, j = 0; j < data.length; j += 4) {
      for (let c = 0; c < 3; c++) data[j + c] = this.wall[i++]! * gain + this.noise[n++ & 8191]!;
    }
    const pose = this.pose(TREMOR_RAD);
    const shutter = this.frame % 3 ? Infinity : HEIGHT * Math.random(); // rows below it were exposed before the change
    for (const [lights, isBefore] of [
      [this.lit, false],
      [this.before, true],
    ] as const) {
      for (const { at, rgb } of lights) {
        const [u, v, ahead] = projected(this.pose(TREMOR_RAD, projected(pose, at)[1] / HEIGHT), at);
        if (v > shutter !== isBefore || ahead < 0.1) continue;
        if (u > -20 && v > -20 && u < WIDTH + 20 && v < HEIGHT + 20) this.splat(u, v, ahead, rgb, gain);
      }
    }
    this.before = this.lit;
    this.context.putImageData(this.image, 0, 0);
    this.timer = setTimeout(() => this.draw(), FRAME_MS);
  }

  /** A light: its core saturates every channel, and its halo grows with its brightness. */
  private splat(u: number, v: number, ahead: number, rgb: readonly number[], gain: number): void {
    const { data } = this.image;
    const power = (POWER * gain) / (ahead * ahead);
    const sigma = 1.1;
    const halo = 4;
    const reach = 12;
    for (let y = Math.max(0, Math.floor(v - reach)); y <= Math.min(HEIGHT - 1, v + reach); y++) {
      for (let x = Math.max(0, Math.floor(u - reach)); x <= Math.min(WIDTH - 1, u + reach); x++) {
        const d2 = (x + 0.5 - u) ** 2 + (y + 0.5 - v) ** 2;
        const spread =
          power * (Math.exp(-d2 / (2 * sigma * sigma)) + 0.03 * Math.exp(-d2 / (2 * halo * halo)));
        for (let c = 0; c < 3; c++) {
          const leak = rgb[c]! + 0.12 * (rgb[(c + 1) % 3]! + rgb[(c + 2) % 3]!);
          data[4 * (y * WIDTH + x) + c]! += spread * leak;
        }
      }
    }
  }
}

/** The LED with its colour, 0 to 1, if it is lit. */
function litOf({ pixel, at }: Led, shown = ""): Lit[] {
  const value = parseInt(shown.slice(6 * pixel, 6 * pixel + 6), 16) || 0;
  return value
    ? [{ at, rgb: [value >> 16, (value >> 8) & 255, value & 255].map((level) => level / 255) }]
    : [];
}
