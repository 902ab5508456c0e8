"""Controls by name: the ``[plc]`` section of a survey for each kind of control, as ``stepdiag
setup`` writes it.

Each control has a file of its own, which names the source of its addresses, and the addresses
recalled without a source.
"""

from importlib.resources import files

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message

CONTROLS = ("modbus", "siemens-828d", "siemens-840dsl", "heidenhain")


def control_section(name: str, host: str) -> str:
    """Return the text after ``[plc]`` in a survey file for the control of this name at ``host``,
    with its comments. Raises UsageError.
    """
    if name not in CONTROLS:
        raise UsageError(
            "control", expected=message("one-of", names=list(CONTROLS)), found=repr(name)
        )
    text = (
        files("stepdiag.daq.survey.controls")
        .joinpath(f"{name}.toml")
        .read_text(encoding="utf-8")
    )
    return text.replace("{host}", host)
