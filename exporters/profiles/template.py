"""The commented profile that ``stepdiag profile C`` writes: every field with its meaning and
default; ``"?"`` marks a question.
"""

from stepdiag.exporters.programs import CONTROLS, default_decimals, default_signals
from stepdiag.exporters.programs.settings import program_template
from stepdiag.exporters.tables.controller import Controller
from stepdiag.exporters.tables.curves import FUNCTIONS

_COMMON = """\
# Controller profile of stepdiag for {title}.
# Every "?" is a question that only you or the machine can answer: nothing is guessed. Lines that
# begin with # show the defaults.

[machine]
name = "?"                    # how this machine is called in your shop
controller = "{name}"
# "off" or "on": was a compensation active while measuring? An answer that differs from the survey
# refuses the export
measured_with = "?"
# units = "mm"                # length unit of the control: "mm" or "inch"
# "mean": one table for both directions and a reversal value in the report; "both": a table for
# each
# direction = "mean"
# functions = [{functions}]
# files of the control, beside this profile: its tables now (restored from, merged with, used as
# template)
# existing = []
# SHA-256 of these files, noted when they were read out. Only needed if the readings do not state
# which files were active.
# active_sha256 = []
# Each squareness is added to one of two straightness functions: name this function.
[machine.squareness_into]
C0Y = "EXY"                   # EXY or EYX
B0Z = "EXZ"                   # EXZ or EZX
A0Z = "EYZ"                   # EYZ or EZY
{axes}
[limits]
# larger corrections are refused; left out: 200 um per metre of travel, 100 at least
# value_um = 100.0
# larger corrections have to be accepted; left out: 100 um per metre of travel, 50 at least
# warn_value_um = 50.0
# larger changes of the present table have to be accepted; left out: 40 um per metre, 20 at
# least
# change_um = 20.0
# steeper corrections have to be accepted; left out: the limit of this control
# slope_um_mm = 0.2
# points = 256                # most points in a table, if this control allows fewer than usual

# one for each kind of table: what the sign test showed on this machine, valid for 12 months
# [[sign_test]]
{kind_line}
# date = 2026-01-31
# "as-error" or "as-compensation". Also add machine, control and files, as `stepdiag signtest`
# prints them: without these fields the sign test does not count.
# verdict = "as-error"

"""

_AXIS = """
[axes.{letter}]
name = "?"                    # the name in the control's own data, not the place in a list
step_mm = "?"                 # distance of the table points; it must divide the length of the table
# reference (home) position in machine coordinates: the table is zero there
reference_mm = "?"
# start_mm = 0.0              # first point; left out: the low end of the measured volume
# end_mm = 500.0              # last point; left out: the high end of the measured volume
# travel_mm = [-5.0, 505.0]   # software limits; beyond the table its end values are held
# working_mm = [100.0, 400.0] # where the work lies: the tables fit best there (without it: over
# the whole measured volume)
# backlash in the control now (MD32450, 1851, BACKLASH); needed for direction = "both", and by
# LinuxCNC
# backlash_um = 0.0
"""


def profile_template(controller: Controller) -> str:
    """Return the profile template for a control. A profile with an unanswered question is
    refused.
    """
    common = _COMMON.format(
        title=controller.title,
        name=controller.name,
        functions=", ".join(f'"{name}"' for name in FUNCTIONS),
        axes="".join(_AXIS.format(letter=letter) for letter in "XYZ"),
        kind_line=f'# kind = "{controller.kinds[0]}"'.ljust(30)
        + "# the table that was tried: "
        + " or ".join(controller.kinds),
    )
    return common + controller.options_template + _program(controller.name)


def _program(control: str) -> str:
    return (
        program_template(default_signals(control), default_decimals(control))
        if control in CONTROLS
        else ""
    )
