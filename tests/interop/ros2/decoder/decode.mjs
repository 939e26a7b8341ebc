// Reads lines of JSON {type, definition, cdr} and answers each with the value that an independent decoder reads.
import { createInterface } from "node:readline";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

const readers = new Map();

function plain(_name, value) {
  if (typeof value === "bigint") return { big: value.toString() };
  return ArrayBuffer.isView(value) ? Array.from(value) : value;
}

for await (const line of createInterface({ input: process.stdin })) {
  const { type, definition, cdr } = JSON.parse(line);
  let answer;
  try {
    if (!readers.has(type)) readers.set(type, new MessageReader(parse(definition, { ros2: true })));
    answer = { value: readers.get(type).readMessage(Buffer.from(cdr, "base64")) };
  } catch (error) {
    answer = { error: String(error) };
  }
  process.stdout.write(JSON.stringify(answer, plain) + "\n");
}
