// A control made of modbus-serial: `node modbus-serial.mjs PORT`. Registers 0 to 13 hold 1000 + address; what is written is printed.
import ModbusRTU from "modbus-serial";

const vector = {
  getHoldingRegister: (address) => (address < 14 ? 1000 + address : 0),
  setRegister: (address, value) => console.log(`${address}=${value}`),
};
const server = new ModbusRTU.ServerTCP(vector, { host: "127.0.0.1", port: Number(process.argv[2]), unitID: 1 });
server.on("initialized", () => console.log("ready"));
