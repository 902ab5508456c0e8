"""Comparing results: the right quantity is named, chance is not called a change, and a change is
not called chance."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.errors import DataError
from stepdiag.base.result.interval import Interval
from stepdiag.base.result.members import Facts
from stepdiag.base.result.result import Function, Quantity, Result
from stepdiag.base.volume import Volume
from stepdiag.cli.app import build
from stepdiag.comparing.compare import compare, coverage_factor, trend
from stepdiag.conclusion import Reach, conclude
from stepdiag.report.as_left import build_as_left
from stepdiag.report.certificate import as_left
from testkit.cli import stepdiag
from testkit.exact.madeup import made_up_result
from testkit.exact.members import members


def noisy(result: Result, random: np.random.Generator) -> Result:
    """Return the result of measuring the same machine again: each value moved by its own
    uncertainty."""

    def again(function: Function) -> Function:
        return replace(
            function, value=function.value + function.u * random.normal(size=len(function.u))
        )

    squareness = {
        name: Quantity(value=q.value + q.u * random.normal(), u=q.u)
        for name, q in result.squareness.items()
    }
    return replace(
        result,
        errors={name: again(function) for name, function in result.errors.items()},
        squareness=squareness,
    )


def test_nothing_changed_is_said_so() -> None:
    """A result against itself: no difference, no change, the same volumetric error."""
    result = made_up_result(scales=True)
    same = compare(result, result)
    assert all(
        change.difference == 0 and change.significant is False for change in same.changes
    )
    assert same.rms_before_um == same.rms_after_um


def test_chance_is_rarely_called_a_change() -> None:
    """Measured twice without a change, a machine is reported as changed in 4.6 % of the comparisons
    (k = 2), over all quantities."""
    random = np.random.default_rng(20)
    result = made_up_result(scales=False, reversal=False)
    compared = [
        compare(noisy(result, random), noisy(result, random)).changes for _ in range(300)
    ]
    decided = [sum(change.verdict is not None for change in changes) for changes in compared]
    assert set(decided) == {12}
    called = np.mean([any(change.significant for change in changes) for changes in compared])
    assert called < 0.075


def test_a_change_of_three_u_is_never_called_unchanged() -> None:
    """Between chance and three times its U a change is not decidable; only below is it
    unchanged."""
    random = np.random.default_rng(21)
    result = made_up_result(scales=False, reversal=False)
    off = replace(
        result,
        squareness={
            **result.squareness,
            "C0Y": replace(
                result.squareness["C0Y"],
                value=result.squareness["C0Y"].value
                + 6 * np.sqrt(2) * result.squareness["C0Y"].u,
            ),
        },
    )
    verdicts = [
        next(
            change.verdict
            for change in compare(noisy(result, random), noisy(off, random)).changes
            if change.name == "C0Y"
        )
        for _ in range(200)
    ]
    assert "unchanged" not in verdicts
    assert verdicts.count("changed") > 180


def test_the_coverage_factor_is_two_for_one_quantity() -> None:
    """Sidak: for 9 nodes the chance of 4.55 % is shared, 1 - (1 - 0.0455)^(1/9) = 0.516 %, k =
    2.797."""
    assert coverage_factor(1) == pytest.approx(2.0)
    assert coverage_factor(9) == pytest.approx(2.797, abs=2e-3)


def test_a_crash_of_one_axis_is_found() -> None:
    """Squareness moved by 5 urad and one straightness by 4 µm in one place: these two are named,
    with size and place."""
    before = made_up_result()
    bent = before.errors["EYX"].value.copy()
    bent[4] += 4.0
    after = replace(
        before,
        squareness={**before.squareness, "C0Y": Quantity(value=25.0, u=0.4)},
        errors={**before.errors, "EYX": replace(before.errors["EYX"], value=bent)},
    )
    changed = {
        change.name: change for change in compare(before, after).changes if change.significant
    }
    assert changed.keys() == {"C0Y", "EYX"}
    assert changed["C0Y"].difference == pytest.approx(5.0)
    assert changed["EYX"].difference == pytest.approx(4.0)
    assert changed["EYX"].position_mm == pytest.approx(200.0)


def test_half_of_every_error_is_half_the_volumetric_error() -> None:
    """All functions and squarenesses halved: what both say of the volume differs by two."""
    before = made_up_result(reversal=False)
    after = replace(
        before,
        errors={
            name: replace(function, value=function.value / 2)
            for name, function in before.errors.items()
        },
        squareness={
            name: Quantity(value=q.value / 2, u=q.u) for name, q in before.squareness.items()
        },
    )
    found = compare(before, after)
    assert found.rms_before_um == pytest.approx(2.0 * found.rms_after_um)


def test_a_scale_known_only_once_is_no_change() -> None:
    """Where one survey had linear runs and the other had not, the shapes are compared and the scale
    is left open."""
    with_runs, without = made_up_result(scales=True), made_up_result(scales=False)
    changes = {change.name: change for change in compare(with_runs, without).changes}
    assert changes["scale X"].significant is None
    assert changes["EXX"].significant is False


def test_other_nodes_are_compared_where_both_cover() -> None:
    """A survey with other increments over a part of the travel is compared by interpolation."""
    before = made_up_result(reversal=False)
    nodes = np.array([100.0, 200.0, 300.0])
    function = before.errors["EYX"]
    part = replace(
        function,
        position_mm=nodes,
        value=np.interp(nodes, function.position_mm, function.value),
        u=np.full(3, 0.4),
    )
    change = next(
        one
        for one in compare(
            before, replace(before, errors={**before.errors, "EYX": part})
        ).changes
        if one.name == "EYX"
    )
    assert change.significant is False


def test_another_machine_is_refused() -> None:
    """Another chain, or a volume elsewhere: a refusal, not a table of nonsense."""
    result = made_up_result()
    far = Volume(origin_mm=(900.0, 0.0, 0.0), size_mm=(100.0, 100.0, 100.0), increments=4)
    with pytest.raises(DataError, match="chain"):
        compare(result, replace(result, chain="XYFZ"))
    with pytest.raises(DataError, match="overlap"):
        compare(result, replace(result, volume=far))


def test_the_trend_follows_each_quantity() -> None:
    """Three results in order give three values a quantity, in that order."""
    results = [made_up_result(amplitude_um=amplitude) for amplitude in (4.0, 6.0, 8.0)]
    by_name = {one.name: one for one in trend(results)}
    low, middle, high = by_name["volumetric error rms"].values
    assert low < middle < high
    assert by_name["scale X"].values == (None, None, None)
    assert by_name["range of EYX"].values[2] == pytest.approx(
        2 * by_name["range of EYX"].values[0]
    )


def test_the_command_prints_a_table_and_json(tmp_path: Path) -> None:
    """A person gets a table with the verdict; a program gets the same numbers."""
    for name, amplitude in (("a", 8.0), ("b", 4.0), ("c", 2.0)):
        (tmp_path / f"{name}.json").write_text(
            made_up_result(amplitude_um=amplitude).to_json(), encoding="utf-8"
        )
    paths = [str(tmp_path / f"{name}.json") for name in "abc"]
    told = CliRunner().invoke(build(), ["compare", *paths], env={"COLUMNS": "160"})
    assert told.exit_code == 0, told.output
    assert "volumetric error (rms, k = 2)" in told.output
    assert "factor" not in told.output
    assert "trend" in told.output
    document = json.loads(CliRunner().invoke(build(), ["compare", *paths, "--json"]).output)
    eyx = next(change for change in document["changes"] if change["name"] == "EYX")
    assert eyx["significant"] is True
    assert document["volumetric_rms"].keys() == {
        "before_um",
        "after_um",
        "before",
        "after",
    }, "two intervals, and no factor"
    assert len(document["trend"][0]["values"]) == 3


def test_what_u_takes_for_granted_stands_once_or_under_each_name(tmp_path: Path) -> None:
    """A difference is more than U only as far as U is right: what it rests on is printed beside it,
    and where two results differ in it."""
    for name, angles_urad in (("a", 10.0), ("b", 10.0), ("c", 5.0)):
        assumed = Assumptions(angles_urad=angles_urad).stated()
        result = replace(made_up_result(amplitude_um=8.0), assumed=assumed)
        (tmp_path / f"{name}.json").write_text(result.to_json(), encoding="utf-8")
    same, other = (
        CliRunner().invoke(
            build(), ["compare", str(tmp_path / "a.json"), str(tmp_path / f"{name}.json")]
        )
        for name in "bc"
    )
    assert same.output.count("assumes these sizes") == 1
    assert [
        line.split(" U (k")[0]
        for line in other.output.splitlines()
        if "assumes these sizes" in line
    ] == ["a.json:", "c.json:"]


def halved(result: Result) -> Result:
    """Return the machine after half of everything was taken away."""
    return replace(
        result,
        errors={
            name: replace(function, value=function.value / 2)
            for name, function in result.errors.items()
        },
        squareness={
            name: Quantity(value=q.value / 2, u=q.u) for name, q in result.squareness.items()
        },
    )


@pytest.mark.parametrize("language", ["en", "de"])
def test_predicted_and_measured_make_the_last_page(tmp_path: Path, language: str) -> None:
    """The files that were loaded say what was promised; the survey after them says what came of it,
    each with its U."""
    before = made_up_result(reversal=False)
    for name, result in (("before", before), ("after", halved(before))):
        (tmp_path / f"{name}.json").write_text(result.to_json(), encoding="utf-8")
    told = stepdiag(
        "export",
        tmp_path / "before.json",
        "--controller",
        "lattice",
        "--step-mm",
        100,
        "--out",
        tmp_path / "files",
    )
    assert told.code == 0, told
    both = (tmp_path / "before.json", tmp_path / "after.json", "--loaded", tmp_path / "files")
    said = stepdiag("compare", *both, "--out", tmp_path / "left.html", "--language", language)
    assert "predicted:" in said.out
    assert "as left:" in said.out
    found = json.loads(stepdiag("compare", *both, "--json").out)["as_left"]
    assert found["kept"] is None, "a made-up result says nothing of how sure its volume is"
    assert 0 < found["predicted_rms"]["value_um"] < found["measured_rms"]["value_um"]
    page = (tmp_path / "left.html").read_text(encoding="utf-8")
    assert ("cannot be judged" if language == "en" else "lässt sich nicht beurteilen") in page
    assert "lattice.csv" in page
    assert "<h1>" in page


@pytest.mark.parametrize(
    ("again", "kept", "gain"),
    [
        ((1.5, 2.5), True, "better"),
        ((4.0, 6.0), False, "better"),
        ((8.0, 12.0), False, "same"),
        ((13.0, 15.0), False, "worse"),
    ],
)
def test_what_became_of_the_machine_is_said_beside_the_prediction(
    again: tuple[float, float], kept: bool, gain: str
) -> None:
    """A prediction that came true may be no gain, and a machine that is worse than it was found is
    called so, in both languages."""

    def reach(rms: tuple[float, float], after: tuple[float, float]) -> Reach:
        one, other = (
            Interval(value_um=sum(ends) / 2, low_um=ends[0], high_um=ends[1])
            for ends in (rms, after)
        )
        return Reach(rms_before=one, largest_before=one, rms_after=other, largest_after=other)

    measured = replace(conclude(made_up_result()), reach=reach(again, (0.5, 1.0)))
    left = as_left("after.json", measured, reach((9.0, 11.0), (1.0, 3.0)))
    assert (left.kept, left.gain) == (kept, gain)
    for language, worse in (
        ("en", "larger than before: load the restore files"),
        ("de", "größer als vorher"),
    ):
        html = build_as_left(
            made_up_result(), made_up_result(), left, measured, language=language
        ).html
        assert (worse in html) == (gain == "worse")


def test_a_prediction_of_next_to_nothing_is_no_gain() -> None:
    """Where compensation was to leave what was found, coming true proves nothing."""
    same = Interval(value_um=10.0, low_um=9.0, high_um=11.0)
    found = Reach(rms_before=same, largest_before=same, rms_after=same, largest_after=same)
    left = as_left("after.json", replace(conclude(made_up_result()), reach=found), found)
    assert (left.kept, left.gain) == (True, "same")


def test_the_last_page_refuses_another_machine(tmp_path: Path) -> None:
    before = replace(made_up_result(), survey=Facts(machine="mill"))
    after = replace(made_up_result(), survey=Facts(machine="lathe"))
    (tmp_path / "before.json").write_text(before.to_json(), encoding="utf-8")
    (tmp_path / "after.json").write_text(after.to_json(), encoding="utf-8")
    told = stepdiag(
        "compare",
        tmp_path / "before.json",
        tmp_path / "after.json",
        "--out",
        tmp_path / "left.html",
    )
    assert told.code == 3
    assert "mill" in told.refusal
    assert not (tmp_path / "left.html").exists()


def test_results_of_one_file_name_are_told_apart(tmp_path: Path) -> None:
    """Every survey's result is result.json: each is named by its path, machine, survey and time,
    also where a remark names one of them."""
    paths = []
    for month, machine in (("05", "VM 500"), ("11", "VM 500"), ("12", "VM 700")):
        facts = {
            "machine": machine,
            "machine_serial": "M-4711",
            "survey": "hall 2",
            "begun": f"2026-{month}-02 08:00 UTC",
        }
        paths.append(tmp_path / month / "result.json")
        paths[-1].parent.mkdir()
        paths[-1].write_text(made_up_result(survey=facts).to_json(), encoding="utf-8")
    lines = stepdiag("compare", *paths[:2]).out.splitlines()
    for path, month in zip(paths, ("05", "11"), strict=False):
        assert f"{path}: VM 500, M-4711, hall 2, 2026-{month}-02 08:00 UTC" in lines
    told = json.loads(stepdiag("compare", *paths[:2], "--json").out)["results"]
    assert [(one["file"], one["begun"]) for one in told] == [
        (str(paths[0]), "2026-05-02 08:00 UTC"),
        (str(paths[1]), "2026-11-02 08:00 UTC"),
    ]
    refused = " ".join(stepdiag("compare", paths[0], paths[2]).refusal.split())
    assert f"{paths[2]}: survey.machine" in refused
    assert f"as in {paths[0]}" in refused


def test_as_left_says_the_figure_of_its_own_report(tmp_path: Path) -> None:
    """What a result says of its volume stands in its report: compare drew it again, and beside an
    older solver's it was another figure."""

    def saying(low: float, high: float) -> Result:
        figure = {
            "rms_um": {"value": 10.0, "low": low, "high": high},
            "largest_um": {"value": 20.0, "low": 15.0, "high": 25.0},
        }
        both = {"before": figure, "after": figure}
        return made_up_result(predicted={"without_rigid_motion": both, "as_it_is": both})

    both = (tmp_path / "before.json", tmp_path / "after.json")
    for path, result in zip(both, (saying(9.0, 11.0), saying(8.0, 9.5)), strict=True):
        path.write_text(result.to_json(), encoding="utf-8")
    told = json.loads(
        stepdiag("compare", *both, "--out", tmp_path / "left.html", "--json").out
    )
    for one in (
        told["volumetric_rms"]["after"],
        {
            name.removesuffix("_um"): value
            for name, value in told["as_left"]["measured_rms"].items()
        },
    ):
        assert (one["low"], one["high"]) == (8.0, 9.5)
    assert told["volumetric_rms"]["before"]["high"] == 11.0
    assert told["as_left"]["gain"] == "same"


@pytest.mark.parametrize("command", ["compare", "report"])
def test_as_left_of_a_smaller_volume_is_refused(tmp_path: Path, command: str) -> None:
    """Half of the travel errs less, and nothing was gained: it read as "better"."""
    before = made_up_result()
    size = before.volume.size_mm
    half = replace(before, volume=replace(before.volume, size_mm=(size[0] / 2, *size[1:])))
    paths = tmp_path / "before.json", tmp_path / "after.json"
    for path, result in zip(paths, (before, half), strict=True):
        path.write_text(result.to_json(), encoding="utf-8")
    arguments = {
        "compare": (paths[0], paths[1]),
        "report": (paths[0], "--as-left", paths[1]),
    }[command]
    told = stepdiag(command, *arguments, "--out", tmp_path / "left.html")
    assert told.code == 3
    assert "after.json: volume" in told.refusal
    assert not (tmp_path / "left.html").exists()
    assert stepdiag("compare", *paths).code == 0, (
        "what changed in what both cover is still said"
    )


def test_lengths_at_20_c_and_as_measured_are_not_compared():
    """Six degrees are 70 µm/m of a steel scale, which no machine lost."""
    one, other = (
        replace(made_up_result(), **members(lengths={"tables": tables}))
        for tables in ("as_measured", "at_20_c")
    )
    with pytest.raises(
        DataError, match=r"other lengths: lengths at 20 C instead of lengths as measured"
    ):
        compare(one, other)
    assert compare(other, other).changes
