"""A hasty engineer at a control without a guarding program: what is measured, stated, exported,
compared before loading, loaded and read back, and what the machine errs by.

The controls are the plants of `testkit.exact.plants`, which share no code with the exporters; their
tables act or not by a switch. Export and verdicts are those of the command line.
"""

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np

from stepdiag.base.compensation import Statement, stated
from stepdiag.base.result.members import Facts
from stepdiag.base.result.result import Result
from stepdiag.base.volume import Volume, anywhere_mm
from stepdiag.exporters.files.naming import is_restore, plain_name
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine
from testkit.cli import stepdiag
from testkit.exact.hasty import NEEDED
from testkit.exact.loadings import ACCEPTED, LEAVES_UM, Sequence

MAKERS = ("fanuc", "heidenhain", "beckhoff", "linuxcnc", "mitsubishi", "fagor")
SECTIONS = {
    "fanuc": "[fanuc]\ndetection_unit_um = 1.0\nincrement_limit = 127\nstraightness_option = "
    "false\n"
    + "".join(
        f"[fanuc.axes.{axis}]\nnumber = {number}\nreference_point = {200 * number - 100}\n"
        for number, axis in enumerate("XYZ", start=1)
    ),
    "heidenhain": '[heidenhain]\ngeneration = "itnc530"\n',
    "beckhoff": '[beckhoff]\nway = "volumetric"\ncross_sense = "as-error"\naxis_numbers = '
    "{X=1,Y=2,Z=3}\nturned = false\n",
    "linuxcnc": '[linuxcnc]\njoints = {X=[0],Y=[1],Z=[2]}\nway = "screw"\n',
    "mitsubishi": '[mitsubishi]\noutput_unit_um = 0.5\ndata = "incremental"\nfirst_data = 4101\n',
    "fagor": "[fagor]\n",
}
ASKED = {"fanuc": ["EXX", "EYY", "EZZ"], "fagor": ["EXX", "EYY", "EZZ"]}
"""Functions of controls that have tables for nothing else."""
FACTORS = {
    "sign turned": -1.0,
    "inches": 1.0 / 25.4,
    "half the size": 0.5,
    "twice the size": 2.0,
}
"""What the loaded files hold, against right ones."""
DONE = ("whole", "twice", "half", "another machine", "nothing", *FACTORS)


@dataclass(frozen=True, kw_only=True)
class Story:
    """What stood in a control, with which size against right tables (0: drawn from 0.7 to 1.4),
    whether it acted while measuring, what was stated and listed of it, whether it acted before
    loading, and what was loaded."""

    maker: str
    old: bool
    acted: bool = False
    stated: str = "off"
    listed: bool = True
    ready: bool = True
    size: float = 0.0
    done: str = "whole"

    @property
    def right(self) -> bool:
        """Return whether statement and list are true, and the whole export is loaded."""
        true = self.stated == ("on" if self.acted else "off") and self.listed
        return true and self.done in ("whole", "twice") and not self.size


def stories() -> Iterator[Story]:
    """Yield everything that a hasty person did: 36 sequences at each of six controls."""
    for maker in MAKERS:
        for done in DONE:
            yield Story(maker=maker, old=False, done=done)
            yield Story(maker=maker, old=True, acted=True, stated="on", done=done)
        yield Story(maker=maker, old=True, acted=True, stated="on", done="old files again")
        for size, acted, said in itertools.product(
            (0.0, 0.5, 2.0), (False, True), ("off", "on")
        ):
            if size or not (acted and said == "on"):
                yield Story(maker=maker, old=True, acted=acted, stated=said, size=size)
        for acted, ready in itertools.product((False, True), repeat=2):
            yield Story(maker=maker, old=True, acted=acted, listed=False, ready=ready)
        for done in ("half", "another machine"):
            yield Story(maker=maker, old=True, stated="off", ready=False, done=done)


class Shop(Sequence):
    """A machine with one of these controls; ``acts`` is its switch."""

    def __init__(self, seed: int, maker: str, folder: Path) -> None:
        super().__init__(seed, maker, folder)
        self.angle_urad, self.turned_um, self.acts = 0.0, np.zeros(3), True
        self.own_at_first = self.plant.own()
        self.errs(1.0)
        self.volume = Volume(
            origin_mm=tuple(map(float, self.low)),
            size_mm=(400.0, 400.0, 300.0),
            increments=10,
        )

    def errs(self, times: float) -> None:
        """Make the errors of the machine as many times as large."""
        wanted = Amplitudes(
            positioning_um=9.0 * times,
            straightness_um=7.0 * times,
            angle_urad=0.0,
            scale_um_m=20.0 * times,
            squareness_urad=20.0 * times,
        )
        low = (float(self.low[0]), float(self.low[1]), float(self.low[2]))
        seed = int(self.hand.integers(1 << 31)) if not hasattr(self, "drawn") else self.drawn
        self.drawn = seed
        self.machine = Machine(
            errors=random_errors(seed, low, (400.0, 400.0, 300.0), wanted), chain=self.chain
        )

    def errs_um(self) -> float:
        """Return what the machine errs by as it stands (rms)."""
        points = anywhere_mm(self.volume)
        moved = self.plant.moved_um(points) if self.acts else 0.0
        return self._rms_um(self.volume, self.machine.error_at(points) + moved)

    def survey(self) -> Result:
        """Return what a survey finds, with 0.3 um of noise in every function."""
        made = self._result(self.volume, self.acts and bool(self.plant.tables()))
        noise = {
            name: replace(
                each,
                value=each.value + 0.3 * self.hand.normal(size=each.value.shape),
                u=np.full(each.value.shape, 0.3),
            )
            for name, each in made.errors.items()
            if each.value is not None
        }
        return replace(made, errors={**made.errors, **noise})

    def exported(
        self, name: str, result: Result, existing: Mapping[str, bytes], said: str
    ) -> tuple[Path, tuple[object, ...], int]:
        """Export a result; return the folder, the words for `verify`, and the exit code."""
        folder = self.folder / name
        folder.mkdir(parents=True)
        for file, data in existing.items():
            (folder / file).write_bytes(data)
        statement = (
            stated("on", existing, date(2026, 6, 1), "archive")
            if said == "on"
            else Statement(state="off")
        )
        measured = replace(result, survey=statement.facts(Facts(machine="m")))
        (folder / "result.json").write_text(measured.to_json(), encoding="utf-8")
        words = {"section": SECTIONS[self.maker], "direction": "mean"}
        asked = ASKED.get(self.maker, [])
        text = self._profile(self.volume, 1, list(existing), asked, words, said == "on")
        text = re.sub(r"(?m)^backlash_um.*\n", "", text)
        if self.maker == "linuxcnc":
            text = re.sub(r"(?m)^(step_mm = .*)", r"\1\nbacklash_um = 0.0", text)
        (folder / "profile.toml").write_text(text, encoding="utf-8")
        accept = [word for code in ACCEPTED for word in ("--accept", code)]
        judged = (
            folder / "result.json",
            folder / "out",
            "--profile",
            folder / "profile.toml",
        )
        told = stepdiag(
            "export",
            judged[0],
            "--controller",
            self.maker,
            *judged[2:],
            "--out",
            judged[1],
            *accept,
        )
        return folder / "out", judged, told.code

    def load(self, folder: Path, *, half: bool = False) -> None:
        """Copy the files of an export into the control; ``half`` leaves out the last that acts."""
        files = [path for path in sorted(folder.iterdir()) if not is_restore(path.name)]
        acting = [path for path in files if path.suffix not in (".txt", ".ngc", ".py")]
        left = (acting or files)[-1:] if half else []
        for path in files:
            if path not in left and path.name not in ("EXPORT_REPORT.txt", "SHA256SUMS"):
                self.plant.take(plain_name(path.name), path.read_bytes().decode("ascii"))

    def read_out(self) -> list[object]:
        """Write what is read out of the control; return the words that name it."""
        folder = self.folder / f"held{len(list(self.folder.glob('held*')))}"
        folder.mkdir()
        words: list[object] = []
        for name, data in self.plant.own().items():
            (folder / name).write_bytes(data)
            words.append(folder / name)
        return words


def lived(story: Story, seed: int, folder: Path) -> tuple[str, float, float]:
    """Return what stopped a story ("" where nothing did, with exit code 0 to its end), and the true
    rms before and after in um."""
    shop = Shop(seed, story.maker, folder)
    first = shop.plant.own()
    if story.old:
        old, _, code = shop.exported("old", shop.survey(), first, "off")
        assert code == 0
        shop.load(old)
        drawn = float(np.exp(shop.hand.uniform(np.log(0.7), np.log(1.4))))
        shop.errs(1.0 / story.size if story.size else drawn)
    before = shop.errs_um()
    shop.acts = story.acted
    result = shop.survey()
    shop.acts = story.ready
    existing = shop.plant.own() if story.listed else first
    out, judged, code = shop.exported("new", result, existing, story.stated)
    if code:
        return "export", before, before
    told = stepdiag("verify", *judged)
    if told.code not in (0, 3):
        return "verify", before, before
    held = shop.read_out()
    if held and stepdiag("verify", *judged, *_each("--before", held)).code == 5:
        return "before loading", before, before
    try:
        _loaded(shop, story, out, result, existing)
    except ValueError:  # lines for the INI file that do not fit it
        return "loading", before, before
    shop.acts = True
    back = stepdiag("verify", *judged, *_each("--read-back", shop.read_out()))
    if back.code == 5:
        return "read back", before, shop.errs_um()
    if told.code == 3:
        return NEEDED, before, shop.errs_um()
    return "", before, shop.errs_um()


def _loaded(
    shop: Shop, story: Story, out: Path, result: Result, existing: Mapping[str, bytes]
) -> None:
    """Load what the story loads."""
    if story.done == "another machine":
        other = Shop(shop.drawn % 99991, story.maker, shop.folder / "other")
        other.low, other.volume = shop.low, shop.volume
        other.errs(1.0)
        out, _, _ = other.exported("their", other.survey(), shop.own_at_first, "off")
    elif story.done == "old files again":
        out = shop.folder / "old" / "out"
    elif story.done in FACTORS:
        times = FACTORS[story.done]
        errors = {
            name: each if each.value is None else replace(each, value=times * each.value)
            for name, each in result.errors.items()
        }
        square = {
            name: each if each.value is None else replace(each, value=times * each.value)
            for name, each in result.squareness.items()
        }
        edited = replace(result, errors=errors, squareness=square)
        out, _, code = shop.exported("edited", edited, existing, story.stated)
        if code:
            raise ValueError
    if story.done != "nothing":
        shop.load(out, half=story.done == "half")
    if story.done == "twice":
        shop.load(out)


def worse(before_um: float, after_um: float) -> bool:
    """Return whether a machine errs by more than rounding can do."""
    return after_um > 1.02 * before_um + LEAVES_UM


def _each(option: str, paths: list[object]) -> list[object]:
    return [word for path in paths for word in (option, path)]
