"""What a person may fetch from the page: the survey's own files."""

from pathlib import Path

from stepdiag.page.downloads import downloads_of


def test_a_link_that_leads_out_of_the_folder_is_not_given_out(tmp_path: Path) -> None:
    folder, other = tmp_path / "0001", tmp_path / "other"
    (folder / "exports").mkdir(parents=True)
    other.mkdir()
    (other / "secret.txt").write_text("secret", encoding="utf-8")
    (folder / "result.json").write_text("{}", encoding="utf-8")
    (folder / "readings.csv").symlink_to(other / "secret.txt")
    (folder / "exports" / "siemens").symlink_to(other)
    assert [each.name for each in downloads_of(folder)] == ["result.json"]
