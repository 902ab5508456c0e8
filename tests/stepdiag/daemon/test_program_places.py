"""Where the program stands, and the unit for it."""

import sys
from pathlib import Path

import pytest

from stepdiag.base.errors import UsageError
from stepdiag.daemon.program_places import at_its_places, places_of_program

UNIT = (Path(__file__).parents[3] / "systemd" / "stepdiag@.service").read_text(
    encoding="utf-8"
)


@pytest.fixture
def homes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A Python of uv: the environment's link leads to a link to the version."""
    version = tmp_path / "share/cpython-3.11.9/bin/python3.11"
    version.parent.mkdir(parents=True)
    version.touch(0o755)
    (tmp_path / "share/cpython-3.11").symlink_to("cpython-3.11.9")
    (tmp_path / "venv/bin").mkdir(parents=True)
    (tmp_path / "venv/bin/python").symlink_to(tmp_path / "share/cpython-3.11/bin/python3.11")
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "venv"))
    monkeypatch.setattr(sys, "base_prefix", str(tmp_path / "share/cpython-3.11"))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "venv/bin/python"))
    return tmp_path


def test_every_folder_on_the_way_to_the_python_is_named(homes: Path) -> None:
    places = [
        place.relative_to(homes) for place in places_of_program() if homes in place.parents
    ]
    assert list(map(str, places)) == ["share/cpython-3.11", "share/cpython-3.11.9", "venv"]


def test_of_a_link_on_the_way_its_folder_alone_is_seen(homes: Path) -> None:
    """~/.local/bin/python3.11, which uv makes; ~/.local/share holds what other programs keep, keys
    among it."""
    (homes / "local/bin").mkdir(parents=True)
    (homes / "local/share/keyrings").mkdir(parents=True)
    (homes / "local/bin/python3.11").symlink_to("../../share/cpython-3.11/bin/python3.11")
    (homes / "venv/bin/python").unlink()
    (homes / "venv/bin/python").symlink_to(homes / "local/bin/python3.11")
    places = [
        place.relative_to(homes) for place in places_of_program() if homes in place.parents
    ]
    assert list(map(str, places)) == [
        "local/bin",
        "share/cpython-3.11",
        "share/cpython-3.11.9",
        "venv",
    ]


@pytest.mark.parametrize("home", ["/root", "/home/a", "/run/user/1000", "/home"])
def test_a_whole_home_is_no_place_of_the_program(home: str) -> None:
    with pytest.raises(UsageError, match=f"found {home}"):
        at_its_places(UNIT, [Path(home)], reachable=False)


def test_the_systems_python_is_seen_anyway(
    homes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "base_prefix", "/usr")
    (homes / "venv/bin/python").unlink()
    (homes / "venv/bin/python").symlink_to("/usr/bin/python3.11")
    assert [
        place for place in places_of_program() if Path("/usr") in (place, *place.parents)
    ] == []
    assert homes / "venv" in places_of_program()


def test_the_whole_disk_is_no_place_of_the_program(
    homes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """/bin/python3 is the system's Python by another way."""
    monkeypatch.setattr(sys, "base_prefix", "/usr")
    (homes / "venv/bin/python").unlink()
    (homes / "venv/bin/python").symlink_to("/bin/python3")
    assert Path("/") not in places_of_program()
    assert homes / "venv" in places_of_program()


def test_the_packaged_unit_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "prefix", "/opt/stepdiag")
    assert at_its_places(UNIT, [Path("/opt/stepdiag")], reachable=False) == UNIT


@pytest.mark.parametrize(
    ("place", "homes_are"),
    [("/root/.venv", "tmpfs"), ("/home/a/tools", "tmpfs"), ("/srv/rooted", "yes")],
)
def test_a_home_is_seen_where_the_program_stands_in_one(place: str, homes_are: str) -> None:
    """And nowhere else."""
    unit = at_its_places(UNIT, [Path(place)], reachable=False)
    assert f"\nBindReadOnlyPaths={place}\n" in unit
    assert f"\nProtectHome={homes_are}\n" in unit


@pytest.mark.parametrize(
    "place", ["/srv/two words", "/srv/%h", "/srv/a\nExecStart=x", "/srv/ä", "/srv/a:b"]
)
def test_a_place_that_a_unit_would_take_for_something_else_is_refused(place: str) -> None:
    with pytest.raises(UsageError, match="install the wheel into /opt/stepdiag"):
        at_its_places(UNIT, [Path(place)], reachable=False)


@pytest.mark.parametrize(
    "closed", ["venv", "venv/bin", "share/cpython-3.11.9/bin/python3.11"]
)
def test_what_others_may_not_run_is_refused(homes: Path, closed: str) -> None:
    """The service's account is nobody's."""
    (homes / closed).chmod(0o750)
    with pytest.raises(UsageError, match=r"chmod -R o\+rX"):
        at_its_places(
            UNIT, [place for place in places_of_program() if homes in place.parents]
        )
