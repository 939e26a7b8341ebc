// A dashboard of one's own: open index.html beside `pointit service run foxglove`. Its channels carry every topic as JSON,
// described by the JSON Schema of its message in schemas/catalogue/shipped. For a bridge elsewhere: index.html?at=ws://HOST:PORT
const address = new URLSearchParams(location.search).get("at") ?? "ws://127.0.0.1:8765";
const $ = (id) => document.getElementById(id);
const line = (parent, id, tag) => $(id) ?? $(parent).appendChild(Object.assign(document.createElement(tag), { id }));

const draw = { // how a message is drawn, by its name in the catalogue; `about` is the description of the message there
  StripsFrame({ strips }) {
    for (const { id, rgb } of strips) {
      const bytes = Uint8Array.from(atob(rgb), (each) => each.charCodeAt(0));
      const rgba = new Uint8ClampedArray((bytes.length / 3) * 4).fill(255);
      bytes.forEach((value, i) => (rgba[i + Math.floor(i / 3)] = value));
      const canvas = Object.assign(line("strips", `strip ${id}`, "canvas"), { width: bytes.length / 3, height: 1 });
      canvas.getContext("2d").putImageData(new ImageData(rgba, canvas.width), 0, 0);
    }
  },
  Hover({ object_id, progress, action }, user, about) {
    const gauge = "▰".repeat(10 * progress).padEnd(10, "▱");
    const row = line("people", `person ${user}`, "pre");
    Object.assign(row, { title: about, textContent: `${user.padEnd(8)} ${gauge} ${action} ${object_id}` });
  },
  Selection: ({ objects }) =>
    ($("selected").textContent = objects
      .filter(({ is_pending }) => !is_pending)
      .map(({ id, kind, user }) => `${user}: ${kind} ${id}`)
      .join("\n")),
};

(function connect() {
  const channels = new Map(); // by id, which is also the id of its subscription
  const socket = Object.assign(new WebSocket(address, "foxglove.sdk.v1"), { binaryType: "arraybuffer" });
  socket.onclose = () => setTimeout(connect, 1000, ($("state").textContent = `nobody answers at ${address}`));
  socket.onmessage = ({ data }) => {
    if (data instanceof ArrayBuffer) { // 1 byte: kind; 4: id of the subscription; 8: time, ns; then the message
      const { kind, user, about } = channels.get(new DataView(data).getUint32(1, true));
      return draw[kind](JSON.parse(new TextDecoder().decode(data.slice(13))), user, about);
    }
    const { op, name, channels: offered = [] } = JSON.parse(data);
    if (op === "serverInfo") $("state").textContent = name;
    for (const { id, topic, schemaName, schema } of offered) {
      const kind = schemaName.split(".")[0]; // without the version
      if (!(kind in draw)) continue;
      channels.set(id, { kind, user: topic.split("/")[2], about: JSON.parse(schema).description });
      socket.send(JSON.stringify({ op: "subscribe", subscriptions: [{ id, channelId: id }] }));
    }
  };
})();
