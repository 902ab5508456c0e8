"""What goes wrong on Modbus, in words for the person at the machine.

DeviceError
├── LostConnectionError    nobody there, or the connection ended
├── SilentDeviceError      connected, no answer in time
├── StaleAnswerError       the answer to an earlier request, late
└── RefusedRequestError    an exception reply
    └── WrongUnitError     the gateway knows no such unit
"""

from stepdiag.base.errors import DeviceError


class LostConnectionError(DeviceError):
    """Nobody is there, or the connection ended."""


class SilentDeviceError(DeviceError):
    """Connected, but no answer came in time."""


class StaleAnswerError(DeviceError):
    """An answer came that belongs to an earlier request."""


class RefusedRequestError(DeviceError):
    """The device answered with an exception."""


class WrongUnitError(RefusedRequestError):
    """The gateway reaches no device of that unit id."""


# Modbus Application Protocol V1.1b3, section 7: the codes and what they mean.
_REFUSALS = {
    1: ("illegal function", "the control does not serve this table: map the signal to another one (many serve holding registers only)"),
    2: (
        "illegal data address",
        "the register map of the survey does not fit the control: check table, address and whether it counts from 0",
    ),
    3: ("illegal data value", "the control does not serve so many registers at once: check the addresses of the signals"),
    4: ("device failure", "check the unit id (plc.unit) and the control's Modbus program"),
    6: ("device busy", "lower plc.poll_hz"),
}
_GATEWAY_CODES = {10: "gateway path unavailable", 11: "the target behind the gateway does not respond"}


def refusal(device: str, what: str, code: int) -> RefusedRequestError:
    """Return the error for exception reply ``code`` to ``what`` (``reading 10 of table holding from 0``)."""
    if code in _GATEWAY_CODES:
        found = f"exception {code} ({_GATEWAY_CODES[code]})"
        return WrongUnitError(device, expected=f"an answer to {what}", found=found, remedy="check the unit id (plc.unit)")
    name, remedy = _REFUSALS.get(code, ("of no standard meaning", "see the manual of the control"))
    return RefusedRequestError(device, expected=f"an answer to {what}", found=f"exception {code} ({name})", remedy=remedy)


def silence(device: str, timeout_s: float, *, serial: bool, late: str = "") -> SilentDeviceError:
    """Return the error for an answer that did not come; ``late`` says that answers do come, after that time."""
    if late:
        return SilentDeviceError(device, expected=f"an answer within {timeout_s:g} s", found="none yet", remedy=late)
    check = "baud rate, parity, wiring and unit id" if serial else "that the control's Modbus program runs, and the unit id"
    return SilentDeviceError(device, expected=f"an answer within {timeout_s:g} s", found="silence", remedy=f"check {check} (plc.unit)")


def unreachable(device: str, timeout_s: float) -> LostConnectionError:
    """Return the error for a connection that could not be made."""
    remedy = "check that the device is on, its cable, and its address in the survey ([plc])"
    return LostConnectionError(device, expected=f"a connection within {timeout_s:g} s", found="nobody there", remedy=remedy)


def unusable(device: str, why: str) -> LostConnectionError:
    """Return the error for a port that is there but does not take the line's settings (baud rate, parity)."""
    remedy = "check baud rate and parity in the survey ([plc]) against what the port can do"
    return LostConnectionError(device, expected="a port that takes these settings", found=why, remedy=remedy)


def lost(device: str) -> LostConnectionError:
    """Return the error for a connection that ended."""
    return LostConnectionError(device, expected="a lasting connection", found="it ended", remedy="the program reconnects by itself")


def stale(device: str, late: str = "") -> StaleAnswerError:
    """Return the error for an answer that belongs to another request; ``late`` says by how much answers are late."""
    remedy = late or "the device answers later than plc.timeout_s: raise it, or lower the load of the device"
    return StaleAnswerError(device, expected="the answer to this request", found="the answer to an earlier one", remedy=remedy)
