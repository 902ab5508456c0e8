"""A port that nobody else gets: what a test hands to a process is still free when the process comes
to listen on it."""

import socket

import pytest

from stepdiag.virtual.base.reserved import reserved_port


def test_nobody_listens_there_and_nobody_else_gets_it():
    port = reserved_port()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=5.0)
    with socket.socket() as other, pytest.raises(OSError, match="in use"):
        other.bind(("127.0.0.1", port))


def test_a_server_listens_on_it_and_again_after_it_was_stopped():
    port = reserved_port()
    for _ in range(3):
        with (
            socket.create_server(("127.0.0.1", port)) as server,
            socket.create_connection(("127.0.0.1", port)),
        ):
            guest, _ = server.accept()
            guest.close()


def test_each_is_another():
    assert len({reserved_port() for _ in range(20)}) == 20
