"""Fagor 8055: the leadscrew compensation table of each axis, as a list to type in at the control.

Source: manual of the 8055i, p. 328. With LSCRWCOM (P15) on and NPOINTS (P16) points, each row
contains a position from machine zero, the amount of error for travel in +, and the amount of error
for travel in -, all in mm. If the second column contains only zeros, the first column is valid for
both directions. stepdiag assumes that the "amount of error" of the manual is the error of the
machine, and not its correction. No transfer format is public, and the manual describes no cross
table.
"""

from stepdiag.base.findings import info
from stepdiag.exporters.tables.axis_list import AxisList
from stepdiag.exporters.tables.tables import Law

FAGOR = AxisList(
    name="fagor",
    title="Fagor 8055 (leadscrew compensation tables as lists)",
    kind="leadscrew",
    heading="POSITION;ERROR +;ERROR -",
    law=Law(sense="as-error"),
    decimals=4,
    points=1000,
    value_um=99999.9999e3,
    steps=(
        "Back up the machine parameters and the leadscrew tables.",
        (
            "Set LSCRWCOM (P15) to ON and NPOINTS (P16) to the number of rows of each axis; key in "
            "the rows in rising order."
        ),
        (
            "A column ERROR - of zeros means that ERROR + counts for both directions. Set BACKLASH "
            "to 0 where both columns differ."
        ),
        (
            "Positions count from machine zero; the error at the reference is 0. Restart, "
            "reference "
            "the axes."
        ),
        (
            "The sense is taken from the wording: sign test first. Measure again; if the residual "
            "has grown, key in the restore list."
        ),
    ),
    remarks=(info("sign-untested.fagor"),),
)
