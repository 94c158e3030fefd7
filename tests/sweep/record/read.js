// Reads MCAP files with @mcap/core and @foxglove/rosmsg2-serialization; prints what is in them as JSON.
const { McapIndexedReader } = require("@mcap/core");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");
const fs = require("fs/promises");

async function main() {
  const result = { counts: {}, states: [], data: {}, inspected: [], images: {} };
  for (const path of process.argv.slice(2)) {
    const file = await fs.open(path);
    const readable = {
      size: async () => BigInt((await file.stat()).size),
      read: async (offset, length) => {
        const buffer = new Uint8Array(Number(length));
        await file.read(buffer, 0, Number(length), Number(offset));
        return buffer;
      },
    };
    const reader = await McapIndexedReader.Initialize({ readable });
    const decoders = new Map();
    for await (const message of reader.readMessages()) {
      const channel = reader.channelsById.get(message.channelId);
      if (!decoders.has(channel.id)) {
        const schema = reader.schemasById.get(channel.schemaId);
        decoders.set(channel.id, new MessageReader(parse(new TextDecoder().decode(schema.data), { ros2: true })));
      }
      const value = decoders.get(channel.id).readMessage(message.data);
      result.counts[channel.topic] = (result.counts[channel.topic] ?? 0) + 1;
      if (channel.topic.endsWith("/plan")) result.states.push(value.state);
      if (channel.topic.endsWith("/bridge_force")) {
        const bytes = Buffer.from(value.data.buffer, value.data.byteOffset, value.data.byteLength);
        result.data[`${value.block},${value.chunk}`] = bytes.toString("hex");
      }
      if (channel.topic.endsWith("/inspect")) {
        const force = value.bridge_force;
        const bytes = Buffer.from(force.buffer, force.byteOffset, force.byteLength);
        result.inspected.push([value.cell, value.name, value.header.frame_id, bytes.toString("hex")]);
      }
      if (value.encoding !== undefined) result.images[channel.topic] = Buffer.from(value.data).toString("hex");
    }
    await file.close();
  }
  console.log(JSON.stringify(result));
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
