"""The controllers that stepdiag can write for, by the word of ``--controller``."""

from collections.abc import Mapping
from types import MappingProxyType

from exporters.beckhoff import Beckhoff
from exporters.controller import Controller
from exporters.fagor import Fagor
from exporters.fanuc import Fanuc
from exporters.heidenhain import Heidenhain
from exporters.linuxcnc import LinuxCnc
from exporters.mitsubishi import Mitsubishi
from exporters.neutral import Neutral
from exporters.settings import nearest
from exporters.siemens import Siemens
from solver.errors import UsageError

_ALL: tuple[Controller, ...] = (Siemens(), Fanuc(), Heidenhain(), LinuxCnc(), Beckhoff(), Mitsubishi(), Fagor(), Neutral())

CONTROLLERS: Mapping[str, Controller] = MappingProxyType({controller.name: controller for controller in _ALL})


def controller_named(name: str) -> Controller:
    """Return the controller called ``name``. Raises ``UsageError`` with the nearest name."""
    if name not in CONTROLLERS:
        raise UsageError("--controller", expected="a known controller", found=name, remedy=nearest(name, list(CONTROLLERS)))
    return CONTROLLERS[name]
