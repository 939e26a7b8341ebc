/** The phone's orientation: from the generic sensor where there is one, else from device orientation events. */

import { fromAngles, normalized, type Quaternion } from "./orientation";

interface OrientationSensor extends EventTarget {
  readonly quaternion: readonly number[] | null;
  readonly timestamp: number | null;
  start(): void;
  stop(): void;
}
type SensorClass = new (options: {
  frequency: number;
  referenceFrame: "device" | "screen";
}) => OrientationSensor;
interface Asking {
  requestPermission?: () => Promise<"granted" | "denied" | "default">;
}

export type Source = "sensor" | "event";

export interface Sensing {
  readonly source: Source;
  stop(): void;
}

export interface SensingEvents {
  /** `t`: ms of the page's clock, which only goes forward. */
  turned(q: Quaternion, t: number): void;
  /** The sensor has ended by itself. */
  ended(): void;
}

/** Reason for a missing orientation, and its remedy, for the person. */
export class NoOrientation extends Error {}

const FREQUENCY_HZ = 60;
const PATIENCE_MS = 2500;

const INSECURE =
  "Browsers show a page how the phone moves only over https: scan the QR code again and open the address as it is.";
const NONE =
  "This browser does not report the phone's orientation; try Chrome on Android or Safari on iPhone.";
const SILENT =
  "No movement is heard: this device has no orientation sensor, or its settings keep it from web pages.";
const REFUSED =
  "Motion was refused: allow “Motion & Orientation Access” for this page in the browser's settings, load the page again and tap Start.";

/** Whether orientation can be had here at all; else why not, for the person. */
export function objection(): string {
  if (!isSecureContext) return INSECURE;
  return sensorClass() || "DeviceOrientationEvent" in globalThis ? "" : NONE;
}

/**
 * Begin to sense. To be called from a tap, before anything is awaited: permission may be asked for.
 * @throws NoOrientation
 */
export async function sense(events: SensingEvents): Promise<Sensing> {
  const reason = objection();
  if (reason) throw new NoOrientation(reason);
  const Sensor = sensorClass();
  const sensing = Sensor ? await bySensor(Sensor, events).catch(() => null) : null;
  return sensing ?? byEvent(events);
}

function sensorClass(): SensorClass | null {
  return (globalThis as { RelativeOrientationSensor?: SensorClass }).RelativeOrientationSensor ?? null;
}

/** In the device's frame, so that it does not matter how the screen is rotated. */
function bySensor(Sensor: SensorClass, events: SensingEvents): Promise<Sensing> {
  const sensor = new Sensor({ frequency: FREQUENCY_HZ, referenceFrame: "device" });
  return new Promise((resolve, reject) => {
    let isActive = false;
    const patience = setTimeout(() => fail(), PATIENCE_MS);
    const fail = () => {
      clearTimeout(patience);
      sensor.stop();
      if (isActive) events.ended();
      else reject(new NoOrientation(SILENT));
    };
    sensor.addEventListener("error", fail);
    sensor.addEventListener("reading", () => {
      const q = normalized(sensor.quaternion);
      if (!q) return;
      if (!isActive) {
        isActive = true;
        clearTimeout(patience);
        resolve({
          source: "sensor",
          stop: () => {
            sensor.removeEventListener("error", fail);
            sensor.stop();
          },
        });
      }
      events.turned(q, sensor.timestamp ?? performance.now());
    });
    sensor.start();
  });
}

async function byEvent(events: SensingEvents): Promise<Sensing> {
  if (!("DeviceOrientationEvent" in globalThis)) throw new NoOrientation(SILENT);
  const asking = DeviceOrientationEvent as Asking;
  if (asking.requestPermission) {
    const answer = await asking.requestPermission().catch(() => "denied");
    if (answer !== "granted") throw new NoOrientation(REFUSED);
  }
  return new Promise((resolve, reject) => {
    let isActive = false;
    const stop = () => removeEventListener("deviceorientation", hear);
    const patience = setTimeout(() => {
      stop();
      reject(new NoOrientation(SILENT));
    }, PATIENCE_MS);
    const hear = (event: DeviceOrientationEvent) => {
      const { alpha, beta, gamma } = event;
      if (alpha === null || beta === null || gamma === null) return;
      const q = normalized(fromAngles(alpha, beta, gamma));
      if (!q) return;
      if (!isActive) {
        isActive = true;
        clearTimeout(patience);
        resolve({ source: "event", stop });
      }
      events.turned(q, event.timeStamp);
    };
    addEventListener("deviceorientation", hear);
  });
}
