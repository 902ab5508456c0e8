"""Controls by name: the ``[plc]`` section of a survey for each kind of control, for ``stepdiag
setup``.

Each control has a file with its section, the source of its addresses, and the addresses from
memory, without a source.
"""

from importlib.resources import files

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message

CONTROLS = ("modbus", "siemens-828d", "siemens-840dsl", "heidenhain")


def control_section(name: str, host: str) -> str:
    """Return the text after ``[plc]`` in a survey file for the control ``name`` at ``host``, with
    its comments. Raises UsageError for an unknown name.
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
