"""One cause over a whole pass (rates: `python -m benchmarks.shops`): a few shops of each kind, from the bytes to the correction."""

import pytest

from testkit.cli import stepdiag
from testkit.exact.shops import CAUSES, corrected, draw, survey_of, surveyed

KINDS = list(CAUSES)
NAMED = ("sign", "permutation", "codes shifted", "axis order", "laser sign", "laser late")


def shop_of(cause, again=0):
    """Return the shop of a cause on a machine with all registers."""
    return draw(KINDS.index(cause) + 3 * len(KINDS) * again)


@pytest.mark.parametrize("cause", NAMED)
def test_one_wrong_line_is_named_once_and_corrected_without_driving_again(cause, tmp_path):
    """The line is named by the fourth stop, after two standstills at which the file fails; nothing else is raised as an error; and the
    corrected file finds every pass in the same logs.
    """
    shop = shop_of(cause)
    found = surveyed(shop, tmp_path / "recorded", files=False)
    errors = [(after, each) for after, each in zip(found.after, found.findings, strict=True) if each.severity == "error"]
    assert [str(each.message.arguments["line"]).startswith(shop.line) for _, each in errors] == [True]
    assert errors[0][0] <= 4
    place = tmp_path / "bench"
    place.mkdir()
    (tmp_path / "recorded" / "logs").rename(place / "0001")
    logs = {path.name: path.read_bytes() for path in (place / "0001").glob("*.mcap")}
    file = tmp_path / "survey.toml"
    file.write_text(corrected(shop, survey_of(shop)), encoding="utf-8")
    told = stepdiag("correct", file, "--name", "somebody", "--yes")
    assert told.code == 0, told.refusal
    assert f"corrected: {found.wanted} whole passes" in told.out
    assert {path.name: path.read_bytes() for path in (place / "0001").glob("*.mcap")} == logs
    assert stepdiag("correct", file, "--yes").out.startswith("nothing to correct")


@pytest.mark.parametrize("again", range(2))
def test_a_right_file_has_no_cause(again, tmp_path):
    """Nothing is named, and nothing is held back for ever."""
    found = surveyed(shop_of("nothing", again), tmp_path, files=False)
    assert not [each for each in found.findings if each.severity != "info"]
    assert found.passes == found.wanted
