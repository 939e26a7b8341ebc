/** Finds lights in frames, off the page's thread. Pictures end here: only centres of spots go back. */

import { blobsOf, thresholdOf, type Blob, type Pixels } from "./blobs";

export interface Work {
  frame: ImageBitmap;
  /** `dark`: the lights are off now, keep it to compare with. */
  as: "dark" | "lit";
}

export interface Found {
  blobs: Blob[] | null;
  width: number;
  height: number;
}

let canvas: OffscreenCanvas | null = null;
let dark: Pixels | null = null;
let threshold = 255;

function pixelsOf(frame: ImageBitmap): Pixels {
  if (canvas?.width !== frame.width || canvas.height !== frame.height) {
    canvas = new OffscreenCanvas(frame.width, frame.height);
    dark = null;
  }
  const context = canvas.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(frame, 0, 0);
  return context.getImageData(0, 0, frame.width, frame.height).data;
}

addEventListener("message", ({ data }: MessageEvent<Work>) => {
  const { width, height } = data.frame;
  const pixels = pixelsOf(data.frame);
  data.frame.close();
  let blobs: Blob[] | null = [];
  if (data.as === "dark") {
    threshold = dark ? thresholdOf(dark, pixels) : 255;
    dark = pixels;
  } else if (dark) {
    blobs = blobsOf(pixels, dark, width, height, threshold);
  }
  postMessage({ blobs, width, height } satisfies Found);
});
