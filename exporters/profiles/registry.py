"""The controllers for which stepdiag writes files, by the name that ``--controller`` takes."""

from collections.abc import Mapping
from types import MappingProxyType

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.settings import nearest
from stepdiag.exporters.beckhoff.control import Beckhoff
from stepdiag.exporters.fagor.control import FAGOR
from stepdiag.exporters.fanuc.control import Fanuc
from stepdiag.exporters.heidenhain.control import Heidenhain
from stepdiag.exporters.linuxcnc.control import LinuxCnc
from stepdiag.exporters.mitsubishi.control import Mitsubishi
from stepdiag.exporters.neutral.curves_csv import Neutral
from stepdiag.exporters.siemens.control import Siemens
from stepdiag.exporters.tables.controller import Controller

_ALL: tuple[Controller, ...] = (
    Siemens(),
    Fanuc(),
    Heidenhain(),
    LinuxCnc(),
    Beckhoff(),
    Mitsubishi(),
    FAGOR,
    Neutral(),
)

CONTROLLERS: Mapping[str, Controller] = MappingProxyType(
    {controller.name: controller for controller in _ALL}
)


def controller_named(name: str) -> Controller:
    if name not in CONTROLLERS:
        raise UsageError(
            "--controller",
            expected=message("known-controller"),
            found=name,
            remedy=nearest(name, list(CONTROLLERS)),
        )
    return CONTROLLERS[name]
