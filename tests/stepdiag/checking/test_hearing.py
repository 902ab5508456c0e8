"""The ports that `stepdiag setup` lists: by the name that stays, with what their adapter calls
itself."""

from serial.tools import list_ports, list_ports_common

from stepdiag.checking.hearing import PortSeen, ports
from stepdiag.daq.links.ports import tty


def test_ports_are_listed_by_the_name_that_stays_with_the_words_of_their_adapter(
    tmp_path, monkeypatch
):
    """As udev and sysfs would have them: two adapters, one of them with a link by its number, and a
    port of the board without a word."""
    devices, by_id = tmp_path / "dev", tmp_path / "by-id"
    devices.mkdir()
    by_id.mkdir()
    found = []
    for name, words in (
        ("ttyUSB0", "uMD board - FT232R"),
        ("ttyUSB1", "USB-Serial Controller"),
        ("ttyS0", "n/a"),
    ):
        (devices / name).touch()
        port = list_ports_common.ListPortInfo(str(devices / name))
        port.description = words
        found.append(port)
    (by_id / "usb-FTDI_FT232R_A700-if00-port0").symlink_to(devices / "ttyUSB0")
    monkeypatch.setattr(list_ports, "comports", lambda: found)
    monkeypatch.setattr(tty, "BY_ID", by_id)
    assert ports() == [
        PortSeen(str(by_id / "usb-FTDI_FT232R_A700-if00-port0"), "uMD board - FT232R"),
        PortSeen(str(devices / "ttyUSB1"), "USB-Serial Controller"),
        PortSeen(str(devices / "ttyS0"), str(devices / "ttyS0")),
    ]
