/** The camera and the worker that sees its frames. */

import type { Found, Work } from "./worker";

/** Reason why there is no picture, and its remedy, for the person. */
export class NoCamera extends Error {}

const INSECURE =
  "Browsers give a page the camera only over https: scan the QR code again and open the address as it is.";
const NONE = "No camera was found: connect one, or open this page on the phone.";
const REFUSED =
  "The camera was refused: allow it for this page in the browser's settings, and load the page again.";
const BUSY = "The camera cannot be opened: another program uses it; close that and try again.";

/** Width of a frame, image pixels, if the camera can; small lights need as many as there are. */
const WIDTH = 1280;
/** Width of a still, image pixels: a finger taps no better. */
const STILL_WIDTH = 640;

export class Camera {
  private waiting: ((found: Found) => void) | null = null;

  private constructor(
    readonly video: HTMLVideoElement,
    private readonly stream: MediaStream,
    private readonly worker: Worker,
  ) {
    worker.addEventListener("message", ({ data }: MessageEvent<Found>) => {
      this.waiting?.(data);
      this.waiting = null;
    });
  }

  /**
   * Open the camera that looks away from the person, or `stream`, and show it in `video`.
   * @throws NoCamera
   */
  static async open(video: HTMLVideoElement, stream: MediaStream | null): Promise<Camera> {
    const opened = stream ?? (await ownStream());
    video.srcObject = opened;
    await video.play();
    return new Camera(video, opened, new Worker("/static/scan-worker.js", { type: "module" }));
  }

  /** True if the camera looks away from the person, as that of a phone, whose sensors tell how it is held. */
  get looksAhead(): boolean {
    return this.stream.getVideoTracks()[0]?.getSettings().facingMode === "environment";
  }

  /** True while frames come: the browser ends the camera of a page that is out of sight. */
  get isLive(): boolean {
    return this.stream.getVideoTracks().some(({ readyState }) => readyState === "live");
  }

  /** Keep exposure, white balance and focus as they are, where the camera lets a page. */
  async hold(): Promise<void> {
    const track = this.stream.getVideoTracks()[0];
    const modes = (track?.getCapabilities?.() ?? {}) as Record<string, readonly string[] | undefined>;
    const held = ["exposureMode", "whiteBalanceMode", "focusMode"].filter((name) =>
      modes[name]?.includes("manual"),
    );
    await track
      ?.applyConstraints({ advanced: [Object.fromEntries(held.map((name) => [name, "manual"]))] })
      .catch(() => undefined);
  }

  /** Look at the next frame. */
  async look(as: Work["as"]): Promise<Found> {
    await nextFrame(this.video);
    const frame = await createImageBitmap(this.video);
    return new Promise((resolve) => {
      this.waiting = resolve;
      this.worker.postMessage({ frame, as } satisfies Work, [frame]);
    });
  }

  /** What the camera shows now, `STILL_WIDTH` wide: a phone has no memory for whole pictures of many views. */
  still(): Promise<ImageBitmap> {
    return createImageBitmap(this.video, { resizeWidth: STILL_WIDTH, resizeQuality: "medium" });
  }
}

async function ownStream(): Promise<MediaStream> {
  if (!isSecureContext) throw new NoCamera(INSECURE);
  if (!navigator.mediaDevices) throw new NoCamera(NONE);
  const video = {
    facingMode: { ideal: "environment" },
    width: { ideal: WIDTH },
    height: { ideal: (WIDTH * 9) / 16 },
    frameRate: { ideal: 30 },
  };
  try {
    return await navigator.mediaDevices.getUserMedia({ video, audio: false });
  } catch (error) {
    const name = error instanceof DOMException ? error.name : "";
    if (name === "NotAllowedError" || name === "SecurityError") throw new NoCamera(REFUSED);
    throw new NoCamera(name === "NotReadableError" || name === "AbortError" ? BUSY : NONE);
  }
}

/** Wait for a frame that was not seen yet. */
function nextFrame(video: HTMLVideoElement): Promise<void> {
  return new Promise((resolve) => {
    const patience = setTimeout(resolve, 500);
    const done = () => {
      clearTimeout(patience);
      resolve();
    };
    if ("requestVideoFrameCallback" in video) video.requestVideoFrameCallback(done);
    else setTimeout(done, 40);
  });
}
