"""A TCP port that is reserved for this process."""

import socket


def reserved_port() -> int:
    """Return a loopback port that belongs to this process until its end, with or without a
    listener.

    A socket of this process is bound to the port and never listens. The kernel then assigns the
    port to no other server or connection; the listener uses SO_REUSEADDR (socket(7)). Without a
    reservation, another connection can take a free port within a second.
    """
    held = socket.socket()
    held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    held.bind(("127.0.0.1", 0))
    port = int(held.getsockname()[1])
    held.detach()  # open as long as the process runs
    return port
