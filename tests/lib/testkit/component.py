"""The HAL component for LinuxCNC beside stand-ins for the control's two Python modules: a control
that is on and runs a program."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from unittest.mock import patch

from stepdiag.exporters.programs import linuxcnc as made


def _loaded() -> ModuleType:
    control = ModuleType("linuxcnc")
    status = SimpleNamespace(poll=lambda: None, interp_state=2, task_state=4)
    vars(control).update(stat=lambda: status, INTERP_IDLE=1, STATE_ON=4, error=RuntimeError)
    spec = importlib.util.spec_from_file_location(
        "stepdiag_modbus", Path(made.__file__).with_name(made.COMPONENT)
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with patch.dict(sys.modules, {"hal": ModuleType("hal"), "linuxcnc": control}):
        spec.loader.exec_module(module)
    return module


COMPONENT = _loaded()
