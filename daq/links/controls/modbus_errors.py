"""Failures of Modbus, with messages for the operator."""

from stepdiag.base.errors import DeviceError
from stepdiag.base.messages import Message, Words, message


class LostConnectionError(DeviceError):
    """No device answers, or the connection ended."""


class SilentDeviceError(DeviceError):
    """The device is connected, but sent no answer in time."""


class StaleAnswerError(DeviceError):
    """The answer belongs to an earlier request."""


class RefusedRequestError(DeviceError):
    """The device answered with a Modbus exception."""


class WrongUnitError(RefusedRequestError):
    """The gateway has no device with the unit id of the request."""


# Exception codes and their meaning (Modbus Application Protocol V1.1b3, section 7).
_REFUSALS = {
    1: (message("mb-function"), message("do-other-table")),
    2: (message("mb-address"), message("do-register-map")),
    3: (message("mb-value"), message("do-fewer-registers")),
    4: (message("mb-device"), message("do-unit-program")),
    6: (message("mb-busy"), message("do-lower-poll")),
}
_GATEWAY_CODES = {10: message("mb-gateway-path"), 11: message("mb-gateway-target")}


def refusal(device: str, what: Message, code: int) -> RefusedRequestError:
    """Return the error for the exception reply ``code`` to the request ``what`` (``reading 10 of
    table holding from 0``).
    """
    if code in _GATEWAY_CODES:
        found = message("modbus-exception", code=code, what=_GATEWAY_CODES[code])
        return WrongUnitError(
            device,
            expected=message("expects-answer-to", what=what),
            found=found,
            remedy=message("do-unit"),
        )
    name, remedy = _REFUSALS.get(code, (message("mb-unknown"), message("do-manual")))
    return RefusedRequestError(
        device,
        expected=message("expects-answer-to", what=what),
        found=message("modbus-exception", code=code, what=name),
        remedy=remedy,
    )


def silence(
    device: str, timeout_s: float, *, serial: bool, late: Words = ""
) -> SilentDeviceError:
    """Return the error for a missing answer; ``late`` is the remedy for answers later than
    ``timeout_s``.
    """
    if late:
        return SilentDeviceError(
            device,
            expected=message("expects-answer", seconds_s=timeout_s),
            found=message("none-yet"),
            remedy=late,
        )
    check = message("do-serial-unit") if serial else message("do-program-runs")
    return SilentDeviceError(
        device,
        expected=message("expects-answer", seconds_s=timeout_s),
        found=message("silence"),
        remedy=check,
    )


def unreachable(device: str, timeout_s: float) -> LostConnectionError:
    remedy = message("do-device-on")
    return LostConnectionError(
        device,
        expected=message("expects-connection-s", seconds_s=timeout_s),
        found=message("nobody-there"),
        remedy=remedy,
    )


def unusable(device: str, why: Words) -> LostConnectionError:
    remedy = message("do-baud-parity")
    return LostConnectionError(
        device, expected=message("expects-port-settings"), found=why, remedy=remedy
    )


def lost(device: str) -> LostConnectionError:
    return LostConnectionError(
        device,
        expected=message("expects-lasting"),
        found=message("found-ended"),
        remedy=message("do-itself"),
    )


def stale(device: str, late: Words = "") -> StaleAnswerError:
    """Return the error for an answer to another request; ``late`` is the remedy for late
    answers.
    """
    remedy = late or message("do-timeout")
    return StaleAnswerError(
        device,
        expected=message("expects-this-answer"),
        found=message("found-earlier"),
        remedy=remedy,
    )
