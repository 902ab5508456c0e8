// Reads MCAP files with @mcap/core, indexed as Foxglove does and as a stream, and prints what it finds as JSON.
import { readFile } from "node:fs/promises";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { decompress } from "fzstd";

const decompressHandlers = { zstd: (buffer, size) => decompress(buffer, new Uint8Array(Number(size))) };

async function indexed(bytes) {
  const readable = {
    size: async () => BigInt(bytes.byteLength),
    read: async (offset, length) => new Uint8Array(bytes.buffer, bytes.byteOffset + Number(offset), Number(length)),
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const counts = {};
  for await (const message of reader.readMessages()) {
    const topic = reader.channelsById.get(message.channelId).topic;
    JSON.parse(new TextDecoder().decode(message.data));
    counts[topic] = (counts[topic] ?? 0) + 1;
  }
  const schemas = [...reader.channelsById.values()].map(({ topic, schemaId }) => [topic, reader.schemasById.get(schemaId)?.name ?? ""]);
  return { counts, schemas: Object.fromEntries(schemas) };
}

function streamed(bytes) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(bytes);
  const counts = {};
  const topics = new Map();
  const metadata = [];
  for (let record = reader.nextRecord(); record; record = reader.nextRecord()) {
    if (record.type === "Channel") topics.set(record.id, record.topic);
    if (record.type === "Metadata") metadata.push(record.name);
    if (record.type === "Message") counts[topics.get(record.channelId)] = (counts[topics.get(record.channelId)] ?? 0) + 1;
  }
  return { counts, metadata, done: reader.done() };
}

const found = {};
for (const path of process.argv.slice(2)) {
  const bytes = await readFile(path);
  found[path] = { indexed: await indexed(bytes), streamed: streamed(bytes) };
}
console.log(JSON.stringify(found));
