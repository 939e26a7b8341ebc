/** The dialog that makes a phone a person's wrist, or lets it map the room: QR code, steps, fingerprint. */

import type { Reply } from "../site/asks";
import type { Controls } from "../controls";
import { el, enable, icon, isEnabled, sheet, show, write } from "../dom";
import { capital } from "../format";

export interface Pairing {
  open(): void;
  update(): void;
}

/** State of a pairing whose code no phone has used yet, as the server has it. */
const WAITING = "waiting for the phone";

/** Groups of a certificate's fingerprint, as phones show them. */
export function fingerprintLines(fingerprint: string): string {
  const hex = fingerprint.replaceAll(/[^0-9a-f]/gi, "").toUpperCase();
  return (hex.match(/.{2}/g) ?? []).join(" ");
}

/** The drawing in `markup`, or null if it is none; scripts in it would not run. */
function drawing(markup: string): Element | null {
  const root = new DOMParser().parseFromString(markup, "image/svg+xml").documentElement;
  if (root.localName !== "svg") return null;
  const [width, height] = ["width", "height"].map((name) => root.getAttribute(name) ?? "");
  if (width && height && !root.hasAttribute("viewBox"))
    root.setAttribute("viewBox", `0 0 ${parseFloat(width)} ${parseFloat(height)}`);
  for (const name of ["width", "height"]) root.removeAttribute(name);
  return root;
}

/** `deed`: `pair` for a wrist, `map_room` for a camera that maps the room. */
export function pairingDialog(controls: Controls, deed: "pair" | "map_room" = "pair"): Pairing {
  const isWrist = deed === "pair";
  const code = el("div", {
    className: "qr",
    role: "img",
    "aria-label": "QR code that opens the phone's page",
  });
  const link = el("a", { target: "_blank", rel: "noreferrer" });
  const print = el("code", {});
  const offer = el(
    "div",
    { className: "offer", hidden: true },
    code,
    el(
      "ol",
      {},
      el("li", { text: "Join the same Wi-Fi with your phone and scan the code." }),
      el("li", {
        text: "The phone warns once that it does not know this page: go on. To be sure, compare the fingerprint.",
      }),
      el("li", {
        text: isWrist
          ? "Allow the motion sensors, hold the phone like a remote control, and point."
          : "Allow the camera, and follow the phone's page from view to view.",
      }),
    ),
    el(
      "details",
      {},
      el("summary", {}, "Address and fingerprint", icon("chevron")),
      el("p", {}, link),
      el("p", {}, print),
    ),
  );
  const openLan = el(
    "button",
    { className: "primary", type: "button", onclick: () => void lan() },
    icon("wifi"),
    el("span", { text: "Open to the local network" }),
  );
  const closed = el(
    "div",
    { hidden: true },
    el("p", {
      text: "A phone reaches this page over the local network, encrypted. So far, the page is open to this computer only.",
    }),
    openLan,
  );
  const wait = el("p", { role: "status" });
  const title = el("h2", { text: isWrist ? "Point with your phone" : "Map this room with a phone" });
  const dialog = sheet(title, closed, wait, offer);
  dialog.addEventListener("close", () => void forget());
  let user = "";
  let hadPhone = false;
  let isAsking = false;
  let offeredTo = "";

  async function lan(): Promise<void> {
    enable(openLan, false);
    const reply = await controls.ask({ deed: "open_lan" }, 15_000);
    enable(openLan, true);
    if (reply) await pair();
  }

  async function pair(): Promise<void> {
    if (isAsking) return;
    isAsking = true;
    show(closed, false);
    write(wait, "One moment …");
    const reply = await controls.ask({ deed, name: isWrist ? user : "" }, 15_000);
    isAsking = false;
    write(wait, "");
    if (reply) present(reply);
    else dialog.close();
  }

  /** Withdraw the code that no phone has used: it is not to be seen again. A phone that was paired before stays known. */
  async function forget(): Promise<void> {
    const unused =
      offeredTo && !hadPhone && controls.site.people.get(offeredTo)?.line?.phone === WAITING ? offeredTo : "";
    offeredTo = "";
    if (isWrist && unused) await controls.ask({ deed, name: unused, query: { off: true } });
    controls.changed();
  }

  function present(reply: Reply): void {
    const svg = drawing(String(reply["qr_svg"] ?? ""));
    code.replaceChildren(...(svg ? [svg] : []));
    const url = String(reply["url"] ?? "");
    link.href = url;
    write(link, url.replace(/[?#].*/, " …"));
    write(print, fingerprintLines(String(reply["fingerprint"] ?? "")));
    offeredTo = user;
    show(offer, true);
  }

  return {
    open() {
      user = controls.user;
      hadPhone = ![undefined, "", WAITING].includes(controls.person?.line?.phone);
      if (isWrist)
        write(
          title,
          controls.site.people.size > 1 ? `Point as ${user} with your phone` : "Point with your phone",
        );
      show(offer, false);
      offeredTo = "";
      const isClosed = !controls.site.status?.lan_url;
      show(closed, isClosed);
      show(openLan, controls.mayDo("open_lan"));
      write(wait, isClosed && !controls.mayDo("open_lan") ? "Start PointIt with --lan to allow it." : "");
      if (!dialog.open) dialog.showModal();
      if (isClosed) openLan.focus();
      if (!isClosed) void pair();
    },
    update() {
      // what `open` read may have been from before the first status, and another page may open it
      if (dialog.open && !closed.hidden && isEnabled(openLan) && controls.site.status?.lan_url) void pair();
      if (!dialog.open || !offeredTo) return;
      const line = controls.site.people.get(offeredTo)?.line;
      if (line?.phone && line.moved_by === "phone") {
        dialog.close(); // the phone is in use: its code stays valid
        controls.toasts.show("done", `The phone points as ${offeredTo} now.`);
      } else if (line?.phone) write(wait, `${capital(line.phone)}.`);
    },
  };
}
