"""The typed members of a result, version 3: what another program, or a damaged file, may make of
each."""

import json
import math
from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.compensation import stated_in
from stepdiag.base.errors import DataError
from stepdiag.base.result.json_tree import Node
from stepdiag.base.result.members import SetupReport, UnseenSlips
from stepdiag.base.result.result import MEMBERS, parse_result
from stepdiag.base.result.typed import read, read_or_none
from stepdiag.solver.methods.solve import solve
from testkit.exact.madeup import made_up_result
from testkit.exact.surveys import Bench
from testkit.examples import few

FILE = {"name": "EEC.INI", "sha256": "a" * 64, "date": "2026-01-31", "source": "archive"}
SCALES = {axis: {"value": 1.5, "u": 0.5, "unit": "um/m"} for axis in "XYZ"}
SIZES = {
    "rms_um": {"value": 2.0, "low": 1.0, "high": 3.0},
    "largest_um": {"value": 5.0, "low": 4.0, "high": 6.0},
}
SLIP = {
    "setup": "ppp",
    "pass": 1,
    "stop": 5,
    "half_um": 1.5,
    "nearly_um": 2.5,
    "volume_um": 0.5,
    "readings_um": 0.25,
    "passes": ["ppp/1"],
}
JUDGED = {
    "quantity": "C0Y",
    "unit": "urad",
    "tolerance": 20.5,
    "value": 1.5,
    "low": 0.5,
    "high": 2.5,
    "probability": 0.5,
    "verdict": "conform",
}
ASSUMED = dict.fromkeys(
    (
        "angles_urad",
        "drift_um",
        "wander_um",
        "repeatability_um",
        "setup_c",
        "growth_um_m",
        "u_expansion_um_m_c",
        "index_ppm",
        "index_setup_ppm",
        "alignment_mrad",
        "between_um",
        "reading_um",
        "u_material_c",
        "shape_um",
        "squareness_urad",
        "scale_um_m",
    ),
    1.5,
)
WHOLE = {
    "survey": {
        "machine": "mill",
        "survey": "spring",
        "operator": "A",
        "workpiece": "",
        "date": "2026-05-31",
        "begun": "2026-05-31 08:00 UTC",
        "wavelength_nm": 632.991,
        "at_20_c": False,
        "compensation": "on",
        "active_files": [FILE],
    },
    "conditions": {
        "air_temperature_c": [20.0, 20.5],
        "assumed": {"air_pressure_hpa": 1013.0},
    },
    "history": [
        {
            "code": "beam-lost",
            "severity": "warning",
            "action": "repeat",
            "text": "the beam was lost",
        }
    ],
    "volumetric_u_um": 0.5,
    "predicted": {
        name: {"before": SIZES, "after": SIZES}
        for name in ("without_rigid_motion", "as_it_is")
    },
    "fit": {
        "readings": 9,
        "used": 8,
        "rank": 7,
        "unknowns": 7,
        "degrees_of_freedom": 2,
        "chi_square": 1.5,
    },
    "scale_sum_um": {"value": 1.5, "u": 0.5},
    "scale_misclosure_um": {"value": 1.5, "u": 0.5},
    "backlash": {"X": {"value": 1.5, "u": 0.5, "unit": "um"}},
    "unseen_slip": {"diagonals": SLIP},
    "closure_um": {axis: [0.0, 0.5] for axis in "xyz"},
    "assumed": {
        **ASSUMED,
        "angle_urad": {"EAX": 2.5},
        "expansion_um_m_c": [11.5] * 3,
        "material_c": [20.5] * 3,
        "material_stated": True,
        "reduced_to_20_c": False,
    },
    "lengths": {
        "tables": "as_measured",
        "material_c": [21.5] * 3,
        "expansion_um_m_c": [11.5] * 3,
        "as_measured": SCALES,
        "at_20_c": SCALES,
    },
    "tool": {"offset_mm": [0.0, 0.0, 0.0], "up_to_um_per_100_mm": 1.5},
    "head_straightness": {
        "EYX": {
            "passes": 2,
            "end_point_um": 1.5,
            "least_squares_um": 1.5,
            "minimum_zone_um": 1.5,
            "u_um": 0.5,
            "residual_um": 0.5,
            "misclosure": 1.5,
            "used": False,
            "difference_um": {"position_mm": [0.0, 1.5], "value": [0.0, 0.5]},
        },
    },
    "budget": {
        "assumptions": {"air": "known"},
        "shares": {"EXX": {"air": 0.5}},
        "combined": {"EXX": 0.5},
    },
    "coverage": {"EXX": {"degrees_of_freedom": 4.5, "k": 2.5}},
    "standards": {
        "linear-x": [
            {
                "standard": "ISO 230-2:2014",
                "source_status": "recalled",
                "E_up": 1.5,
                "runs": 5,
                "U": {"E_up": 0.5},
            }
        ]
    },
    "monte_carlo": {"trials": 9, "EXX": {"u": 0.5, "u_stated": 0.5}},
    "sources": [{"role": "log", "name": "0001.mcap", "sha256": "b" * 64}],
    "tolerance": {"squareness_urad": 20.5},
    "conformity": {"as_found": [JUDGED], "predicted": []},
}
"""Every member once, with most of its own members."""
SETUPS = {
    "ppp": {
        "kind": "step",
        "passes": [1, 2],
        "stops": 62,
        "tilt_mrad": 0.5,
        "tilt_xyz_mrad": [0.25, 0.25, 0.25],
        "drift": [{"pair": 1, "rate": 0.5, "unit": "um/h", "total_um": 0.25, "u_um": 0.125}],
        "repeatability_um": 0.25,
        "residual_um": 0.125,
        "noise_um": 0.25,
        "redundancy": 30.5,
    },
}
LEFT_OUT = {
    "begun",
    "wavelength_nm",
    "air_temperature_c",
    "assumed",
    "air_pressure_hpa",
    "X",
    "diagonals",
    "used",
    "difference_um",
    "E_up",
    "runs",
    "U",
}
"""Names that may be left out, wherever they stand below a member; entries of `MAPS` may be, too."""
MAPS = (
    "angle_urad",
    "head_straightness",
    "assumptions",
    "shares",
    "EXX",
    "combined",
    "coverage",
    "standards",
    "U",
    "monte_carlo",
    "setups",
    "tolerance",
)
"""Maps by quantity, source, setup or function."""


@cache
def written():
    """Return a result with every member, as text."""
    found = json.loads(made_up_result().to_json())
    return json.dumps({**found, "setups": SETUPS, **WHOLE})


def document(version=3):
    """Return a result with every member, as JSON that a test may change."""
    return {**json.loads(written()), "version": version}


def leaves(tree, path=()):
    """Yield the path of everything below a tree."""
    inside = (
        tree.items()
        if isinstance(tree, dict)
        else enumerate(tree)
        if isinstance(tree, list)
        else ()
    )
    for name, value in inside:
        yield (*path, name)
        yield from leaves(value, (*path, name))


def at(tree, path):
    for step in path:
        tree = tree[step]
    return tree


def shown(path):
    """Return a path as a refusal names it."""
    return "".join(
        f"[{step}]" if isinstance(step, int) else f".{step}" for step in path
    ).lstrip(".")


@cache
def places():
    return tuple(path for path in leaves(document()) if path[0] in (*MEMBERS, "setups"))


def other_types(value):
    """Return values of every JSON type but that of one; numbers of either kind are one type, and
    None is one of those that may be None."""
    every = ["text", 1.5, True, [], {}, [None], {"unheard": 1}]
    same = (int, float) if type(value) in (int, float) else type(value)
    return [
        one
        for one in every
        if type(one) is bool
        or not isinstance(one, same)
        or (one and isinstance(one, list | dict))
    ]


def test_every_member_stands_in_the_document_of_these_tests():
    assert WHOLE.keys() == MEMBERS.keys()


def test_a_document_of_version_3_gives_the_same_bytes_again():
    text = parse_result(json.dumps(document())).to_json()
    assert json.loads(text) == document()
    assert parse_result(text).to_json() == text


@given(st.data())
def test_a_member_of_another_type_is_refused_by_its_name(data):
    path = data.draw(st.sampled_from(places()))
    changed = document()
    was = at(changed, path)
    value = data.draw(
        st.sampled_from(other_types(was) if type(was) is not bool else ["text", 1.5, [], {}])
    )
    if path[-1] in MAPS and value in ({}, {"unheard": 1}):  # any name may stand in a map
        return
    at(changed, path[:-1])[path[-1]] = value
    if value in ([], {}) and type(was) is type(value):
        return
    with pytest.raises(DataError) as refused:
        parse_result(json.dumps(changed), "r.json")
    assert refused.value.where.startswith(f"r.json: {shown(path)}")


@given(st.sampled_from(places()), st.sampled_from([math.nan, math.inf, -math.inf, 1e300]))
def test_a_number_that_is_not_finite_is_refused_by_its_name(path, number):
    changed = document()
    at(changed, path[:-1])[path[-1]] = number
    with pytest.raises(DataError) as refused:
        parse_result(json.dumps(changed), "r.json")
    assert refused.value.where == f"r.json: {shown(path)}"


@given(st.sampled_from(places()))
def test_a_required_member_that_is_missing_is_refused_by_its_name(path):
    """Everything is required but the members of the result themselves, entries of maps, and the
    names of `LEFT_OUT`."""
    changed = document()
    above = at(changed, path[:-1])
    if (
        not isinstance(above, dict)
        or len(path) == 1
        or path[-1] in LEFT_OUT
        or (path[-2] in MAPS and path != ("monte_carlo", "trials"))
    ):
        return
    del above[path[-1]]
    with pytest.raises(DataError, match="found nothing") as refused:
        parse_result(json.dumps(changed), "r.json")
    assert refused.value.where == f"r.json: {shown(path)}"


@given(
    st.sampled_from(
        [
            (),
            *(
                path
                for path in places()
                if isinstance(at(document(), path), dict) and path[-1] not in MAPS
            ),
        ]
    )
)
def test_an_unknown_member_is_refused_by_its_name(path):
    changed = document()
    at(changed, path)["unheard"] = 1
    if path and path[-1] in ("linear-x", "ppp"):
        return
    with pytest.raises(DataError) as refused:
        parse_result(json.dumps(changed), "r.json")
    assert refused.value.where == f"r.json: {shown((*path, 'unheard'))}"


@few(15)
@given(
    st.sampled_from(places()),
    st.sampled_from(["text", 7.5, True, [], {}, [None], {"unheard": 1}, None]),
    st.sampled_from([1, 2]),
)
def test_versions_1_and_2_are_read_whatever_stands_in_a_member(path, value, version):
    changed = document(version)
    at(changed, path[:-1])[path[-1]] = value
    if path == ("setups",):
        return
    found = parse_result(json.dumps(changed))
    text = found.to_json()
    assert parse_result(text).to_json() == text
    others = [name for name in MEMBERS if name != path[0]]
    assert [getattr(found, name) for name in others] == [
        getattr(parse_result(json.dumps(document())), name) for name in others
    ]


def test_a_damaged_list_of_active_files_is_never_read_in_part():
    """An export compares it with the files of the profile: with one of two files left out it would
    take the wrong set."""
    changed = document(2)
    changed["survey"]["active_files"] = [FILE, {**FILE, "sha256": 5}]
    with pytest.raises(DataError, match=r"survey\.compensation"):
        stated_in(parse_result(json.dumps(changed)))


def test_the_closed_forms_of_before_are_read():
    """Their setups counted passes, and their sum of the scales was a number alone."""
    old = document(2) | {
        "setups": {"ppp": {"passes": 2}},
        "scale_sum_um": 1.5,
        "fit": {"noise_um": 0.5},
    }
    found = parse_result(json.dumps(old))
    assert found.setups == {"ppp": SetupReport(passes=(1, 2))}
    assert (found.scale_sum_um.value, found.scale_sum_um.u) == (1.5, None)
    assert (found.fit.noise_um, found.fit.readings) == (0.5, None)


@pytest.mark.parametrize("method", ["estimate", "least-squares", "wang2000"])
def test_what_the_solver_writes_is_of_version_3(method):
    """Read and written again it gives the same bytes, and what the solver returned stands in it."""
    result = solve(Bench(increments=3).survey(), method=method)
    text = result.to_json()
    again = parse_result(text)
    assert again.to_json() == text
    assert [name for name in MEMBERS if getattr(again, name) is None] == [
        name for name in MEMBERS if getattr(result, name) is None
    ]


def test_the_slips_that_are_there_are_listed():
    found = read(Node({"runs": SLIP}, "r", "", strict=True), UnseenSlips)
    assert [str(each.where) for each in found] == [
        "diagonal X-Y-Z- to X+Y+Z+ (ppp), pass 1 out, stop 6"
    ]
    assert (
        read_or_none(Node({"runs": {**SLIP, "pass": 1.5}}, "r", ""), UnseenSlips)
        == UnseenSlips()
    )
