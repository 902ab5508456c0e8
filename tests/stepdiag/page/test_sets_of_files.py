"""The page hands over sets for a control whole and unaltered, or nothing of them."""

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from stepdiag.base.errors import SafetyError
from stepdiag.daq.records.survey_folder import REFUSED
from stepdiag.exporters.export.export import export
from stepdiag.exporters.files.sets import SUMS
from stepdiag.page import app as page_app
from stepdiag.page.app import Page, create_app
from stepdiag.page.messages import PageSettings
from testkit.browsing import visit
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME
from testkit.hostile.foreign_tables import RESULT, Everything

LOADED = {"siemens": ".INI", "mitsubishi": "_SIGN.txt"}
"""What is loaded into a control may have any ending, that of a text for people too."""
HARM: dict[str, Callable[[Path, Path], object]] = {
    "altered": lambda _, table: table.write_bytes(table.read_bytes().replace(b"1", b"2")),
    "missing": lambda _, table: table.unlink(),
    "too much": lambda folder, table: (folder / f"b{table.name}").write_bytes(
        table.read_bytes()
    ),
    "no list": lambda folder, _: (folder / SUMS).unlink(),
    "another list": lambda folder, _: (folder / SUMS).write_text("x"),
}


@pytest.fixture(params=LOADED)
def exported(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The folder of an export in a survey's folder."""
    folder = tmp_path / "exports" / str(request.param)
    export(
        RESULT,
        request.param,
        profile_of(request.param, VOLUME),
        accept=Everything(),
        out_dir=folder,
    )  # type: ignore[arg-type]
    return folder


@pytest.fixture
def asked(tmp_path: Path) -> Callable[[str], tuple[int, bytes]]:
    """Ask the page of that survey."""

    class Daemon:
        async def picture(self) -> SimpleNamespace:
            return SimpleNamespace(folder=str(tmp_path), result="")

        def say_guesses(self, _address: str, _count: int) -> None:
            """No token is asked for."""

    settings = PageSettings(folder=str(tmp_path), token="")
    application = create_app(Page(Daemon(), settings), Daemon(), settings)  # type: ignore[arg-type]

    return lambda path: visit(application, path, "127.0.0.1")


def table_in(folder: Path) -> Path:
    """Return a file that is loaded into the control."""
    (table, *_) = (
        path
        for path in sorted(folder.iterdir())
        if path.name.endswith(LOADED[folder.name]) and "RESTORE" not in path.name
    )
    return table


def listed(asked: Callable[[str], tuple[int, bytes]]) -> list[str]:
    code, body = asked("/downloads.json")
    assert code == 200
    return [each["name"] for each in json.loads(body)]


def test_a_whole_set_is_handed_over(
    exported: Path, asked: Callable[[str], tuple[int, bytes]]
) -> None:
    table = f"exports-{exported.name}-{table_in(exported).name}"
    assert {table, f"{exported.name}.zip", f"{exported.name}-restore.zip"} <= set(
        listed(asked)
    )
    assert asked(f"/download/{table}") == (200, table_in(exported).read_bytes())
    assert asked(f"/download/{exported.name}.zip")[1].startswith(b"PK")


@pytest.mark.parametrize("how", HARM)
def test_a_set_that_is_not_as_it_was_written_is_not(
    exported: Path, asked: Callable[[str], tuple[int, bytes]], how: str
) -> None:
    """Neither as a bundle nor file by file, by whatever name; why files were refused is still
    told."""
    names = listed(asked)
    HARM[how](exported, table_in(exported))
    (exported / REFUSED).write_text("why", encoding="utf-8")
    assert [name for name in listed(asked) if exported.name in name] == [
        f"exports-{exported.name}-{REFUSED}"
    ]
    assert {name: asked(f"/download/{name}")[0] for name in names} == dict.fromkeys(
        names, 404
    )


def test_a_set_that_is_altered_while_it_is_fetched_is_refused(
    exported: Path, asked: Callable[[str], tuple[int, bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the look at the set and its packing there is a moment."""
    found = page_app.downloads_of

    def then_altered(folder: Path) -> object:
        before = found(folder)
        HARM["altered"](exported, table_in(exported))
        return before

    monkeypatch.setattr(page_app, "downloads_of", then_altered)
    code, body = asked(f"/download/{exported.name}.zip")
    assert (code, table_in(exported).name in body.decode()) == (409, True)


def test_a_set_whose_disk_goes_away_is_refused_and_no_folder_of_the_service_is_told(
    exported: Path,
    asked: Callable[[str], tuple[int, bytes]],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """An error of the disk was a fault of the program; a refusal named where the service keeps its
    files."""
    place = f"/download/{exported.name}.zip"
    assert asked(place)[0] == 200

    def away(*_: object, **__: object) -> bytes:
        raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), str(exported))

    with monkeypatch.context() as patched:
        patched.setattr(page_app, "zip_of", away)
        status, told = asked(place)
        assert (status, os.strerror(errno.ESTALE).encode() in told) == (409, True)
        assert str(tmp_path).encode() not in told

    def altered(*_: object, **__: object) -> bytes:
        raise SafetyError(
            str(exported), code="set-altered", expected="the bytes", found="others"
        )

    monkeypatch.setattr(page_app, "zip_of", altered)
    status, told = asked(place)
    assert (status, exported.name.encode() in told, str(tmp_path).encode() in told) == (
        409,
        True,
        False,
    )
