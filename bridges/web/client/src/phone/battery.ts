/** The phone's charge, if the browser reports it. */

interface Battery extends EventTarget {
  readonly level: number;
}

/** Call `changed` with the charge, 0 to 1, now and whenever it changes; never if it is not reported. */
export async function watchBattery(changed: (charge: number) => void): Promise<void> {
  const ask = (navigator as { getBattery?: () => Promise<Battery> }).getBattery;
  if (!ask) return;
  try {
    const battery = await ask.call(navigator);
    const tell = () => {
      if (battery.level >= 0 && battery.level <= 1) changed(battery.level);
    };
    battery.addEventListener("levelchange", tell);
    tell();
  } catch {
    // Not allowed here.
  }
}
