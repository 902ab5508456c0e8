"""A TCP port for this process alone."""

import socket


def reserved_port() -> int:
    """Return a loopback port that belongs to this process until its end, with or without a
    listener.

    A socket of this process is bound to the port and never listens. The kernel then gives the port
    to no other request for any port, be it for a server or for the near end of a connection; the
    listener uses SO_REUSEADDR, as servers do (socket(7)). A port that was merely found free is the
    near end of a connection a second later on a busy computer.
    """
    held = socket.socket()
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    held.bind(("127.0.0.1", 0))
    port = int(held.getsockname()[1])
    held.detach()  # open for as long as the process is
    return port
