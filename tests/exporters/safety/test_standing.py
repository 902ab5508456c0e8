"""What stands in a control after loading, beside what stood there before."""

from dataclasses import replace

import pytest

from stepdiag.exporters.safety.standing import Standing, standing_findings
from stepdiag.exporters.siemens.control import Siemens
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import AxisSection
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

CONTROL = Siemens()


def loaded(from_mm, to_mm, exx):
    """Return profile, tables and result of an export of EXX between two positions."""
    plain = profile_of("siemens", VOLUME)
    profile = replace(
        plain,
        axes={
            **plain.axes,
            "X": AxisSection(
                name="X", step_mm=100.0, reference_mm=0.0, start_mm=from_mm, end_mm=to_mm
            ),
        },
    )
    result = made_result({"EXX": exx})
    return profile, CONTROL.plan(curves_of(result, ["EXX"]), profile).tables, result


@pytest.mark.parametrize(
    ("from_mm", "to_mm", "old", "lost"),
    [
        (-200.0, 100.0, [0, 0, 0, 0, -7], ["Up to 7.0 µm"]),
        (-100.0, 200.0, [-7, 0, 0, 0, 0], ["Up to 7.0 µm"]),
        (-100.0, 100.0, [-7, 0, 0, 0, 4], ["Up to 7.0 µm"]),
        (-200.0, 100.0, [-7, 0, 0, 0, 0], []),
        (-200.0, 200.0, [-7, 0, 0, 0, 7], []),
    ],
    ids=["above", "below", "both", "flat where it ends", "as far"],
)
def test_a_new_table_that_reaches_less_far_than_the_old_one_says_what_is_lost(
    from_mm, to_mm, old, lost
):
    _, before, _ = loaded(-200.0, 200.0, old)
    profile, new, result = loaded(from_mm, to_mm, [0, 1, 2, 3, 4])
    found = [
        each
        for each in standing_findings(
            Standing(before=before, after=new, new=new), result, profile
        )
        if each.key == "old-table-lost.ends"
    ]
    assert len(found) == len(lost)
    assert all(part in each.text for part, each in zip(lost, found, strict=True))
