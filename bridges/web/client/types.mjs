// Writes src/messages.ts (the bus's messages, from the catalogue), src/topics.ts (which of them are where, from the
// same) and src/wire.ts (server and page, from wire.json).
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { compile } from "json-schema-to-typescript";

const here = dirname(fileURLToPath(import.meta.url));
const catalogue = join(here, "../../../schemas/catalogue/shipped");
const messages = join(catalogue, "messages");

/** Newest version of every message, by name. */
function newest() {
  const found = new Map();
  for (const file of readdirSync(messages).sort()) {
    const [, name, version] = /^(\w+)\.v(\d+)\.json$/.exec(file);
    if (!found.has(name) || found.get(name).version < Number(version))
      found.set(name, { version: Number(version), file });
  }
  return [...found]
    .sort(([a], [b]) => (a < b ? -1 : 1))
    .map(([name, { file }]) => [name, JSON.parse(readFileSync(join(messages, file)))]);
}

/** The schema as the compiler wants it: tuples as `items`, bytes as Uint8Array, every field there, no inner titles. */
function adapted(node, isRoot) {
  if (Array.isArray(node)) return node.map((each) => adapted(each, false));
  if (node === null || typeof node !== "object") return node;
  const result = {};
  for (const [key, value] of Object.entries(node)) {
    if (
      ["$id", "$schema", "$defs", "default", "x-norm", "discriminator"].includes(key) ||
      (key === "title" && !isRoot && typeof value === "string")
    )
      continue;
    if (key === "prefixItems") result.items = adapted(value, false);
    else if (key === "$ref") result.$ref = value;
    else if (key === "properties")
      result.properties = Object.fromEntries(
        Object.entries(value).map(([name, field]) => [name, adapted(field, false)]),
      );
    else result[key] = adapted(value, false);
  }
  if (node.prefixItems)
    Object.assign(result, { minItems: node.prefixItems.length, maxItems: node.prefixItems.length });
  else if (result.type === "array") for (const key of ["minItems", "maxItems"]) delete result[key];
  if (node.format === "binary" || node.contentEncoding)
    return { tsType: "Uint8Array", description: node.description };
  if (node.type === "object" && node.properties)
    Object.assign(result, { required: Object.keys(node.properties), additionalProperties: false });
  return result;
}

async function write(file, about, schemas) {
  const $defs = {};
  for (const [name, schema] of schemas) {
    for (const [inner, part] of Object.entries(schema.$defs ?? {})) $defs[inner] = adapted(part, true);
    if (name) $defs[name] = adapted(schema, true);
  }
  const text = await compile(
    {
      $defs,
      title: "Everything",
      type: "object",
      additionalProperties: false,
      required: Object.keys($defs),
      properties: Object.fromEntries(Object.keys($defs).map((name) => [name, { $ref: `#/$defs/${name}` }])),
    },
    "Everything",
    { bannerComment: `// ${about} Written by \`npm run types\`; do not edit.`, format: true, maxItems: 20 },
  );
  writeFileSync(join(here, "src", file), text);
}

/** The tables of topics and requests: their key patterns, with message or server. */
function tables() {
  const { channels } = JSON.parse(readFileSync(join(catalogue, "asyncapi.json")));
  const rows = Object.values(channels).sort((a, b) => (a.address < b.address ? -1 : 1));
  const topics = rows
    .filter((row) => row["x-delivery"] !== "request")
    .map((row) => [row.address, Object.keys(row.messages)[0]]);
  const requests = rows
    .filter((row) => row["x-delivery"] === "request")
    .map((row) => [row.address, row["x-server"]]);
  return `// Rows of the bus's tables, from schemas/catalogue/shipped. Written by \`npm run types\`; do not edit.

import type {
  ${[...new Set(topics.map(([, message]) => message))].sort().join(", ")},
} from "./messages";

/** The message of every topic, by the key's pattern. */
export interface Topics {
${topics.map(([key, message]) => `  ${JSON.stringify(key)}: ${message};`).join("\n")}
}

/** The service that answers each request, by the key's pattern. */
export const SERVERS = {
${requests.map(([key, server]) => `  ${JSON.stringify(key)}: ${JSON.stringify(server)},`).join("\n")}
} as const;

export type RequestKey = keyof typeof SERVERS;
`;
}

writeFileSync(join(here, "src/topics.ts"), tables());
await write("messages.ts", "The bus's messages, from schemas/catalogue/shipped.", newest());
await write("wire.ts", "What travels between server and page, from wire.json.", [
  ["", JSON.parse(readFileSync(join(here, "wire.json")))],
]);
