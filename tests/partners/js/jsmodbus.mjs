// A control made of jsmodbus: `node jsmodbus.mjs PORT`. Registers 0 to 13 hold 1000 + address; what is written is printed.
import net from "node:net";
import jsmodbus from "jsmodbus";

const socket = new net.Server();
const holding = Buffer.alloc(256);
for (let at = 0; at < 14; at += 1) holding.writeUInt16BE(1000 + at, 2 * at);
const server = new jsmodbus.server.TCP(socket, { holding });
server.on("postWriteMultipleRegisters", () => console.log(`100=${holding.readUInt16BE(200)}`));
socket.listen(Number(process.argv[2]), "127.0.0.1", () => console.log("ready"));
