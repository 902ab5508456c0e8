"""A profile of another machine is refused by name, before anything is written."""

from dataclasses import replace
from pathlib import Path

import pytest

from stepdiag.base.errors import SafetyError
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Volume
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.sets import read_given
from stepdiag.exporters.safety.verify import verify_files
from testkit.exact.machines import profile_of
from testkit.exact.members import members
from testkit.exact.results import made_result

VOLUME = Volume(origin_mm=(0.0, 0.0, 0.0), size_mm=(400.0, 400.0, 400.0), increments=4)


def named(machine: str) -> Result:
    position_mm = VOLUME.nodes_mm(0)
    result = made_result({"EXX": 0.02 * position_mm}, volume=VOLUME)
    return replace(result, **members(survey={"machine": machine, "compensation": "off"}))


@pytest.mark.parametrize("machine", ["test machine", " Test  MACHINE", "machine", "", "?"])
def test_one_machine_however_it_is_written(machine: str, tmp_path: Path) -> None:
    """Case and spaces are no other machine; a survey that names none says nothing."""
    result = named(machine)
    assert export(
        result, "neutral", profile_of("neutral", result.volume), out_dir=tmp_path
    ).files


def test_another_machine_is_refused_with_both_names(tmp_path: Path) -> None:
    result = named("mill 7")
    profile = profile_of("neutral", result.volume)
    with pytest.raises(SafetyError, match=r"'mill 7'.*'test machine'"):
        export(result, "neutral", profile, out_dir=tmp_path)
    assert list(tmp_path.iterdir()) == []
    written = export(named("test machine"), "neutral", profile, out_dir=tmp_path / "files")
    given = read_given(
        [written.out_dir / name for name in written.files if name.endswith(".csv")]
    )
    with pytest.raises(SafetyError, match="mill 7"):
        verify_files(result, given, profile)
