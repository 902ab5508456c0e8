"""The only code that opens a port or a socket: serial lines, Modbus, and one object that reconnects both."""
