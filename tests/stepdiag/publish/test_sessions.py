"""What a few bytes of OPC UA may unpack to, before anybody has said who he is."""

import struct

import pytest
from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua import ua_binary

from stepdiag.publish.gate import Doors
from stepdiag.publish.sessions import bounded


def test_an_array_of_nothing_is_refused_however_long() -> None:
    """The library would make two billion elements of these five bytes."""
    bounded(None, Doors())
    for count in (1, 2**31 - 1):
        with pytest.raises(ua.UaError, match="nothing"):
            ua_binary.variant_from_binary(Buffer(b"\x80" + struct.pack("<i", count)))
    assert ua_binary.variant_from_binary(Buffer(b"\x00")).Value is None, "nothing itself is a value"
    whole = ua.Variant([1, 2, 3], ua.VariantType.Int32)
    assert ua_binary.variant_from_binary(Buffer(ua_binary.variant_to_binary(whole))).Value == [1, 2, 3]
