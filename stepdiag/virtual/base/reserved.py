"""A TCP port that nobody else gets."""

import socket


def reserved_port() -> int:
    """Return a loopback port that belongs to this process until it ends, whether or not somebody listens on it.

    A socket of this process is bound to it and never listens. The kernel then gives the port to nobody who asks for any port, be it for
    a server or for the near end of a connection; who gets the number listens on it with SO_REUSEADDR, as servers do (socket(7)).
    A port that was merely found free is the near end of somebody's connection a second later on a busy computer.
    """
    held = socket.socket()
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    held.bind(("127.0.0.1", 0))
    port = int(held.getsockname()[1])
    held.detach()  # open for as long as the process is
    return port
