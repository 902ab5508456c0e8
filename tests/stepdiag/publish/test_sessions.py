"""What a few bytes of OPC UA may unpack to, before anybody has said who he is."""

import asyncio
import struct

import pytest
from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua import ua_binary

from stepdiag.publish.gate import ASKING, Doors, Gate
from stepdiag.publish.sessions import BoundedServer, bounded


def test_an_array_of_nothing_is_refused_however_long() -> None:
    """The library would make two billion elements of these five bytes."""
    bounded(None, Doors())
    for count in (1, 2**31 - 1):
        with pytest.raises(ua.UaError, match="nothing"):
            ua_binary.variant_from_binary(Buffer(b"\x80" + struct.pack("<i", count)))
    assert ua_binary.variant_from_binary(Buffer(b"\x00")).Value is None, "nothing itself is a value"
    whole = ua.Variant([1, 2, 3], ua.VariantType.Int32)
    assert ua_binary.variant_from_binary(Buffer(ua_binary.variant_to_binary(whole))).Value == [1, 2, 3]


class Nobody:
    """Knows no user."""

    def get_user(self, *_: object, **__: object) -> None:
        return None


class Held(Gate):
    """A connection that only says until when it is held."""

    def __init__(self) -> None:
        self.until = 0.0

    def hold(self, until: float) -> None:
        self.until = until


def test_a_wrong_password_holds_every_connection_of_who_sent_it() -> None:
    """The session was made over another connection, from another address even; the next guess may come over one that is new."""

    async def run() -> None:
        doors, gates = Doors(), [Held() for _ in range(4)]
        maker, guesser, second, later = ("10.0.0.1", 1), ("10.0.0.2", 2), ("10.0.0.2", 3), ("10.0.0.2", 4)
        for peer, gate in zip((maker, guesser, second), gates, strict=False):
            assert doors.admit(peer, gate)
        server = BoundedServer(Nobody(), doors)
        session = server.create_session(maker, external=True)
        ASKING.set(guesser)
        token = ua.UserNameIdentityToken(UserName="mes", Password=b"wrong")
        now = asyncio.get_running_loop().time()
        for _ in range(3):
            with pytest.raises(ua.UaError):
                session.activate_session(ua.ActivateSessionParameters(UserIdentityToken=token), None)
        assert doors.admit(later, gates[3])
        assert gates[0].until == 0
        assert all(gate.until >= now + 1.5 for gate in gates[1:])

    asyncio.run(run())
