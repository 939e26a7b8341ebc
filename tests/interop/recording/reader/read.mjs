// Reads a recording with the library of Foxglove and Lichtblick, and prints what is in it as JSON: by its index, or
// from its beginning as far as it goes (--stream).
import { readFile } from "node:fs/promises";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import zstd from "@foxglove/wasm-zstd";

await zstd.isLoaded;
const decompressHandlers = { zstd: (data, size) => zstd.decompress(data, Number(size)) };
const [path, mode] = process.argv.slice(2);
const bytes = new Uint8Array(await readFile(path));
const found = { counts: {}, schemas: {}, heads: 0 };
const channels = new Map();
const schemas = new Map();

function take(record) {
  if (record.type === "Metadata") found.heads += record.name === "pointit" ? 1 : 0;
  if (record.type === "Schema") schemas.set(record.id, record);
  if (record.type === "Channel") channels.set(record.id, record);
  if (record.type !== "Message") return;
  const channel = channels.get(record.channelId);
  const schema = schemas.get(channel.schemaId);
  const fields = JSON.parse(Buffer.from(schema.data)).properties;
  const message = JSON.parse(Buffer.from(record.data));
  for (const name of Object.keys(fields)) if (!(name in message)) throw new Error(`${channel.topic}: no ${name}`);
  const key = channel.metadata.get("key");
  found.counts[key] = (found.counts[key] ?? 0) + 1;
  found.schemas[key] = schema.name;
}

if (mode === "--stream") {
  const reader = new McapStreamReader({ decompressHandlers });
  reader.append(bytes);
  for (let record = reader.nextRecord(); record; record = reader.nextRecord()) take(record);
} else {
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, length) => bytes.slice(Number(offset), Number(offset + length)),
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  for (const each of reader.schemasById.values()) take({ ...each, type: "Schema" });
  for (const each of reader.channelsById.values()) take({ ...each, type: "Channel" });
  for await (const each of reader.readMetadata()) take({ ...each, type: "Metadata" });
  for await (const each of reader.readMessages()) take({ ...each, type: "Message" });
}
console.log(JSON.stringify(found));
