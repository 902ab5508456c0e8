"""A control made of snap7's C library: `python snap7_server.py PORT`. DB1 holds 10, 11 .. 23; what
is written to its word 20 is printed."""

import ctypes
import sys
import time

from snap7.server import Server
from snap7.types import srvAreaDB

memory = (ctypes.c_uint8 * 64)(*range(10, 24))
server = Server(log=False)
server.register_area(srvAreaDB, 1, memory)
server.start(tcpport=int(sys.argv[1]))
print("ready", flush=True)
seen = 0
while True:
    word = memory[20] << 8 | memory[21]
    if word != seen:
        seen = word
        print(f"20={word}", flush=True)
    time.sleep(0.01)
